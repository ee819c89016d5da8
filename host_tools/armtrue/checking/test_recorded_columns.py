"""Columns beside joints and positions: approach directions, thermometers, units, columns that never change."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import armtrue_sim
import numpy as np
import pytest

from armtrue.checking import Finding, check, temperatures, units
from armtrue.checking.directions import find
from armtrue.checking.run import refuse_what_cannot_be_an_arm
from armtrue.io import Dataset, Robot, load_data, load_robot
from armtrue.io.ways import directions

Change = Callable[[np.ndarray], np.ndarray]


@pytest.fixture
def campaign(tmp_path: Path) -> Callable[..., tuple[Dataset, Robot]]:
    def simulated(arm: str = "kr30", seed: int = 131, **more: object) -> tuple[Dataset, Robot]:
        armtrue_sim.simulate({"arm": arm, "seed": seed, "hidden": [], **more}).write(tmp_path)
        robot = load_robot(tmp_path / "robot.yaml")
        return load_data(tmp_path / "data.csv", robot), robot

    return simulated


def with_directions(data: Dataset, change: Change, joints: range = range(1, 7)) -> Dataset:
    changed = {f"dir{k}": change(data.columns[f"dir{k}"]) for k in joints}
    return replace(data, columns={**data.columns, **changed})


def late(side: np.ndarray) -> np.ndarray:
    return np.concatenate([side[:1], side[:-1]])


def early(side: np.ndarray) -> np.ndarray:
    return np.concatenate([side[1:], side[-1:]])


def only(findings: list[Finding]) -> Finding:
    (found,) = findings
    return found


@pytest.mark.parametrize(("arm", "seed"), [("kr30", 131), ("cobot", 132), ("kr30", 133)])
@pytest.mark.parametrize(
    ("change", "words"), [(late, "moved up by one row"), (early, "moved down by one row")]
)
def test_directions_shifted_by_one_row_are_a_warning(campaign, arm, seed, change, words):
    data, robot = campaign(arm, seed, directions="order")
    wrong = with_directions(data, change)
    found = only(find(wrong))
    assert found.severity == "warning"
    assert "dir1…dir6" in found.message
    assert f"and in 100% if {words}" in found.message
    assert "derive: {dir: from_order}" in found.remedy
    assert any(words in doubt for doubt in refuse_what_cannot_be_an_arm(wrong, robot))


def test_directions_of_opposite_sign_are_named(campaign):
    data, _ = campaign(directions="order")
    found = only(find(with_directions(data, np.negative, range(2, 4))))
    assert "dir2, dir3" in found.message
    assert "taken with the opposite sign" in found.message
    assert "'dir2: {column: dir2, scale: -1}'" in found.remedy


@pytest.mark.parametrize(
    ("change", "mend"),
    [
        (lambda side: (side > 0.0).astype(float), "scale: 2, offset: -1"),
        (lambda side: (side < 0.0).astype(float), "scale: -2, offset: 1"),
    ],
    ids=["0 for -1", "1 for -1"],
)
def test_directions_written_as_zero_and_one_are_named(campaign, change, mend):
    # Once reported as columns that never change: as if the joint approached all poses from one side.
    data, robot = campaign(directions="order")
    wrong = with_directions(data, change, range(2, 4))
    found = only(find(wrong))
    assert f"'dir2: {{column: dir2, {mend}}}'" in found.remedy
    assert not any("dir2" in f.message for f in check(wrong, robot).findings if f.code == "never_changes")


def test_direction_0_of_a_joint_at_rest_is_not_taken_for_minus_1(campaign):
    data, _ = campaign(directions="order")
    stood = np.where(np.arange(data.count) % 3 == 0, 0.0, 1.0)
    assert find(with_directions(data, lambda _: stood, range(2, 4))) == []


def test_directions_are_checked_in_order_of_time(campaign):
    data, _ = campaign(directions="order")
    mixed = np.random.default_rng(3).permutation(data.count)
    assert find(data.take(mixed)) == []
    assert find(with_directions(data, late).take(mixed))


def test_consistent_or_undecidable_directions_give_no_finding(campaign):
    data, _ = campaign(directions="order")
    assert find(data) == []
    # The arm passed other points between the poses; then too few motions to decide.
    assert find(campaign(directions="random")[0]) == []
    assert find(with_directions(data, late).take(np.arange(20))) == []
    # The directions of a joint that long moves one way agree with its motion as they are and shifted by a row.
    one_way = np.arange(float(data.count))
    long_way = replace(data, columns={**data.columns, "q1": one_way, "dir1": np.ones(data.count)})
    assert find(with_directions(long_way, late, range(1, 2))) == []


def changed(data: Dataset, **columns: np.ndarray) -> Dataset:
    return replace(data, columns={**data.columns, **columns})


def codes_of(data: Dataset) -> list[str]:
    return [one.code for one in temperatures.find(data)]


def only_one(data: Dataset, code: str) -> Finding:
    (found,) = [one for one in temperatures.find(data) if one.code == code]
    return found


@pytest.mark.parametrize("last", [130, None])
def test_thermometer_that_stops_changing_is_a_warning(campaign, last):
    data, _ = campaign()
    order = np.argsort(data.columns["time"], kind="stable")
    rng = np.random.default_rng(4)
    hall = np.round(21.0 + 3.0 * np.sin(np.linspace(0.0, 3.0, data.count)), 2)
    read = 20.0 + np.linspace(0.0, 8.0, data.count) + rng.normal(0.0, 0.05, data.count)
    columns = {"temp_arm": np.empty(data.count), "temp_hall": np.empty(data.count)}
    columns["temp_hall"][order], columns["temp_arm"][order] = hall, read
    good = changed(data, **columns)
    assert "temperature_stands" not in codes_of(good)
    still = slice(60, last and min(last, data.count - 5))
    read[still] = read[60]
    columns["temp_arm"][order] = read
    found = only_one(changed(data, **columns), "temperature_stands")
    rows = data.rows[order][still]
    assert found.evidence["column"] == "temp_arm"
    assert found.evidence["rows"] == rows.tolist()
    assert f"found {read[60]:.2f} °C unchanged from row {rows[0]} to row {rows[-1]}" in found.message
    assert "temp_hall" in found.message
    # Coarse readings are constant while little changes; a plateau reached and left by small steps is no fault.
    coarse = np.round(2.0 * (20.0 + 8.0 * (1.0 - np.exp(-np.arange(data.count) / 15.0)))) / 2.0
    columns["temp_arm"][order] = coarse
    assert "temperature_stands" not in codes_of(changed(data, **columns))


def test_sensor_of_robot_file_without_a_column_is_named(campaign):
    data, robot = campaign()
    assert list(temperatures.without_columns(data, robot)) == []
    other = Robot({**robot.spec, "temperature": {"reference": 20.0, "sensors": ["arn"]}})
    (found,) = temperatures.without_columns(data, other)
    assert found.severity == "warning"
    assert (
        "found 'arn', expected a column temp_arn of it in data.csv (did you mean 'temp_arm'?)"
        in found.message
    )
    without = replace(data, columns={name: v for name, v in data.columns.items() if name != "temp_arm"})
    assert [one.severity for one in temperatures.without_columns(without, other)] == ["note"]


@pytest.mark.parametrize("value", [85.0, 0.0, -40.0])
def test_thermometer_that_was_off_in_one_row_is_a_warning(campaign, value):
    data, _ = campaign()
    read = data.columns["temp_arm"].copy()
    read[7] = value
    found = only_one(changed(data, temp_arm=read), "temperature_off")
    assert f"found {value:.1f} °C in row 9" in found.message


def test_each_error_value_of_a_thermometer_is_a_warning(campaign):
    data, _ = campaign()
    read = data.columns["temp_arm"].copy()
    read[[3, 40]], read[[5, 9]] = -60.0, -40.0
    found = [
        one.evidence["rows"]
        for one in temperatures.find(changed(data, temp_arm=read))
        if one.code == "temperature_off"
    ]
    assert found == [data.rows[[3, 40]].tolist(), data.rows[[5, 9]].tolist()]


def test_columns_that_never_change_are_named(campaign):
    data, robot = campaign()
    before = [f.message for f in check(data, robot).findings if f.code == "never_changes"]
    assert not any("dir" in message or "temp" in message for message in before)
    one_side = {"dir2": np.ones(data.count), "dir4": -np.ones(data.count)}
    constant = {"temp_arm": np.full(data.count, 21.5), "air": np.full(data.count, 3.0)}
    report = check(changed(data, **one_side, **constant), robot)
    found = {str(f.evidence["columns"]): f for f in report.findings if f.code == "never_changes"}
    assert {"['dir2']", "['dir4']", "['temp_arm']", "['air']"} <= set(found)
    assert (
        "lost motion (backlash, hysteresis) cannot be distinguished from a shift of its zero"
        in found["['dir2']"].message
    )
    assert "found -1" in found["['dir4']"].message
    assert found["['temp_arm']"].severity == "note"


@pytest.mark.parametrize(
    ("times", "looks_like", "unit"),
    [(1e3, "milliseconds", "ms"), (1.0 / 3600.0, "hours", "h")],
)
def test_implausible_times_are_reported_as_another_unit(campaign, times, looks_like, unit):
    # Warm-up over time was attributed to the measured temperatures and to the warming of gears.
    data, robot = campaign(hidden=["warm_up"])
    assert list(units.find_time(data, robot)) == []
    other = replace(data, columns={**data.columns, "time": times * data.columns["time"]})
    found = only(units.find_time(other, robot))
    assert found.code == "time_unit"
    assert found.severity == "warning"
    assert f"looks like {looks_like}" in found.message
    assert f"unit: {unit}" in found.remedy
    assert any(finding.code == "time_unit" for finding in check(other, robot).findings)


def test_implausible_travel_is_reported_as_another_unit(campaign):
    data, robot = campaign(columns={"add": ["travel"]})
    assert list(units.find_travel(data, robot)) == []
    degrees = changed(data, travel3=np.degrees(data.columns["travel3"]))
    found = only(units.find_travel(degrees, robot))
    assert "'travel3: {column: travel3, unit: deg}'" in found.remedy
    assert any(finding.code == "travel_unit" for finding in check(degrees, robot).findings)


def test_travel_that_follows_from_the_rows_is_no_column_of_the_file(campaign, tmp_path):
    data, robot = campaign()
    header, *rows = [line.split(",") for line in (tmp_path / "data.csv").read_text().splitlines()]
    for name, values in directions(data.columns).items():
        for row, value in zip(rows, values, strict=True):
            row[header.index(name)] = f"{value:.0f}"
    file = tmp_path / "ordered.csv"
    file.write_text("\n".join(map(",".join, [header, *rows])) + "\n")
    travelled = load_data(file, robot)
    assert "travel1" in travelled.columns
    spec = json.loads(json.dumps(robot.spec))
    spec["kinematics"]["joints"][0]["limits"] = [-1.0, 1.0]
    narrow = replace(robot, spec=spec)
    assert not any("travel1" in warning for warning in refuse_what_cannot_be_an_arm(travelled, narrow))
    found = check(load_data(file, robot, strict=False), robot).findings
    assert not any("hysteresis" in finding.message for finding in found)


def test_untestable_effects_have_a_remedy_that_can_be_followed(campaign):
    found = {
        finding.evidence["effect"]: finding
        for finding in check(*campaign()).findings
        if finding.code == "untestable"
    }
    assert found["nest"].message == "nest cannot be tested without the column nest"
    assert found["nest"].remedy.startswith("Record it")
    assert "the columns qr1 to qr6" in found["command_readback"].message
    assert found["parallelogram"].remedy.startswith("State it in robot.yaml")
    assert found["axis_straightness"].remedy == ""


def test_gear_ratio_below_one_is_reported(campaign):
    data, robot = campaign()
    assert list(units.find_ratios(robot)) == []
    spec = robot.spec | {"kinematics": json.loads(json.dumps(robot.spec["kinematics"]))}
    spec["kinematics"]["joints"][1]["gear_ratio"] = -0.01
    found = only([one for one in check(data, Robot(spec)).findings if one.code == "gear_ratio"])
    assert "found -0.01 on joint 2" in found.message
    assert "Write -100 for joint 2" in found.remedy


def test_kelvin_is_not_also_reported_as_fahrenheit(campaign):
    data, robot = campaign()
    warm = changed(data, temp_arm=1.8 * data.columns["temp_arm"] + 32.0)
    assert "temperature_unit" in codes_of(warm)
    kelvin = changed(data, temp_arm=data.columns["temp_arm"] + 273.15)
    assert "temperature_unit" not in codes_of(kelvin)
    assert any("look like kelvin" in finding.message for finding in units.find(kelvin, robot))


def test_restarted_clock_is_not_reported_as_unsorted_time(campaign):
    data, robot = campaign()
    time = data.columns["time"].copy()
    for first in (80, 160):
        time[first:] -= time[first]
    report = check(changed(data, time=time), robot)
    found = only([one for one in report.findings if one.code.startswith("time_")])
    assert found.code == "time_begins_again"
    assert found.evidence["rows"] == data.rows[[80, 160]].tolist()


@pytest.mark.parametrize("times", [0.0, 0.05, 1.0 / 60.0, 20.0])
def test_plausible_times_give_no_finding(campaign, times):
    data, robot = campaign(hidden=["warm_up"])
    other = replace(data, columns={**data.columns, "time": 5.0 + times * data.columns["time"]})
    assert list(units.find_time(other, robot)) == []
    assert list(units.find_time(data.take(np.arange(data.count) < 4), robot)) == []
