"""The picture of guesses: its caption says what its lines show, and nothing that the check denies."""

from __future__ import annotations

import re
from dataclasses import replace

import armtrue_sim
import numpy as np
import pytest

from armtrue.checking import Finding, check
from armtrue.io import Dataset, Robot, load_data, load_robot
from armtrue.workbench.opening import guess_picture as pictured
from armtrue.workbench.opening.guess_picture import guess_picture


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> tuple[Dataset, Robot]:
    made = tmp_path_factory.mktemp("campaign")
    armtrue_sim.simulate({"arm": "kr30", "seed": 5, "poses": 60}).write(made)
    robot = load_robot(made / "robot.yaml")
    return load_data(made / "data.csv", robot, strict=False), robot


def caption(data: Dataset, robot: Robot, findings: list[Finding] | None = None) -> str:
    findings = check(data, robot).findings if findings is None else findings
    found = re.search("<figcaption>(.*)</figcaption>", str(guess_picture(data, robot, findings)))
    assert found
    return found[1]


def rms_m(words: str) -> float:
    found = re.search(r"([\d.]+) (mm|m) RMS", words)
    assert found
    return float(found[1]) * (1e-3 if found[2] == "mm" else 1.0)


def changed(data: Dataset, **columns: np.ndarray) -> Dataset:
    return replace(data, columns={**data.columns, **columns})


def scaled(data: Dataset, factor: float) -> Dataset:
    return changed(data, **{axis: factor * data.columns[axis] for axis in "xyz"})


def test_arm_that_follows_its_points_reaches_them(arm):
    words = caption(*arm)
    assert "The arm reaches its points." in words
    assert rms_m(words) < 0.01


@pytest.mark.parametrize("factor", [1 / 25.4, 1e-3, 1000.0])
def test_points_in_another_unit_are_not_reached(arm, factor):
    data, robot = arm
    words = caption(scaled(data, factor), robot)
    assert "does not reach its points" in words
    assert rms_m(words) > 0.5


def test_error_of_the_check_is_not_contradicted_where_lines_are_short(arm):
    assert "reaches" not in caption(*arm, [Finding("scale", "error", "the scale is wrong")])


def test_one_bumped_point_is_counted(arm):
    data, robot = arm
    bumped = np.where(np.arange(data.count) == 7, 0.2, 0.0)
    assert "all but 1 of them" in caption(changed(data, x=data.columns["x"] + bumped), robot)


def test_each_reflector_has_its_own_offset_and_each_set_up_its_own_place(arm):
    data, robot = arm
    columns = {name: np.asarray(c) for name, c in data.columns.items() if name[:1] == "q" or name in "xyz"}
    flange = pictured.flanges(columns, robot.spec)
    target = np.arange(60) % 3.0
    offsets = np.array([[0.1, 0.0, 0.1], [-0.1, 0.1, 0.1], [0.0, -0.2, 0.1]])[target.astype(int)]
    points = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], offsets)
    station = np.where(np.arange(60) < 30, 1.0, 2.0)
    points[station == 2.0] = (
        points[station == 2.0] @ pictured.pose({"xyz": [0, 0, 0], "rpy": [0, 0, 1]})[:3, :3] + 1.0
    )
    columns |= dict(zip("xyz", points.T, strict=True))
    _, measured, reached = pictured._lines(columns | {"target": target, "station": station}, robot)
    assert np.abs(measured - reached).max() < 1e-4
