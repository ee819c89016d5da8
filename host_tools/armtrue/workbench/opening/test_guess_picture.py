"""The picture of guesses: its caption agrees with its lines and with the findings of the check."""

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


def test_caption_says_reached_if_the_points_fit_the_arm(arm):
    words = caption(*arm)
    assert "The arm reaches its points." in words
    assert rms_m(words) < 0.01


@pytest.mark.parametrize("factor", [1 / 25.4, 1e-3, 1000.0])
def test_caption_says_not_reached_for_points_in_another_unit(arm, factor):
    data, robot = arm
    words = caption(scaled(data, factor), robot)
    assert "does not reach its points" in words
    assert rms_m(words) > 0.5


def test_caption_does_not_contradict_an_error_of_the_check(arm):
    assert "reaches" not in caption(*arm, [Finding("scale", "error", "the scale is wrong")])


def test_caption_counts_one_outlying_point(arm):
    data, robot = arm
    bumped = np.where(np.arange(data.count) == 7, 0.2, 0.0)
    assert "all but 1 of them" in caption(changed(data, x=data.columns["x"] + bumped), robot)


def test_lines_align_each_reflector_and_each_set_up_separately(arm):
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
