"""Torques against virtual work: on every arm they are minus the slope of the potential energy."""

import numpy as np
import pytest

from ..poses import random_poses
from ..presets import PRESETS, nominal_robot
from .chain import Chain
from .statics import gravity_loads

PAYLOAD_POINT = np.array([0.05, -0.02, 0.11])


def loads_and_energy(chain, q, payload):
    frames = chain.frames(chain.link_variables(q))
    point = frames.flange_origin + frames.flange_rotation @ PAYLOAD_POINT
    energy = -payload * (point @ chain.gravity)
    for k, link in enumerate(chain.links):
        energy = energy - link.mass * ((frames.origin[k] + frames.rotation[k] @ link.com) @ chain.gravity)
    return gravity_loads(chain, frames, payload, point), energy


# Standard DH has no turn before the first axis, which the rail of a level base needs.
@pytest.mark.parametrize(
    ("name", "convention"),
    [(name, form) for name in PRESETS for form in ("mdh", "dh") if name + form != "raildh"],
)
def test_torque_is_minus_the_slope_of_potential_energy(name, convention):
    robot = nominal_robot(name, convention)
    robot["gravity"] = [0.7, -1.1, -9.6]
    chain = Chain.from_robot(robot)
    q = random_poses(robot, chain, 30, np.random.default_rng(2))
    payload = np.linspace(0.0, 9.0, 30)
    torque = loads_and_energy(chain, q, payload)[0].motor_torque
    step = 1e-5
    for k in range(chain.n):
        shift = step * np.eye(chain.n)[k]
        ahead, behind = (loads_and_energy(chain, q + sign * shift, payload)[1] for sign in (1.0, -1.0))
        assert np.allclose(torque[:, k], -(ahead - behind) / (2.0 * step), atol=1e-5)


def test_moments_by_hand_on_the_outstretched_arm():
    robot = nominal_robot("lbr")
    robot["links"] = []
    chain = Chain.from_robot(robot)
    q = np.zeros((1, 7))
    q[0, 1] = np.pi / 2
    frames = chain.frames(chain.link_variables(q))
    loads = gravity_loads(chain, frames, np.array([2.0]), frames.flange_origin)
    lever = 0.42 + 0.4 + 0.152
    # The payload hangs in front (+x): its moment about every origin points along +y of the base.
    assert np.allclose(loads.base_moment[0], [0.0, 2.0 * 9.81 * lever, 0.0])
    assert np.isclose(loads.motor_torque[0, 1], 2.0 * 9.81 * lever)
    assert np.isclose(loads.motor_torque[0, 0], 0.0)
    assert np.isclose(np.hypot(loads.moment_x[0, 0], loads.moment_y[0, 0]), 2.0 * 9.81 * lever)


def test_prismatic_axis_feels_a_force():
    robot = nominal_robot("scara")
    chain = Chain.from_robot(robot)
    loads, _ = loads_and_energy(chain, np.array([[0.2, 0.3, 0.1, 0.4]]), np.array([3.0]))
    # z of the spindle points down: gravity pulls along it.
    assert np.isclose(loads.motor_torque[0, 2], 9.81 * (2.5 + 0.6 + 3.0))
