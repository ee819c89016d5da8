"""Notes of `compensate` on poses that miss their target, and the remaining error of each row."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armtrue import _core
from armtrue.tables import ExportOptions, export, fitted_arm
from armtrue.tables.compensate import Compensated, Engine, Remainder, compensate, sidecar
from armtrue.tables.conftest import document

SHORTER = [("link2.tx", "1", -3e-3), ("motor2", "1", 2e-3)]


def compensated(
    folder: Path, fit: dict[str, Any], joints: np.ndarray, engine: Engine, **options: Any
) -> Compensated:
    """`joints` corrected by the table of `fit`."""
    fit["robot"]["temperature"] = {}
    tables, poses = folder / "t.bin", folder / "poses.csv"
    tables.write_bytes(export(fitted_arm(fit, "fit"), ExportOptions(**options)).image)
    sidecar(tables).write_text(json.dumps(fit))
    names = ",".join(f"q{k + 1}" for k in range(joints.shape[1]))
    np.savetxt(poses, joints, delimiter=",", header=names, comments="")
    return compensate(tables, poses, engine)


@pytest.mark.parametrize("engine", list(Engine))
def test_arm_of_two_axes_gets_a_note_that_it_has_too_few(tmp_path: Path, engine: Engine) -> None:
    fit = document([("link2.tx", "1", -3e-3)])
    fit["robot"]["kinematics"]["joints"].pop()
    fit["robot"]["links"] = []
    joints = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 2))
    note = compensated(tmp_path, fit, joints, engine).notes[0]
    assert note.startswith("20 of 20 poses ")
    assert note.endswith("the arm's 2 axes set only 2 of the 3 coordinates of the tool's position")


@pytest.mark.parametrize("engine", list(Engine))
def test_arm_of_three_axes_gets_a_note_on_its_attitude(tmp_path: Path, engine: Engine) -> None:
    joints = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
    note = compensated(tmp_path, document(SHORTER), joints, engine, full_pose=True).notes[0]
    assert note.endswith(
        "the arm's 3 axes set only 3 of the 6 coordinates of the tool's position and attitude"
    )


def test_double_engine_counts_poses_that_miss_their_target(tmp_path: Path) -> None:
    """With the elbow stretched, the arm is 3 mm too short for the point."""
    joints = np.zeros((5, 3))
    joints[:, 2] = [1.0, -0.322, -0.321, -0.320, -1.0]
    result = compensated(tmp_path, document(SHORTER), joints, Engine.DOUBLE)
    (note,) = result.notes
    assert note.startswith("3 of 5 poses do not reach their target, up to ")
    assert note.endswith(" are left: they are close to a singularity or at the end of the reach")
    assert np.abs(result.joints - joints).max() < 0.32


def test_double_engine_has_no_note_if_all_targets_are_reached(tmp_path: Path) -> None:
    joints = np.array([[0.1, 0.2, 1.0], [0.5, -0.2, 1.2]])
    assert compensated(tmp_path, document(SHORTER), joints, Engine.DOUBLE).notes == []


@pytest.mark.parametrize("sends_third", [True, False])
def test_passive_joint_keeps_its_column_as_commanded_or_has_none(tmp_path: Path, sends_third: bool) -> None:
    """Joint 3 has no motor: bars turn it back by the angle of joint 2, and controllers may write that angle."""
    fit = document([("motor2", "1", 2e-3)], coupling=[{"joint": 3, "driving": 2, "ratio": -1.0}])
    fit["robot"]["kinematics"]["joints"][2]["passive"] = True
    joints = np.array([[0.1, 0.2, -0.2], [0.5, -0.4, 0.4]])
    names = ["q1", "q2", "q3"] if sends_third else ["q1", "q2"]
    sent = compensated(tmp_path, fit, joints[:, : len(names)], Engine.FIXED).columns()
    assert list(sent) == names
    assert np.abs(sent["q2"] - joints[:, 1]).min() > 1e-3
    assert not sends_third or sent["q3"].tolist() == joints[:, 2].tolist()


def off_by_the_fitter(
    fit: dict[str, Any], joints: np.ndarray, intended: np.ndarray, more: dict[str, np.ndarray] | None = None
) -> np.ndarray:
    """Distance [µm] from `intended` to where the fitter, which shares no code with the tables, puts the tool.

    `more`: columns besides the joints.
    """
    columns = {f"q{k + 1}": np.ascontiguousarray(joints[:, k]) for k in range(joints.shape[1])} | (more or {})
    return 1e6 * np.linalg.norm(np.asarray(_core.predict(json.dumps(fit), columns)) - intended, axis=1)


STRETCHED = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -0.322], [0.0, 0.0, -0.321], [0.5, 0.0, -0.8]])


@pytest.mark.parametrize("engine", list(Engine))
def test_remaining_error_of_each_row_matches_the_fitter(tmp_path: Path, engine: Engine) -> None:
    """In two rows the elbow is stretched: the arm is 3 mm too short for the point, whatever the engine."""
    fit = document(SHORTER)
    result = compensated(tmp_path, fit, STRETCHED, engine)
    kept = result.remainder
    assert kept is not None
    assert np.abs(kept.left_um - off_by_the_fitter(fit, result.joints, result.intended)).max() < 0.01
    assert np.abs(kept.uncorrected_um - off_by_the_fitter(fit, STRETCHED, result.intended)).max() < 0.01
    assert (kept.left_um[[1, 2]] > 1000.0).all()
    assert (kept.left_um[[0, 3]] < 20.0).all()
    assert kept.rows.tolist() == [2, 3, 4, 5]


def test_fixed_engine_names_the_row_of_largest_remaining_error(tmp_path: Path) -> None:
    result = compensated(tmp_path, document(SHORTER), STRETCHED, Engine.FIXED)
    kept = result.remainder
    assert kept is not None
    farthest = int(np.argmax(kept.left_um))
    note = result.notes[-1]
    assert note.startswith("2 of 4 rows keep more than 20 µm and 5 % of their error, by the fit: ")
    assert (
        f"at most {kept.left_um[farthest]:.1f} µm of {kept.uncorrected_um[farthest]:.1f} µm, in row " in note
    )
    assert f"in row {farthest + 2};" in note


def test_fixed_engine_has_no_note_on_small_remaining_errors(tmp_path: Path) -> None:
    result = compensated(tmp_path, document(SHORTER), STRETCHED[[0, 3]], Engine.FIXED)
    assert result.notes == []
    assert result.remainder is not None
    assert 0.0 <= result.remainder.left_um.max() < 20.0


def test_remaining_error_includes_rounding_to_increments(tmp_path: Path) -> None:
    joints = STRETCHED[[0, 3]]
    compensated(tmp_path, document(SHORTER), joints, Engine.FIXED, increments=(1000.0,))
    rounded = compensate(tmp_path / "t.bin", tmp_path / "poses.csv", Engine.FIXED, quantise=True)
    assert rounded.remainder is not None
    assert rounded.remainder.left_um.max() > 100.0


def test_remaining_error_uses_the_tool_of_each_row(tmp_path: Path) -> None:
    fit = document(SHORTER)
    fit["flange_from_tool"] = {
        "near": {"xyz": [0.1, 0.0, 0.1], "rpy": [0.0, 0.0, 0.0]},
        "far": {"xyz": [0.5, 0.2, 0.1], "rpy": [0.0, 0.0, 0.0]},
    }
    compensated(tmp_path, fit, np.zeros((1, 3)), Engine.FIXED)
    lines = ["q1,q2,q3,target", "0,0,1,far", "0.5,0,-0.8,near", "0.2,0,-0.8,far", "0.2,0.1,0.9,near"]
    (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n")
    kept = compensate(tmp_path / "t.bin", tmp_path / "poses.csv", Engine.FIXED).remainder
    assert kept is not None
    assert (kept.left_um < 20.0).all()
    assert (kept.uncorrected_um > 1000.0).all()


@pytest.mark.parametrize("spoil", ["missing", "of another fit", "damaged"])
def test_remaining_error_is_unknown_without_the_tables_fit(tmp_path: Path, spoil: str) -> None:
    compensated(tmp_path, document(SHORTER), STRETCHED, Engine.FIXED)
    beside = sidecar(tmp_path / "t.bin")
    if spoil == "missing":
        beside.unlink()
    else:
        beside.write_text(json.dumps(document([])) if spoil == "of another fit" else "{")
    result = compensate(tmp_path / "t.bin", tmp_path / "poses.csv", Engine.FIXED)
    assert result.remainder is None
    assert result.notes[-1] == (
        "how far rows stay from their points is not known: t.bin.fit.json is not the fit that t.bin was made from; "
        "--fit names another file"
    )


def test_row_for_which_the_fit_has_no_value_has_no_figure(tmp_path: Path) -> None:
    """Beyond the limits of joint 1 the table holds its last value of log(q1 + 5), and the model has none."""
    joints = np.array([[0.1, 0.2, 1.0], [-5.5, 0.2, 1.0]])
    result = compensated(tmp_path, document([("motor2", "log(q1 + 5)", 1e-4)]), joints, Engine.FIXED)
    assert result.remainder is not None
    figures = result.remainder.figures()
    assert figures["rows_um"][1] is None
    assert figures["max_row"] == 2
    assert figures["mean_um"] == figures["max_um"] == figures["rows_um"][0]
    json.dumps(figures, allow_nan=False)


@pytest.mark.parametrize(
    ("left_um", "uncorrected_um", "is_told"),
    [
        (20.0, 30.0, False),
        (20.1, 30.0, True),
        (49.0, 1000.0, False),
        (51.0, 1000.0, True),
        (30.0, 10.0, True),
    ],
)
def test_remaining_error_is_noted_above_20_um_and_5_percent(
    left_um: float, uncorrected_um: float, is_told: bool
) -> None:
    """The other row keeps more, but only a small part of a large error."""
    kept = Remainder(np.array([2, 3]), np.array([400.0, left_um]), np.array([9000.0, uncorrected_um]))
    words = kept.words()
    assert bool(words) is is_told
    if is_told:
        assert words.startswith(
            "1 of 2 rows keep more than 20 µm and 5 % of their error, by the fit: at most "
        )
        assert f"{left_um:.1f} µm of {uncorrected_um:.1f} µm, in row 3; " in words


def test_rows_worse_than_uncorrected_are_counted() -> None:
    kept = Remainder(np.array([2, 3, 4]), np.array([1.0, 900.0, 400.0]), np.array([5.0, 300.0, 500.0]))
    assert kept.words() == (
        "2 of 3 rows keep more than 20 µm and 5 % of their error, by the fit: at most 900.0 µm of 300.0 µm, in row 3; "
        "1 of them is farther off than uncorrected; all rows 433.7 µm on average"
    )


@pytest.mark.quick("exp(-q1*q1)")
@pytest.mark.parametrize("text", ["exp(-q1*q1)", "exp(-(q1-1)*(q1-1))", "exp(-q1*q1*q1*q1)"])
def test_bell_curve_is_corrected_equally_by_both_engines(tmp_path: Path, text: str) -> None:
    """The limits are so wide that the exponent falls to -71 and below, where the curve is zero."""
    fit = document([("motor1", text, 5e-3), ("motor3", text, -2e-3)])
    for joint in fit["robot"]["kinematics"]["joints"]:
        joint["limits"] = [-7.0, 7.0]
    joints = np.random.default_rng(1).uniform([-7.0, -0.3, 0.3], [7.0, 1.0, 1.2], (500, 3))
    fixed, double = (compensated(tmp_path, fit, joints, engine) for engine in (Engine.FIXED, Engine.DOUBLE))
    assert fixed.remainder is not None
    assert fixed.remainder.uncorrected_um.max() > 1000.0
    assert fixed.remainder.left_um.max() < 0.1
    assert np.abs(fixed.joints - double.joints).max() < 1e-6


UNIX_S = 1795939200.0  # a session's first row on a clock of seconds since 1970


def warming() -> dict[str, Any]:
    """A fit of an arm that warms up over half an hour, measured for an hour by a clock of Unix seconds."""
    fit = document(
        [("link2.tx", "1 - exp(-max(time, 0)/1800)", -3e-3), ("motor2", "1 - exp(-max(time, 0)/1800)", 2e-3)]
    )
    for parameter in fit["parameters"]:
        parameter["effect"] = "warm_up"
    fit["robot"]["temperature"] = {}
    return {**fit, "time_origin_s": UNIX_S, "data": {"ranges": {"time": [UNIX_S, UNIX_S + 3600.0]}}}


BENT = np.tile([0.1, 0.2, 1.0], (4, 1)) + 0.1 * np.arange(4)[:, None]


def at_times(folder: Path, times: list[float], engine: Engine = Engine.FIXED) -> Compensated:
    """Bent poses, one a time of `times` [s], corrected by the table of the arm that warms up."""
    compensated(folder, warming(), BENT, engine)
    rows = np.column_stack([BENT[: len(times)], times])
    header = "q1,q2,q3,time"
    np.savetxt(folder / "poses.csv", rows, delimiter=",", header=header, comments="", fmt="%.9f")
    return compensate(folder / "t.bin", folder / "poses.csv", engine)


@pytest.mark.parametrize("engine", list(Engine))
def test_time_of_poses_is_on_the_clock_of_the_fitted_measurements(tmp_path: Path, engine: Engine) -> None:
    """predict puts the corrected arm at the intended points; uncorrected, it misses them by more every minute."""
    times = [UNIX_S + seconds for seconds in (0.0, 300.0, 1500.0, 3600.0)]
    result = at_times(tmp_path, times, engine)
    clock = {"time": np.array(times)}
    assert off_by_the_fitter(warming(), result.joints, result.intended, clock).max() < 0.5
    assert (np.diff(off_by_the_fitter(warming(), BENT, result.intended, clock)) > 100.0).all()
    assert result.notes == []


@pytest.mark.parametrize("engine", list(Engine))
def test_poses_before_the_first_fitted_row_are_taken_as_at_the_start(tmp_path: Path, engine: Engine) -> None:
    times = [UNIX_S - 604800.0, UNIX_S - 3600.0, UNIX_S, UNIX_S + 60.0]
    result = at_times(tmp_path, times, engine)
    clock = {"time": np.array(times)}
    assert off_by_the_fitter(warming(), result.joints, result.intended, clock).max() < 0.5
    assert np.abs(result.joints[:3] - BENT[:3]).max() < 1e-7
    assert result.notes == [
        "2 of 4 poses are up to 168.0 h before the first fitted measurement by time, on the clock of the fitted "
        "measurements: corrected as at that measurement"
    ]


def test_poses_after_the_last_fitted_row_are_counted(tmp_path: Path) -> None:
    result = at_times(tmp_path, [UNIX_S, UNIX_S + 3600.0, UNIX_S + 3900.0])
    assert result.notes == [
        "1 of 3 poses is up to 300 s after the last fitted measurement by time: corrections there are extrapolated"
    ]


@pytest.mark.parametrize("times", [[0.0, 600.0], [UNIX_S, UNIX_S + 600.0]])
def test_without_the_fit_time_counts_from_the_first_fitted_row(tmp_path: Path, times: list[float]) -> None:
    at_times(tmp_path, times)
    sidecar(tmp_path / "t.bin").unlink()
    notes = compensate(tmp_path / "t.bin", tmp_path / "poses.csv").notes
    assert notes[0] == (
        "poses.csv has time, and the table does not know when its first fitted measurement was: time is read as "
        "seconds since then; with the fit (--fit), it is read on the clock of the fitted measurements"
    )
    assert ("2 of 2 poses with an input beyond the range of the format" in notes) is (times[0] > 0.0)
