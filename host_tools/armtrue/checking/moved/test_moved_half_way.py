"""Checks for a tracker moved, or a reflector exchanged, between two rows; no finding where nothing moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armtrue.checking import Finding, check, refuse_what_cannot_be_an_arm
from armtrue.checking.conftest import Campaign
from armtrue.errors import InputError
from armtrue.io import Dataset, Robot
from armtrue.io.rotation import matrix_about
from armtrue.tables.chain import flanges

STEPS = ("base_step", "reflector_step")


def with_points(data: Dataset, points: np.ndarray, **more: np.ndarray) -> Dataset:
    columns = dict(zip("xyz", np.ascontiguousarray(points.T), strict=True))
    return replace(data, columns={**data.columns, **columns, **more})


def tracker_moved(
    data: Dataset, shift_m: float, turn: float, first: int = 120, **more: np.ndarray
) -> Dataset:
    """`data` (in order of time) as measured by a tracker that was moved before the entry `first`."""
    points = data.positions_m.copy()
    points[first:] = points[first:] @ matrix_about("z", turn).T + [shift_m, 0.0, -shift_m / 2.0]
    return with_points(data, points, **more)


def reflector_moved(data: Dataset, robot: Robot, offset_m: list[float], first: int = 120) -> Dataset:
    points = data.positions_m.copy()
    base = matrix_of(robot.spec["base"]["rpy"])
    turned = base @ flanges(data.columns, robot.spec)[:, :3, :3] @ np.array(offset_m)
    points[first:] += turned[first:]
    return with_points(data, points)


def matrix_of(rpy: list[float]) -> np.ndarray:
    return matrix_about("z", rpy[2]) @ matrix_about("y", rpy[1]) @ matrix_about("x", rpy[0])


def steps(data: Dataset, robot: Robot) -> list[Finding]:
    return [found for found in check(data, robot).findings if found.code in STEPS]


@pytest.mark.parametrize(
    ("arm", "shift_m", "turn"), [("kr30", 5e-3, 2e-3), ("kr30", 1e-3, 2e-4), ("scara", 5e-4, 0.0)]
)
def test_moved_tracker_is_reported_with_row_and_size(
    campaign: Campaign, arm: str, shift_m: float, turn: float
) -> None:
    data, robot = campaign(arm)
    (found,) = steps(tracker_moved(data, shift_m, turn), robot)
    assert (found.code, found.severity) == ("base_step", "warning")
    assert found.message.startswith("from row 122 on the points lie ")
    assert found.evidence["turn_rad"] == pytest.approx(turn, abs=2e-4)
    expected = tracker_moved(data, shift_m, turn).positions_m - data.positions_m
    size = np.sqrt((expected[120:] ** 2).sum(axis=1).mean())
    assert found.evidence["shift_m"] == pytest.approx(size, rel=0.2)
    assert "column 'station'" in found.remedy
    # A fit gives the same warning.
    warnings = refuse_what_cannot_be_an_arm(tracker_moved(data, shift_m, turn), robot)
    assert any("from row 122 on" in warning for warning in warnings)


@pytest.mark.full
def test_step_at_a_new_station_number_is_only_a_note(campaign: Campaign) -> None:
    data, robot = campaign()
    station = np.where(np.arange(data.count) < 120, 1.0, 2.0)
    moved = tracker_moved(data, 5e-3, 2e-3, station=station)
    assert steps(moved, robot) == []
    (note,) = [found for found in check(moved, robot).findings if found.code == "set_ups"]
    assert note.severity == "note"
    assert note.evidence["apart_m"] > 4e-3
    assert "effect station" in note.remedy


def test_exchanged_reflector_is_reported_as_reflector_step(campaign: Campaign) -> None:
    data, robot = campaign()
    (found,) = steps(reflector_moved(data, robot, [3e-3, 4e-3, 0.0]), robot)
    assert (found.code, found.severity) == ("reflector_step", "warning")
    assert found.message.startswith("from row 122 on the reflector is 5.")
    assert found.evidence["shift_m"] == pytest.approx(5e-3, rel=0.05)
    assert "column 'nest'" in found.remedy


def test_of_two_reflectors_only_the_moved_one_is_reported(campaign: Campaign) -> None:
    data, robot = campaign(targets={"names": ["A", "B"], "order": "cycle"})
    of_b = data.columns["target"] == data.labels["target"].index("B")
    moved = reflector_moved(data, robot, [0.0, 2e-3, 0.0]).positions_m
    points = np.where(of_b[:, None], moved, data.positions_m)
    (found,) = steps(with_points(data, points), robot)
    assert "the reflector 'B' is 2." in found.message
    assert found.evidence["shift_m"] == pytest.approx(2e-3, rel=0.1)


@pytest.mark.full
@pytest.mark.parametrize("seed", [3, 11])
def test_jump_of_metres_is_not_reported_as_a_joint_error(campaign: Campaign, seed: int) -> None:
    data, robot = campaign(seed=seed)
    far = tracker_moved(data, 1.5, 0.5)
    (found,) = [found for found in check(far, robot).findings if found.severity == "error"]
    assert found.code == "base_step"
    assert "from row 122 on the measuring frame is displaced" in found.message
    with pytest.raises(InputError, match="from row 122 on the measuring frame"):
        refuse_what_cannot_be_an_arm(far, robot)
    exchanged = reflector_moved(data, robot, [0.2, -0.1, 0.15])
    (found,) = [found for found in check(exchanged, robot).findings if found.severity == "error"]
    assert found.code == "reflector_step"


def test_step_names_the_joint_that_separates_its_two_sides(campaign: Campaign) -> None:
    """With rows in the order of a joint, the arm itself may also jump at that joint's angle."""
    data, robot = campaign()
    sorted_by = data.take(np.argsort(data.columns["q2"], kind="stable"))
    sorted_by.columns["time"] = np.arange(data.count) * 10.0
    (found,) = steps(tracker_moved(sorted_by, 3e-3, 0.0), robot)
    assert (
        "it may also be a jump of joint 2, which is on one side before and on the other after"
        in found.message
    )


def test_no_step_is_reported_for_clean_or_slowly_drifting_data(campaign: Campaign) -> None:
    data, robot = campaign()
    assert steps(data, robot) == []
    hours = data.columns["time"] / 3600.0
    creeping = data.positions_m + np.outer(1.0 - np.exp(-hours / 0.3), [4e-4, 0.0, 3e-4])
    assert steps(with_points(data, creeping), robot) == []


@pytest.mark.full
@pytest.mark.parametrize("name", ["q1", "q2", "payload", "temp_arm"])
def test_no_step_is_reported_for_rows_sorted_by_a_column(campaign: Campaign, name: str) -> None:
    data, robot = campaign()
    ordered = data.take(np.argsort(data.columns[name], kind="stable"))
    ordered.columns["time"] = np.arange(data.count) * 10.0
    assert steps(ordered, robot) == []


@pytest.mark.full
def test_no_step_is_reported_for_single_gross_errors(campaign: Campaign) -> None:
    data, robot = campaign()
    scattered = data.positions_m.copy()
    scattered[[30, 31, 150, 200]] += 0.02
    assert steps(with_points(data, scattered), robot) == []


def test_no_step_is_reported_for_too_few_rows(campaign: Campaign) -> None:
    data, robot = campaign()
    few = data.take(np.arange(30))
    assert steps(tracker_moved(few, 5e-3, 2e-3, first=15), robot) == []
