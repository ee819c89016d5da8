"""Gravity torques and moments of the links and the payload about every joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from .chain import Chain, Frames, Link
from .transforms import Array, exp_so3


@dataclass
class GravityLoads:
    """Loads of N poses: motor torque (N, n), Nm (N where prismatic); moments per frame (N, n), of the base (N, 3)."""

    motor_torque: Array
    moment_x: Array
    moment_y: Array
    base_moment: Array


@dataclass(frozen=True)
class BodyError:
    """Errors of the weights in robot.yaml: real minus stated.

    mass (kg) and centre (3,) m by link from 0, in frame k of docs/model.md; payload_centre (3,) m in the
    flange's frame; tilt: rotation vector (3,) that takes the stated gravity to the real one, in the robot base.
    """

    mass: Mapping[int, float] = field(default_factory=dict)
    centre: Mapping[int, Array] = field(default_factory=dict)
    payload_centre: Array = field(default_factory=lambda: np.zeros(3))
    tilt: Array = field(default_factory=lambda: np.zeros(3))

    def __add__(self, other: BodyError) -> BodyError:
        return BodyError(
            {k: self.mass.get(k, 0.0) + other.mass.get(k, 0.0) for k in {*self.mass, *other.mass}},
            {
                k: self.centre.get(k, np.zeros(3)) + other.centre.get(k, np.zeros(3))
                for k in {*self.centre, *other.centre}
            },
            self.payload_centre + other.payload_centre,
            self.tilt + other.tilt,
        )

    def scaled(self, factor: float) -> BodyError:
        """All of it `factor` times as large."""
        return BodyError(
            {k: factor * v for k, v in self.mass.items()},
            {k: factor * v for k, v in self.centre.items()},
            factor * self.payload_centre,
            factor * self.tilt,
        )


def real_body(chain: Chain, error: BodyError) -> Chain:
    """The chain with the weights of the real arm and unchanged geometry."""
    links = [
        Link(link.mass + error.mass.get(k, 0.0), link.com + error.centre.get(k, np.zeros(3)))
        for k, link in enumerate(chain.links)
    ]
    return replace(chain, links=links, gravity=exp_so3(error.tilt[None])[0] @ chain.gravity)


def distal_load(
    chain: Chain, frames: Frames, payload: Array, payload_point: Array, k: int
) -> tuple[Array, Array, Array]:
    """Load at the end of link k (from 0), in frame k: force (N, 3), moment about the next joint's origin (N, 3).

    Third result: the link's own weight (N, 3), N.
    """
    n = len(frames.origin)
    end = frames.origin[k + 1] if k + 1 < n else frames.flange_origin
    mass = payload.astype(float).copy()
    first_moment = payload[:, None] * payload_point
    for j in range(k + 1, min(n, len(chain.links))):
        link = chain.links[j]
        first_moment = first_moment + link.mass * (frames.origin[j] + frames.rotation[j] @ link.com)
        mass = mass + link.mass
    moment = np.cross(first_moment - mass[:, None] * end, chain.gravity)
    own = chain.links[k].mass if k < len(chain.links) else 0.0
    in_frame = [
        np.einsum("nji,nj->ni", frames.rotation[k], vector)
        for vector in (
            mass[:, None] * chain.gravity,
            moment,
            np.broadcast_to(own * chain.gravity, moment.shape),
        )
    ]
    return in_frame[0], in_frame[1], in_frame[2]


def gravity_loads(chain: Chain, frames: Frames, payload: Array, payload_point: Array) -> GravityLoads:
    """Gravity loads, signs and frames as in docs/model.md.

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
