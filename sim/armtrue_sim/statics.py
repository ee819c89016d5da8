"""Gravity torques and moments: what the links and the payload weigh about every joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .chain import Chain, Frames
from .transforms import Array


@dataclass
class GravityLoads:
    """Loads of N poses: motor torque (N, n), Nm (N where prismatic); moments per frame (N, n), of the base (N, 3)."""

    motor_torque: Array
    moment_x: Array
    moment_y: Array
    base_moment: Array


def gravity_loads(chain: Chain, frames: Frames, payload: Array, payload_point: Array) -> GravityLoads:
    """What gravity exerts, signs and frames as in docs/model.md.

    payload (N,) kg acts at payload_point (N, 3), in the robot base. Virtual work: torque about joint k is the moment
    of everything beyond joint k about its axis, mapped to the motors by the transpose of the coupling matrix.
    """
    count, n = len(payload), chain.n
    mass = payload.astype(float).copy()
    first_moment = payload[:, None] * payload_point
    joint_torque = np.empty((count, n))
    moment_x, moment_y = np.empty((count, n)), np.empty((count, n))
    for k in reversed(range(n)):
        if k < len(chain.links):
            link = chain.links[k]
            first_moment = first_moment + link.mass * (frames.origin[k] + frames.rotation[k] @ link.com)
            mass = mass + link.mass
        moment = np.cross(first_moment - mass[:, None] * frames.origin[k], chain.gravity)
        in_frame = np.einsum("nji,nj->ni", frames.rotation[k], moment)
        moment_x[:, k], moment_y[:, k] = in_frame[:, 0], in_frame[:, 1]
        if chain.prismatic[k]:
            joint_torque[:, k] = mass * (frames.rotation[k][:, :, 2] @ chain.gravity)
        else:
            joint_torque[:, k] = in_frame[:, 2]
    return GravityLoads(
        joint_torque @ chain.coupling, moment_x, moment_y, np.cross(first_moment, chain.gravity)
    )
