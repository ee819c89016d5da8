"""Checks that need only the joints and the order of rows: limits, standstill, read-back, repeats, stale readings."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armtrue.checking.report import Finding
from armtrue.checking.scatter.repeats import joint_keys, pose_of_row, scatter_m, state_keys
from armtrue.checking.scatter.rounding import position_step_m
from armtrue.io.dataset import Dataset
from armtrue.io.robot import Robot
from armtrue.units import plural

_STILL_RAD = 1e-4
_NARROW_RAD = math.radians(20.0)
# A read-back that differs from the command by more than this at the tool shows in a fit [m].
_READBACK_AT_TOOL_M = 20e-6
_ROWS_NAMED = 8
# A restarted clock goes back in fewer than this share of the rows, each time to less than this share of its last time.
_MOST_SESSIONS = 0.1
_AGAIN = 0.05


def find(data: Dataset, robot: Robot) -> list[Finding]:
    """Findings that need no kinematics."""
    measured = data.take(~data.lost)
    return [
        *_out_of_limits(data, robot),
        *_standstill(data, robot),
        *_read_back(data, robot),
        *(_repeats(measured) if measured.count else []),
        *_lost_positions(data),
        *_stale_positions(measured),
        *_order_of_time(data),
    ]


def name_rows(data: Dataset, which: NDArray[np.bool_]) -> str:
    """`row 17` or `rows 17, 20, … (12 in all)` of the entries marked in `which`."""
    rows = [str(row) for row in data.rows[which]]
    if len(rows) == 1:
        return f"row {rows[0]}"
    if len(rows) <= _ROWS_NAMED:
        return f"rows {', '.join(rows)}"
    return f"rows {', '.join(rows[:_ROWS_NAMED])}, … ({len(rows)} in all)"


def _out_of_limits(data: Dataset, robot: Robot) -> Iterator[Finding]:
    for k, joint in enumerate(robot.joints, start=1):
        if "limits" not in joint:
            continue
        lo, hi = joint["limits"]
        # The limits of a passive joint apply to the angle that the couplings give it.
        passive = k in robot.passive
        values = data.joints @ robot.mechanical_coupling[k - 1] if passive else data.columns[f"q{k}"]
        # A thousandth of the range: limits in robot files are rounded.
        slack = 1e-3 * (hi - lo)
        outside = (values < lo - slack) | (values > hi + slack)
        if outside.any():
            furthest = float(np.max(np.maximum(lo - values, values - hi)))
            done = "turned" if passive else "commanded"
            yield Finding(
                "out_of_limits",
                "warning",
                f"joint {k} is {done} beyond its limits by up to {_amount(furthest, joint)}: "
                f"{name_rows(data, outside)}",
                {"joint": k, "rows": data.rows[outside].tolist(), "limits": [lo, hi], "beyond": furthest},
                f"Correct the limits of joint {k} in {robot.kinematics_file}, or look for a wrong sign, offset "
                "or unit.",
            )


def _amount(value: float, joint: dict[str, object]) -> str:
    return f"{math.degrees(value):.2f}°" if joint["type"] == "revolute" else f"{value * 1000:.2f} mm"


def _standstill(data: Dataset, robot: Robot) -> Iterator[Finding]:
    for k, joint in enumerate(robot.joints, start=1):
        if k in robot.passive:
            continue
        span = float(np.ptp(data.columns[f"q{k}"]))
        evidence = {"joint": k, "range": span}
        if span < _STILL_RAD:
            yield Finding(
                "joint_never_moves",
                "warning",
                f"joint {k} never moves: its axis and its effects cannot be determined from these data",
                evidence,
                f"Measure poses that turn joint {k}; until then a fit holds it at its nominal values. If it has "
                "no motor, as where bars keep a flange level, give it 'passive: true' in robot.yaml and state under "
                "'coupling' which joints turn it: it is then never corrected.",
            )
        elif joint["type"] == "revolute" and span < _NARROW_RAD:
            yield Finding(
                "joint_hardly_moves",
                "note",
                f"joint {k} moves by {math.degrees(span):.1f}° only: its axis is poorly determined outside that range",
                evidence,
                f"Measure poses that turn joint {k} further.",
            )


def _read_back(data: Dataset, robot: Robot) -> Iterator[Finding]:
    worst: tuple[float, int] = (0.0, 0)
    evidence: dict[str, float] = {}
    for k, joint in enumerate(robot.joints, start=1):
        if f"qr{k}" not in data.columns:
            continue
        difference = data.columns[f"q{k}"] - data.columns[f"qr{k}"]
        rms = float(np.sqrt(np.mean(difference**2)))
        evidence[f"joint {k} rms"] = rms
        at_tool = rms * (robot.reach_m if joint["type"] == "revolute" else 1.0)
        worst = max(worst, (at_tool, k))
    if not evidence or worst[0] < _READBACK_AT_TOOL_M:
        return
    yield Finding(
        "not_settled",
        "warning",
        f"joints as read back differ from the command, most on joint {worst[1]}: up to "
        f"{worst[0] * 1e6:.0f} µm RMS at full reach, as if they had been read before the arm had settled",
        evidence,
        "Fit the commanded joints, and add the effect command_readback to see which of the two the arm followed.",
    )


def _repeats(data: Dataset) -> Iterator[Finding]:
    pose = pose_of_row(data)
    sizes = np.bincount(pose)
    again = sizes[pose] > 1
    if "repeat" in data.columns:
        yield from _repeats_that_differ(data)
    elif again.any():
        scatter = ""
        if data.has_positions:
            scatter = f" (they scatter by {scatter_m(data.positions_m[again], pose[again]) * 1e6:.1f} µm)"
        count = int((sizes > 1).sum())
        several = f"{plural(count, 'pose')} {'is' if count == 1 else 'are'}"
        yield Finding(
            "repeated_poses",
            "note",
            f"{several} measured more than once{scatter}, and there is no column 'repeat'",
            {"rows": data.rows[again].tolist()},
            "Add a column 'repeat' with the same id for the same pose: the noise floor is estimated from repeats.",
        )
    if data.has_positions:
        # Rounding can give readings of one pose the same position: then only rows equal in every column are copies.
        is_rounded = position_step_m(data) > 0.0
        others = [data.columns[name] for name in sorted(data.columns)] if is_rounded else []
        # A reading copied to another load is a copy: the point of another load is never the same to the nanometre.
        keys = [joint_keys(data), state_keys(data, "payload")]
        whole = np.column_stack([*keys, np.round(data.positions_m / 1e-9).astype(np.int64), *others])
        _, row_of, counts = np.unique(whole, axis=0, return_inverse=True, return_counts=True)
        copies = counts[row_of] > 1
        if copies.any():
            same = "the same joints and the same position to the nanometre"
            if is_rounded:
                same = "rows equal in every column"
            yield Finding(
                "duplicate_rows",
                "warning",
                f"{same} occur more than once: {name_rows(data, copies)}",
                {"rows": data.rows[copies].tolist()},
                "Remove the copies. A fit leaves out those that are equal in every column; others count as "
                "independent measurements and make its standard deviations too small.",
            )


def _repeats_that_differ(data: Dataset) -> Iterator[Finding]:
    codes = data.columns["repeat"].astype(np.int64)
    first_row = np.zeros(int(codes.max()) + 1, dtype=np.int64)
    seen, first = np.unique(codes, return_index=True)
    first_row[seen] = first
    apart = np.abs(data.joints - data.joints[first_row[codes]]).max(axis=1)
    differ = apart > 1e-3
    if differ.any():
        yield Finding(
            "repeat_differs",
            "error",
            f"rows with the same 'repeat' have different joints, by up to {math.degrees(float(apart.max())):.2f}°: "
            f"{name_rows(data, differ)}",
            {"rows": data.rows[differ].tolist(), "apart": float(apart.max())},
            "Give each pose an id of its own in the column 'repeat'.",
        )


def _lost_positions(data: Dataset) -> Iterator[Finding]:
    """Rows without a position, or a coordinate that no row has."""
    if not data.has_positions:
        return
    evidence: dict[str, object]
    lost, never = data.lost, [name for name in "xyz" if not data.columns[name].any()]
    if lost.any():
        which = "all rows" if lost.all() else name_rows(data, lost)
        message = f"x, y and z are 0, as an instrument writes when it has lost its reflector: {which}"
        evidence = {"rows": data.rows[lost].tolist()}
        remedy = "Measure them." if lost.all() else "Remove these rows (--skip-bad leaves them out)."
    elif never:
        are = "is" if len(never) == 1 else "are"
        message = f"{' and '.join(never)} {are} 0 in all rows: nothing was measured there"
        evidence, remedy = {"columns": never}, "Record x, y and z of every pose."
    else:
        return
    yield Finding("no_position", "error", message, evidence, remedy)


def _stale_positions(data: Dataset) -> Iterator[Finding]:
    if not data.has_positions or data.count < 2:
        return
    same_place = np.abs(np.diff(data.positions_m, axis=0)).max(axis=1) < 1e-9
    moved = np.abs(np.diff(data.joints, axis=0)).max(axis=1) > 1e-3
    if "target" in data.columns:
        moved &= np.diff(data.columns["target"]) == 0
    stale = np.concatenate([[False], same_place & moved])
    if stale.any():
        yield Finding(
            "stale_position",
            "error",
            f"the position is that of the row before to the nanometre although the arm moved: {name_rows(data, stale)}",
            {"rows": data.rows[stale].tolist()},
            "Remove these rows: the instrument repeated its last reading.",
        )


def _order_of_time(data: Dataset) -> Iterator[Finding]:
    if "time" not in data.columns or data.count < 2:
        return
    time = data.columns["time"]
    back = np.concatenate([[False], np.diff(time) < 0.0])
    if not back.any():
        return
    since = time - time.min()
    before, after = np.concatenate([[0.0], since[:-1]]), np.append(since[1:], 0.0)
    evidence = {"rows": data.rows[back].tolist()}
    begins = (since < _AGAIN * before) & (after < before)
    if np.mean(back) < _MOST_SESSIONS and begins[back].all():
        yield Finding(
            "time_begins_again",
            "warning",
            f"time restarts at {name_rows(data, back)}, as if each session had its own clock",
            evidence,
            "Add to the times of each session the time at which it began. Otherwise the sessions overlap, and drift "
            "and the travel of the joints, which follow from the order in time, come out wrong.",
        )
        return
    yield Finding(
        "time_goes_back",
        "warning",
        f"time goes back at {name_rows(data, back)}",
        evidence,
        "Put the rows in order of time (dataset.yaml: 'sort_by: time'), or correct the clock.",
    )
