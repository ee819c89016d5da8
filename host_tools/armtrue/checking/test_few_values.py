"""Poses on a coarse grid are a warning, also before a fit; an indexed axis, repeats and fine steps are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armtrue.checking import Finding, refuse_what_cannot_be_an_arm
from armtrue.checking.conftest import Campaign
from armtrue.checking.run import cheap_findings
from armtrue.io import Dataset, Robot
from armtrue.io.rotation import matrix_from_rpy
from armtrue.tables.chain import flanges

CODE = "few_joint_values"


def moved_to(data: Dataset, robot: Robot, joints: np.ndarray) -> Dataset:
    """The measurements of `data` at other `joints` (N, 6), with noise of 10 µm."""
    columns = {f"q{k}": np.ascontiguousarray(joints[:, k - 1]) for k in range(1, 7)}
    base, tool = robot.spec["base"], robot.spec["tool"]
    flange = flanges(columns, robot.spec)
    points = flange[:, :3, :3] @ tool["xyz"] + flange[:, :3, 3]
    points = points @ matrix_from_rpy(base["rpy"]).T + base["xyz"]
    points = points + np.random.default_rng(1).normal(0.0, 1e-5, points.shape)
    unique = np.arange(float(data.count))
    columns |= dict(zip("xyz", np.ascontiguousarray(points.T), strict=True))
    return replace(data, columns={**data.columns, **columns, "repeat": unique})


def on_grid(data: Dataset, *counts: int) -> np.ndarray:
    """Joints (N, 6) of `data`, each moved to the nearest of so many evenly spaced values; 0 leaves a joint as it is."""
    joints = data.joints.copy()
    for k, count in enumerate(counts):
        if count:
            low, high = joints[:, k].min(), joints[:, k].max()
            values = np.linspace(low, high, 2 * count + 1)[1::2]
            joints[:, k] = values[np.abs(joints[:, k, None] - values).argmin(axis=1)]
    return joints


def found(data: Dataset, robot: Robot) -> list[Finding]:
    return [finding for finding in cheap_findings(data, robot) if finding.code == CODE]


@pytest.fixture
def session(campaign: Campaign) -> tuple[Dataset, Robot]:
    data, robot = campaign(seed=8)
    assert found(data, robot) == []
    return data, robot


def test_coarse_grid_of_joint_angles_is_a_warning(session: tuple[Dataset, Robot]) -> None:
    # One wave on one joint was named as a gear wave of 440 cycles a turn; at other poses the error doubled.
    data, robot = session
    (grid,) = found(moved_to(data, robot, on_grid(data, 4, 4, 4, 3, 3, 3)), robot)
    assert grid.severity == "warning"
    assert "found only 4 values of q1, q2, q3 and 3 values of q4, q5, q6 in " in grid.message
    assert grid.evidence["values"] == {"1": 4, "2": 4, "3": 4, "4": 3, "5": 3, "6": 3}
    assert "at random within their ranges" in grid.remedy


def test_one_joint_at_five_values_is_named_alone(session: tuple[Dataset, Robot]) -> None:
    data, robot = session
    joints = on_grid(data, 0, 0, 0, 5)
    drives = np.random.default_rng(4).normal(0.0, 1e-5, joints.shape)
    (grid,) = found(moved_to(data, robot, joints + drives), robot)
    assert grid.evidence["values"] == {"4": 5}
    assert "found only 5 values of q4 in 228 poses" in grid.message


def test_warning_of_a_grid_stands_before_a_fit(session: tuple[Dataset, Robot]) -> None:
    data, robot = session
    warnings = refuse_what_cannot_be_an_arm(moved_to(data, robot, on_grid(data, 0, 5)), robot)
    assert any("found only 5 values of q2" in warning for warning in warnings)


@pytest.mark.parametrize(
    "counts", [(0, 0, 0, 0, 0, 2), (1, 0, 0, 0, 0, 0), (0, 12, 0, 0, 0, 0)], ids=["indexed", "still", "fine"]
)
def test_indexed_still_and_finely_stepped_joints_are_no_finding(
    session: tuple[Dataset, Robot], counts: tuple[int, ...]
) -> None:
    data, robot = session
    assert found(moved_to(data, robot, on_grid(data, *counts)), robot) == []


def test_few_poses_measured_often_are_no_grid(session: tuple[Dataset, Robot]) -> None:
    data, robot = session
    joints = np.tile(data.joints[:8], (30, 1))
    drives = np.random.default_rng(4).normal(0.0, 2e-5, joints.shape)
    assert found(moved_to(data, robot, joints + drives), robot) == []


def test_grid_with_twenty_other_poses_is_no_finding(session: tuple[Dataset, Robot]) -> None:
    data, robot = session
    joints = on_grid(data, 5, 5, 5, 5, 5, 5)
    joints[-20:] = data.joints[-20:]
    assert found(moved_to(data, robot, joints), robot) == []


def test_joint_that_hardly_turns_is_no_grid(session: tuple[Dataset, Robot]) -> None:
    data, robot = session
    joints = data.joints.copy()
    joints[:, 5] = 0.02 * joints[:, 5]
    assert found(moved_to(data, robot, joints), robot) == []
