"""Poses known from data sheets and by hand, and the two Denavit-Hartenberg conventions against each other."""

import numpy as np
import pytest

from ..errors import ScenarioError
from ..poses import random_poses
from ..presets import PRESETS, nominal_robot
from .chain import Chain


def flange(name, q, convention="mdh"):
    chain = Chain.from_robot(nominal_robot(name, convention))
    frames = chain.frames(chain.link_variables(np.atleast_2d(np.asarray(q, float))))
    return frames.flange_origin[0], frames.flange_rotation[0]


@pytest.mark.parametrize(
    ("name", "q", "expected"),
    [
        # Upright: base column, upper arm and elbow offset add up; forearm and flange point forward.
        ("kr30", [0] * 6, [0.35 + 0.82 + 0.17, 0.0, 0.815 + 0.85 + 0.145]),
        ("irb2400", [0] * 6, [0.1 + 0.755 + 0.085, 0.0, 0.615 + 0.705 + 0.135]),
        # The position that Universal Robots publishes for all joints at zero.
        ("cobot", [0] * 6, [-0.612 - 0.5723, -0.163941 - 0.0922, 0.1273 - 0.1157]),
        ("lbr", [0] * 7, [0.0, 0.0, 0.36 + 0.42 + 0.4 + 0.152]),
        ("lbr", [0, np.pi / 2, 0, 0, 0, 0, 0], [0.42 + 0.4 + 0.152, 0.0, 0.36]),
        ("scara", [0, 0, 0.12, 0], [0.325 + 0.275, 0.0, 0.35 - 0.12 - 0.05]),
        ("scara", [np.pi / 2, -np.pi / 2, 0.0, 0], [0.275, 0.325, 0.35 - 0.05]),
        ("stanford", [0, np.pi / 2, 0.5, 0, 0, 0], [0.5 + 0.2 + 0.12, 0.15, 0.6]),
    ],
)
@pytest.mark.parametrize("convention", ["mdh", "dh"])
def test_known_poses(name, q, expected, convention):
    assert np.allclose(flange(name, q, convention)[0], expected, atol=1e-12)


@pytest.mark.parametrize(
    "name", [name for name in PRESETS if name != "rail"]
)  # standard DH cannot turn before axis 1
def test_standard_and_modified_dh_are_the_same_arm(name):
    robot = nominal_robot(name)
    rng = np.random.default_rng(1)
    for q in random_poses(robot, Chain.from_robot(robot), 20, rng):
        for mdh, dh in zip(flange(name, q), flange(name, q, "dh"), strict=True):
            assert np.allclose(mdh, dh, atol=1e-12)


def test_parallelogram_keeps_the_forearm_level_while_axis_2_moves():
    rotations = [flange("irb2400", [0.3, q2, 0.2, 0, 0, 0])[1] for q2 in (-0.4, 0.0, 0.5)]
    assert np.allclose(rotations[0], rotations[1])
    assert np.allclose(rotations[0], rotations[2])


def test_virtual_joint_turns_everything_beyond_its_frame():
    chain = Chain.from_robot(nominal_robot("kr30"))
    theta = chain.link_variables(np.array([[0.1, -0.3, 0.4, 0.5, 0.6, 0.7]]))
    turn = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.01]])
    moved = chain.frames(theta, {2: turn}).flange_origin
    theta[0, 2] += 0.01
    assert np.allclose(moved, chain.frames(theta).flange_origin, atol=1e-15)


def test_unknown_convention_is_refused_by_name():
    robot = nominal_robot("kr30")
    robot["kinematics"]["convention"] = "hayati"
    with pytest.raises(ScenarioError, match="hayati"):
        Chain.from_robot(robot)
