"""Checks of simulated campaigns: no finding for correct data, the right finding for one deliberate mistake."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import armtrue_sim
import numpy as np
import pytest
import yaml

from armtrue.checking import CheckReport, check, lengths
from armtrue.io import Dataset, Robot, load_data, load_robot
from armtrue.io.rotation import matrix_from_rpy
from armtrue.tables.chain import flanges

SCENARIOS = Path(__file__).resolve().parents[3] / "sim" / "scenarios"


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Dataset, Robot]]:
    @functools.cache
    def simulated(name: str) -> tuple[Dataset, Robot]:
        folder = tmp_path_factory.mktemp(name)
        armtrue_sim.cli_simulate(SCENARIOS / f"{name}.yaml", folder)
        robot = load_robot(folder / "robot.yaml")
        return load_data(folder / "data.csv", robot, strict=False), robot

    return simulated


def changed(data: Dataset, **columns: np.ndarray) -> Dataset:
    return replace(data, columns={**data.columns, **columns})


def codes(report: CheckReport, *severities: str) -> list[str]:
    return [finding.code for finding in report.findings if not severities or finding.severity in severities]


def finding(report: CheckReport, code: str):
    (found,) = [finding for finding in report.findings if finding.code == code]
    return found


@pytest.mark.parametrize(
    "name", ["kr30", "irb2400-parallelogram", "cobot-two-effects", "lbr", "scara", "stanford"]
)
def test_correct_conventions_give_no_error(campaign, name):
    report = check(*campaign(name))
    assert codes(report, "error") == []
    assert not {"gross_errors", "scale", "base_or_tool_elsewhere"} & set(codes(report))


@pytest.mark.parametrize("joint", [2, *(pytest.param(joint, marks=pytest.mark.full) for joint in (3, 4, 5))])
def test_joint_that_turns_the_other_way_is_found(campaign, joint):
    data, robot = campaign("kr30")
    report = check(changed(data, **{f"q{joint}": -data.columns[f"q{joint}"]}), robot)
    assert f"joint {joint} turns the other way" in finding(report, "joint_sign").message


@pytest.mark.full
def test_two_joints_that_turn_the_other_way_are_found(campaign):
    data, robot = campaign("kr30")
    report = check(changed(data, q2=-data.columns["q2"], q4=-data.columns["q4"]), robot)
    words = " ".join(f.message for f in report.findings if f.code == "joint_sign")
    assert ("joint 2 turns" in words and "joint 4 turns" in words) or "joints 2, 4 turn" in words


@pytest.mark.quick("2-90", "5-180")
@pytest.mark.parametrize(("joint", "degrees"), [(2, 90), (3, -90), (5, 180)])
def test_joint_zero_off_by_a_quarter_or_half_turn_is_found(campaign, joint, degrees):
    data, robot = campaign("kr30")
    report = check(changed(data, **{f"q{joint}": data.columns[f"q{joint}"] - math.radians(degrees)}), robot)
    (error,) = [found for found in report.findings if found.severity == "error"]
    # Half a turn of the middle wrist axis may equally be a reversed last axis: both are named.
    assert f"joint {joint} has its zero {degrees:+d}°" in error.message


def test_joint_zero_is_found_where_two_set_ups_stand_apart(campaign):
    # With one relaxed base for both set-ups, a zero 90 degrees off was said to be 92.8 degrees off.
    data, robot = campaign("kr30")
    later = np.arange(data.count) >= data.count // 2
    turn = matrix_from_rpy([0.0, 0.0, 1.2])
    points = np.where(later[:, None], data.positions_m @ turn.T + [3.0, -1.0, 0.2], data.positions_m)
    apart = dict(zip("xyz", np.ascontiguousarray(points.T), strict=True))
    seen = changed(data, **apart, station=1.0 + later)
    assert codes(check(seen, robot), "error") == []
    off = changed(seen, q3=seen.columns["q3"] - math.radians(50.0))
    (error,) = [one for one in check(off, robot).findings if one.severity == "error"]
    assert error.message.startswith("joint 3 has its zero +50")
    assert error.evidence["rms_m_if_changed"] < 0.005


@pytest.mark.full
def test_remedies_for_a_urdf_do_not_mention_robot_yaml(campaign):
    """A robot.yaml that refers to a URDF has no offsets, limits or axes."""
    data, robot = campaign("kr30")
    robot = replace(robot, urdf=Path("arm.urdf"))
    quarter = check(changed(data, q3=data.columns["q3"] - math.pi / 2), robot)
    zero = finding(quarter, "joint_zero")
    assert "'q3: {column: q3, offset: 1.570796}'" in zero.remedy
    limits = [f for f in quarter.findings if f.code == "out_of_limits"]
    turned = finding(check(changed(data, q2=-data.columns["q2"]), robot), "joint_sign")
    shuffled = np.random.default_rng(5).permutation(data.count)
    lost = check(changed(data, **{name: data.columns[name][shuffled] for name in "xyz"}), robot)
    nothing = finding(lost, "positions_do_not_follow")
    for found in (zero, turned, nothing, *limits):
        assert "robot.yaml" not in found.message + found.remedy
    assert limits
    assert all("arm.urdf" in found.remedy for found in (turned, nothing, *limits))


def test_coupling_missing_from_the_robot_file_is_found(campaign):
    data, robot = campaign("irb2400-parallelogram")
    bare = Robot({key: value for key, value in robot.spec.items() if key not in ("coupling", "linkage")})
    found = finding(check(data, bare), "coupling")
    assert "link angle 3 follows q3 − q2" in found.message
    assert "{joint: 3, driving: 2, ratio: -1.0}" in found.remedy


@pytest.mark.full
def test_coupling_of_wrong_sign_or_superfluous_is_found(campaign):
    data, robot = campaign("irb2400-parallelogram")
    wrong = Robot({**robot.spec, "coupling": [{"joint": 3, "driving": 2, "ratio": 1.0}]})
    assert "q3 − q2" in finding(check(data, wrong), "coupling").message
    data, robot = campaign("kr30")
    wrong = Robot({**robot.spec, "coupling": [{"joint": 3, "driving": 2, "ratio": 1.0}]})
    assert "its own command only" in finding(check(data, wrong), "coupling").message


def test_swapped_joint_columns_are_found(campaign):
    data, robot = campaign("kr30")
    report = check(changed(data, q4=data.columns["q5"], q5=data.columns["q4"]), robot)
    assert "q4 and q5" in finding(report, "joints_swapped").message


def test_positions_shifted_by_one_row_are_found(campaign):
    data, robot = campaign("kr30")
    late = {name: np.roll(data.columns[name], 1) for name in "xyz"}
    assert "in the row after" in finding(check(changed(data, **late), robot), "rows_shifted").message


def test_left_handed_frame_is_found(campaign):
    data, robot = campaign("kr30")
    report = check(changed(data, y=-data.columns["y"]), robot)
    assert "left_handed_frame" in codes(report, "error")


@pytest.mark.quick(
    "1000.0-units-millimetres",
    "0.001-scale-metres, read as millimetres",
    "25.4-units-these look like millimetres, read as inches",
)
@pytest.mark.parametrize(
    ("factor", "code", "word"),
    [
        (1000.0, "units", "millimetres"),
        (1 / 0.0254, "units", "inches"),
        pytest.param(1 / 0.3048, "scale", "feet", marks=pytest.mark.full),
        (
            1 / 25.4,
            "scale",
            "1/25.4 times as large as the arm's kinematics: they look like inches, read as millimetres",
        ),
        (25.4, "units", "these look like millimetres, read as inches"),
        (1e-3, "scale", "metres, read as millimetres"),
        (1.1, "scale", "robot.yaml or the instrument's scale"),
    ],
)
def test_lengths_in_another_unit_are_found(campaign, factor, code, word):
    data, robot = campaign("kr30")
    report = check(changed(data, **{name: factor * data.columns[name] for name in "xyz"}), robot)
    found = finding(report, code)
    assert codes(report, "error") == [code]
    assert word in found.message
    if "scale" in found.evidence:
        assert found.evidence["scale"] == pytest.approx(factor, rel=0.01)


def test_positions_in_feet_are_known_by_3_28_feet_to_the_metre():
    assert lengths.true_unit(3.2808) == "ft"


@pytest.mark.full
def test_wrong_joint_sign_is_found_beside_millimetres(campaign):
    data, robot = campaign("kr30")
    columns = {name: 1000.0 * data.columns[name] for name in "xyz"}
    report = check(changed(data, q2=-data.columns["q2"], **columns), robot)
    assert codes(report, "error") == ["units", "joint_sign"]


def test_wrong_joint_sign_is_found_beside_degrees(campaign):
    data, robot = campaign("kr30")
    degrees = {f"q{k}": np.degrees(data.columns[f"q{k}"]) for k in range(1, 7)}
    degrees["q3"] = -degrees["q3"]
    report = check(changed(data, **degrees), robot)
    assert {"units", "joint_sign"} <= set(codes(report, "error"))


@pytest.mark.full
def test_positions_unrelated_to_the_joints_are_an_error(campaign):
    data, robot = campaign("kr30")
    shuffled = np.random.default_rng(5).permutation(data.count)
    report = check(changed(data, **{name: data.columns[name][shuffled] for name in "xyz"}), robot)
    assert "positions_do_not_follow" in codes(report, "error")


@pytest.mark.full
def test_cause_that_leaves_a_large_error_is_not_reported(campaign):
    """With a nonlinearly distorted joint column, a wrong cause (joint 3 reversed) may leave a third of the error."""
    data, robot = campaign("kr30")
    for name, power in (("q1", 2), ("q2", 2), ("q3", 3), ("q4", 2)):
        values = data.columns[name]
        report = check(changed(data, **{name: np.abs(values) ** power * np.sign(values)}), robot)
        for found in report.findings:
            assert "inf" not in found.message.split()
            if found.severity == "error" and "rms_m_if_changed" in found.evidence:
                assert found.evidence["rms_m_if_changed"] <= 0.01 * robot.reach_m
        assert report.has_errors


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_small_arm_with_large_errors_is_warned_not_refused(tmp_path, seed):
    """Errors of 1.4 degrees in zeros, 0.9 degrees and 1.5 mm in links, at a reach of 0.3 m."""
    rng = np.random.default_rng(seed)
    rows = [
        (0.0, 0.0, 0.1),
        (0.02, -90.0, 0.0),
        (0.12, 0.0, 0.0),
        (0.02, -90.0, 0.12),
        (0, 90.0, 0),
        (0, -90.0, 0.03),
    ]
    real = [
        {
            "a": a + rng.normal(0.0, 1.5e-3),
            "alpha": math.radians(alpha + rng.normal(0.0, 0.9)),
            "d": d + rng.normal(0.0, 1.5e-3),
            "offset": math.radians(rng.normal(0.0, 1.4)),
        }
        for a, alpha, d in rows
    ]
    named = [{"a": float(a), "alpha": math.radians(alpha), "d": float(d)} for a, alpha, d in rows]
    places = {}
    for name, table in (("real", real), ("robot", named)):
        kinematics = {"convention": "mdh", "joints": [{k: float(v) for k, v in row.items()} for row in table]}
        places[name] = tmp_path / f"{name}.yaml"
        places[name].write_text(yaml.safe_dump({"name": "small", "kinematics": kinematics}))
    joints = rng.uniform(-1.0, 1.0, (120, 6)) * [2.0, 0.9, 0.9, 2.0, 1.5, 2.5]
    columns = {f"q{k}": joints[:, k - 1] for k in range(1, 7)}
    flange = flanges(columns, load_robot(places["real"]).spec)
    points = flange[:, :3, :3] @ [0.02, 0.01, 0.05] + flange[:, :3, 3] + rng.normal(0.0, 3e-5, (120, 3))
    columns |= dict(zip("xyz", points.T, strict=True))
    text = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "d.csv", text, fmt="%.9f", delimiter=",", header=",".join(columns), comments="")
    robot = load_robot(places["robot"])
    report = check(load_data(tmp_path / "d.csv", robot, strict=False), robot)
    assert codes(report, "error") == []
    found = finding(report, "far_from_nominal")
    assert found.severity == "warning"
    assert found.evidence["rms_m"] > 0.01 * robot.reach_m
    assert found.evidence["rms_m_if_fitted"] < 1e-4
    assert "after zeros and links are fitted" in found.message


def test_base_that_differs_from_the_robot_file_is_a_note(campaign):
    data, robot = campaign("kr30")
    elsewhere = Robot({**robot.spec, "base": {"xyz": [0.0, 0.0, 3.0], "rpy": [0.0, 0.0, 0.0]}})
    assert finding(check(data, elsewhere), "base_or_tool_elsewhere").severity == "note"


@pytest.mark.parametrize(
    ("rpy", "expected"),
    [
        ((0.0, math.pi / 2, 0.4), [9.81, 0.0, 0.0]),
        pytest.param((math.pi, 0.0, 0.7), [0.0, 0.0, 9.81], marks=pytest.mark.full),
    ],
)
def test_arm_on_ceiling_or_wall_without_gravity_is_a_warning(campaign, rpy, expected):
    data, robot = campaign("kr30")
    upright = matrix_from_rpy(robot.spec["base"]["rpy"])
    turned = data.positions_m @ (matrix_from_rpy(rpy) @ upright.T).T
    hanging = changed(data, **{name: np.ascontiguousarray(turned[:, at]) for at, name in enumerate("xyz")})
    silent = replace(robot, gravity_stated=False)
    found = finding(check(hanging, silent), "gravity_not_given")
    assert found.severity == "warning"
    np.testing.assert_allclose(found.evidence["gravity"], expected, atol=0.2)
    assert f"gravity: {found.evidence['gravity']}" in found.remedy
    assert "gravity_not_given" not in codes(check(data, silent))
    assert "gravity_not_given" not in codes(check(hanging, robot))
    massless = {key: value for key, value in silent.spec.items() if key != "links"}
    assert "gravity_not_given" not in codes(check(hanging, replace(silent, spec=massless)))


def test_gravity_that_points_upwards_is_a_warning(campaign):
    # With the wrong sign of gravity, joint compliance was diagnosed as other effects.
    data, robot = campaign("kr30")
    lifting = replace(robot, spec={**robot.spec, "gravity": [0.0, 0.0, 9.81]}, gravity_stated=True)
    assert "gravity_upwards" not in codes(check(data, robot))
    found = finding(check(data, lifting), "gravity_upwards")
    assert found.severity == "warning"
    assert "'gravity: [0.0, 0.0, -9.81]'" in found.remedy


@pytest.mark.parametrize(("factor", "warned"), [(1.0, False), (1000.0, True)])
def test_payload_heavier_than_the_arm_is_a_warning(campaign, factor, warned):
    data, robot = campaign("kr30")
    payload = np.full(data.count, 8.0 * factor)
    report = check(changed(data, payload=payload), robot)
    assert ("payload" in codes(report, "warning")) == warned
    if warned:
        assert "found 8000 kg" in finding(report, "payload").message
        assert "grams" in finding(report, "payload").message


@pytest.mark.parametrize(("sigma", "warned"), [(15e-6, False), (60e-6, False), (0.015, True)])
def test_sigma_far_above_the_measured_scatter_is_a_warning(campaign, sigma, warned):
    data, robot = campaign("kr30")
    report = check(changed(data, sigma=np.full(data.count, sigma)), robot)
    assert ("sigma_too_large" in codes(report, "warning")) == warned
    if warned:
        assert "found 15000.0 µm" in finding(report, "sigma_too_large").message


def test_thermometer_that_was_off_is_reported_with_its_rows(campaign):
    data, robot = campaign("kr30")
    assert "temperature_off" not in codes(check(data, robot))
    read = data.columns["temp_arm"].copy()
    read[[3, 40, 41]] = 85.0
    found = finding(check(changed(data, temp_arm=read), robot), "temperature_off")
    assert found.evidence["rows"] == data.rows[[3, 40, 41]].tolist()
    assert "found 85.0 °C in rows 5, 42, 43" in found.message
    # A column with just two temperatures, written down by hand, is no fault.
    written = np.where(np.arange(data.count) < 50, 20.0, 35.0)
    assert not {"temperature_off", "temperature_unit"} & {
        *codes(check(changed(data, temp_arm=written), robot))
    }


def test_temperatures_in_fahrenheit_are_found(campaign):
    data, robot = campaign("kr30")
    hot = changed(data, temp_arm=32.0 + 1.8 * data.columns["temp_arm"])
    assert "(this looks like Fahrenheit)" in finding(check(hot, robot), "temperature_unit").message


def test_gross_errors_are_reported_with_their_rows(campaign):
    data, robot = campaign("kr30")
    x = data.columns["x"].copy()
    x[[7, 30]] += [0.05, -0.08]
    found = finding(check(changed(data, x=x), robot), "gross_errors")
    assert found.evidence["rows"] == [9, 32]
    assert "rows 9, 32" in found.message


def test_joint_still_moving_at_readback_is_found(campaign):
    data, robot = campaign("kr30")
    moving = {f"qr{k}": data.columns[f"q{k}"] for k in range(1, 7)}
    moving["qr2"] = moving["qr2"] + 1e-4 * np.sin(np.arange(data.count))
    found = finding(check(changed(data, **moving), robot), "not_settled")
    assert "joint 2" in found.message
    assert "command_readback" in found.remedy


@pytest.mark.full
def test_joints_that_never_or_hardly_move_are_found(campaign):
    data, robot = campaign("kr30")
    kept = np.full(data.count, 0.3)
    report = check(changed(data, q6=kept, q1=0.05 * data.columns["q1"]), robot)
    still = finding(report, "joint_never_moves")
    assert still.evidence["joint"] == 6
    assert "give it 'passive: true' in robot.yaml" in still.remedy
    assert finding(report, "joint_hardly_moves").evidence["joint"] == 1


def test_pose_beyond_joint_limits_is_found(campaign):
    data, robot = campaign("kr30")
    q2 = data.columns["q2"].copy()
    q2[4] = robot.joints[1]["limits"][1] + 0.2
    found = finding(check(changed(data, q2=q2), robot), "out_of_limits")
    assert found.evidence["rows"] == [6]
    assert "11.46°" in found.message


def test_copied_rows_and_stale_positions_are_found(campaign):
    data, robot = campaign("kr30")
    copied = {name: values.copy() for name, values in data.columns.items()}
    for values in copied.values():
        values[10] = values[3]
    assert finding(check(replace(data, columns=copied), robot), "duplicate_rows").evidence["rows"] == [5, 12]
    stale = {name: data.columns[name].copy() for name in "xyz"}
    for values in stale.values():
        values[20] = values[19]
    assert finding(check(changed(data, **stale), robot), "stale_position").evidence["rows"] == [22]


@pytest.mark.parametrize("every", [1, 2, 50])
def test_zero_positions_are_reported_as_a_lost_reflector(campaign, every):
    # Zeros once gave "column nan is missing", "positions do not follow", or "the instrument repeated its last reading".
    data, robot = campaign("kr30")
    zeros = {name: np.where(np.arange(data.count) % every == 0, 0.0, data.columns[name]) for name in "xyz"}
    report = check(changed(data, **zeros), robot)
    found = finding(report, "no_position")
    assert found.evidence["rows"] == data.rows[::every].tolist()
    assert "lost its reflector" in found.message
    assert [f.code for f in report.findings if f.severity == "error"] == ["no_position"]
    assert not {"duplicate_rows", "stale_position", "no_fit"} & set(codes(report))


def test_coordinate_that_is_zero_in_all_rows_is_named(campaign):
    data, robot = campaign("kr30")
    report = check(changed(data, z=np.zeros(data.count)), robot)
    assert finding(report, "no_position").message == "z is 0 in all rows: nothing was measured there"
    assert [f.code for f in report.findings if f.severity == "error"] == ["no_position"]


def test_missing_repeat_column_is_noted_and_a_wrong_one_refused(campaign):
    data, robot = campaign("kr30")
    without = replace(data, columns={name: v for name, v in data.columns.items() if name != "repeat"})
    said = re.search(r"scatter by (\S+) µm", finding(check(without, robot), "repeated_poses").message)
    assert 3.0 < float(said[1]) < 50.0, "a tracker's noise, and what load and warmth add"
    repeat = data.columns["repeat"].copy()
    repeat[5] = repeat[50]
    assert finding(check(changed(data, repeat=repeat), robot), "repeat_differs").severity == "error"


def test_time_that_goes_back_is_found(campaign):
    data, robot = campaign("kr30")
    time = data.columns["time"].copy()
    time[8] -= 1000.0
    assert finding(check(changed(data, time=time), robot), "time_goes_back").evidence["rows"] == [10]


@pytest.mark.parametrize(("drift_m", "code"), [(80e-6, "base_drift"), (0.0, "fixed_reflector")])
def test_drifting_fixed_reflector_is_told_from_a_steady_one(campaign, drift_m, code):
    data, robot = campaign("kr30")
    columns = {name: values.copy() for name, values in data.columns.items()}
    fixed = np.arange(0, data.count, 10)
    columns["target"] = np.zeros(data.count)
    columns["target"][fixed] = 1.0
    noise = np.random.default_rng(2).normal(0.0, 5e-6, (3, fixed.size))
    moved = drift_m * columns["time"][fixed] / columns["time"].max()
    for axis, (name, place) in enumerate(zip("xyz", (2.0, 1.0, 0.5), strict=True)):
        columns[name][fixed] = place + noise[axis] + (moved if name == "x" else 0.0)
    report = check(replace(data, columns=columns, labels={"target": ["arm", "floor"]}), robot)
    assert "'floor'" in finding(report, code).message
    assert codes(report, "error") == []


def rows_of(data: Dataset, chosen: np.ndarray) -> Dataset:
    columns = {name: values[chosen] for name, values in data.columns.items()}
    return replace(data, columns=columns, rows=data.rows[chosen])


@pytest.mark.parametrize(
    ("chosen", "words"),
    [(np.arange(9), "found 9 different poses"), (np.zeros(40, int), "found 1 different pose,")],
)
def test_too_few_poses_are_an_error(campaign, chosen, words):
    data, robot = campaign("kr30")
    assert words in finding(check(rows_of(data, chosen), robot), "too_few_poses").message


def test_effects_that_the_data_cannot_determine_are_listed(campaign):
    data, robot = campaign("kr30")
    without = replace(data, columns={name: v for name, v in data.columns.items() if name != "temp_arm"})
    narrow = rows_of(without, np.flatnonzero(np.abs(data.columns["q1"]) < 0.6))
    report = check(narrow, robot)
    assert "joint 1" in finding(report, "coverage").message
    untestable = {found.evidence["effect"]: found for found in report.findings if found.code == "untestable"}
    assert "temp_" in untestable["thermal_expansion"].message
    assert "qr1" in untestable["command_readback"].message
    assert "gear_harmonics" not in untestable
    assert all("by these poses" in found.message for found in report.findings if found.code == "cannot_tell")


def test_report_counts_findings_and_sorts_them_by_severity(campaign):
    data, robot = campaign("kr30")
    report = check(changed(data, q2=-data.columns["q2"], q6=np.zeros(data.count)), robot)
    severities = [found.severity for found in report.findings]
    assert severities == sorted(severities, key=["error", "warning", "note"].index)
    assert report.has_errors
    assert report.summary().startswith("1 error, ")
    assert report.document()["ok"] is False
