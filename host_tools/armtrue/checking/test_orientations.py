"""Orientations that follow the arm pass; another convention is found, and named where it is a known one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armtrue.checking import check
from armtrue.checking.alignment import align, alignment_columns
from armtrue.io import Dataset, Robot
from armtrue.io.rotation import matrix_about
from armtrue.tables.chain import chain_from_robot, pose

CODE = "orientations_do_not_follow"


def quaternions(rotation: np.ndarray) -> np.ndarray:
    """(N, 4) w, x, y, z of rotations (N, 3, 3): the eigenvector of Bar-Itzhack's symmetric matrix."""
    found = []
    for r in rotation:
        k = np.array(
            [
                [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
                [0.0, r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
                [0.0, 0.0, r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
                [0.0, 0.0, 0.0, r[2, 2] - r[0, 0] - r[1, 1]],
            ]
        )
        found.append(np.linalg.eigh(k, UPLO="U")[1][:, -1])
    return np.array(found)


@pytest.fixture(scope="module")
def turned(tmp_path_factory) -> tuple[Dataset, Robot, np.ndarray]:
    """A campaign and its rotations (measuring frame from tool): tilted tool, noise of half a degree."""
    import armtrue_sim

    from armtrue.checking.test_check import SCENARIOS
    from armtrue.io import load_data, load_robot

    folder = tmp_path_factory.mktemp("turned")
    armtrue_sim.cli_simulate(SCENARIOS / "kr30.yaml", folder)
    robot = load_robot(folder / "robot.yaml")
    data = load_data(folder / "data.csv", robot, strict=False)
    chain = chain_from_robot(robot.spec)
    base = pose(dict(align(alignment_columns(data), robot).measuring_from_base))
    flange = (base @ chain.frames(data.joints)[-1] @ chain.end)[:, :3, :3]
    wobble = np.radians(np.random.default_rng(1).normal(0.0, 0.5, data.count))
    tool = matrix_about("x", 0.7) @ matrix_about("z", -1.9)
    return data, robot, flange @ tool @ np.array([matrix_about("y", angle) for angle in wobble])


def with_rotations(data: Dataset, columns: np.ndarray) -> Dataset:
    named = {f"q{axis}": columns[:, i] for i, axis in enumerate("wxyz")}
    return replace(data, columns={**data.columns, **named})


def said(data: Dataset, robot: Robot) -> list[str]:
    return [finding.message for finding in check(data, robot).findings if finding.code == CODE]


def test_orientations_from_two_set_ups_pass(turned):
    # Those of the second set-up were compared with the base of the first, and the fit was refused.
    data, robot, rotation = turned
    later = np.arange(data.count) >= data.count // 2
    turn = matrix_about("z", 1.2)
    points = np.where(later[:, None], data.positions_m @ turn.T + [3.0, -1.0, 0.2], data.positions_m)
    points = dict(zip("xyz", np.ascontiguousarray(points.T), strict=True))
    seen = replace(data, columns={**data.columns, **points, "station": 1.0 + later})
    rotation = np.where(later[:, None, None], turn @ rotation, rotation)
    assert said(with_rotations(seen, quaternions(rotation)), robot) == []
    assert len(said(with_rotations(seen, quaternions(rotation)[:, [3, 0, 1, 2]]), robot)) == 1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_orientations_that_follow_the_arm_pass(turned, sign):
    data, robot, rotation = turned
    assert said(with_rotations(data, sign * quaternions(rotation)), robot) == []


@pytest.mark.parametrize(
    ("places", "words"),
    [((1, 2, 3, 0), "x, y, z, w and were read as w, x, y, z"), ((3, 0, 1, 2), "read as x, y, z, w")],
)
def test_other_order_of_quaternion_components_is_named(turned, places, words):
    data, robot, rotation = turned
    (message,) = said(with_rotations(data, quaternions(rotation)[:, places]), robot)
    assert words in message


def test_inverse_orientation_is_named(turned):
    data, robot, rotation = turned
    (message,) = said(with_rotations(data, quaternions(np.swapaxes(rotation, 1, 2))), robot)
    assert "the inverse" in message


def test_unknown_orientation_convention_is_found_without_a_name(turned):
    data, robot, rotation = turned
    mirrored = quaternions(rotation) * [1.0, 1.0, -1.0, 1.0]
    (message,) = said(with_rotations(data, mirrored), robot)
    assert "do not turn with the arm" in message
    assert ";" not in message
