"""Columns whose figures are impossible in the expected unit."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from armtrue.checking import lengths
from armtrue.checking.alignment import Columns, alignment_columns
from armtrue.checking.report import Finding
from armtrue.io.columns import POSITION
from armtrue.io.dataset import Dataset, without_fixed_targets
from armtrue.io.plausible import too_few_poses, wrong_units
from armtrue.io.robot import Robot

# Between two readings, measured arms rest for less than this [s], and no joint turns this fast [rad/s]: the wrist of a
# small arm reaches 17.
_LONGEST_REST_S = 1800.0
_FASTEST_RAD_S = 50.0
# The time per pose is the median interval between readings between which a joint moved by more than this [rad], if
# there are at least this many.
_MOVED_RAD = 0.05
_FEWEST_MOVES = 8
# Limits in robot files are rounded, and not always those of the controller.
_MOST_TRAVEL = 1.1
_LIKELY = re.compile(r"\(these look like .*\)")


def find(data: Dataset, robot: Robot) -> Iterator[Finding]:
    """One error for each column whose unit must be wrong, and warnings on units that are probably wrong."""
    yield from _impossible(data, robot)
    yield from find_time(data, robot)
    yield from find_travel(data, robot)
    yield from find_ratios(robot)


def _impossible(data: Dataset, robot: Robot) -> Iterator[Finding]:
    for name, at, expected in wrong_units(data.columns, robot):
        evidence = {"column": name, "row": int(data.rows[at]), "found": float(data.columns[name][at])}
        if name in POSITION and (scale := _scale(data, robot)):
            # The alignment with the arm gives the scale more reliably than the size of the values.
            expected = _LIKELY.sub(f"(these look like {lengths.words_of_points(scale)})", expected)
            evidence |= {"scale": scale, "unit": lengths.unit_of_points(scale, robot)}
        yield Finding(
            "units",
            "error",
            f"column {name} row {data.rows[at]}: found {data.columns[name][at]:.6g}, expected {expected}",
            evidence,
            "Give the column's unit in a dataset.yaml ('armtrue init' writes one, and guesses the units of joints "
            "and points), or write the file in SI units.",
        )


def find_time(data: Dataset, robot: Robot) -> Iterator[Finding]:
    """A warning if poses follow one another too slowly or too fast for times in seconds."""
    turning = [k for k, joint in enumerate(robot.joints) if joint["type"] == "revolute"]
    if "time" not in data.columns or not turning:
        return
    order = np.argsort(data.columns["time"], kind="stable")
    took = np.diff(data.columns["time"][order])
    turned = np.abs(np.diff(data.joints[order][:, turning], axis=0)).max(axis=1)
    moved = (turned > _MOVED_RAD) & (took > 0.0)
    if np.count_nonzero(moved) < _FEWEST_MOVES:
        return
    each, speed = float(np.median(took[moved])), float(np.median(turned[moved] / took[moved]))
    if each > _LONGEST_REST_S:
        likely, unit = "milliseconds", "ms"
    elif speed > _FASTEST_RAD_S:
        likely, unit = "hours", "h"
    else:
        return
    yield Finding(
        "time_unit",
        "warning",
        f"{data.file.name} column time: found {each:.3g} s from pose to pose, in which a joint turns by "
        f"{float(np.median(turned[moved])):.2g} rad (this looks like {likely})",
        {"column": "time", "median_s": each, "median_rad_s": speed},
        f"Give it its unit in dataset.yaml, as in 'time: {{column: time, unit: {unit}}}' under columns: "
        "otherwise effects of time are attributed to other causes.",
    )


def find_travel(data: Dataset, robot: Robot) -> Iterator[Finding]:
    """A warning for each joint that came further in one direction than it can turn."""
    for k, joint in enumerate(robot.joints, start=1):
        name = f"travel{k}"
        recorded = name in data.columns and name not in data.derived
        if not recorded or "limits" not in joint or k in robot.passive:
            continue
        furthest, (lo, hi) = float(data.columns[name].max()), joint["limits"]
        if furthest <= _MOST_TRAVEL * (hi - lo):
            continue
        unit, per_unit = ("deg", math.radians(1.0)) if joint["type"] == "revolute" else ("mm", 1e-3)
        likely = f" (this looks like {unit})" if furthest * per_unit <= _MOST_TRAVEL * (hi - lo) else ""
        yield Finding(
            "travel_unit",
            "warning",
            f"{data.file.name} column {name}: found {furthest:.3g}, expected no more than the {hi - lo:.3g} "
            f"between the limits of joint {k}: its travel since its last reversal{likely}",
            {"joint": k, "found": furthest, "range": hi - lo},
            f"Give it its unit in dataset.yaml, as in '{name}: {{column: {name}, unit: {unit}}}' under "
            "columns, or leave the column out.",
        )


def find_ratios(robot: Robot) -> Iterator[Finding]:
    """A warning where gears of robot.yaml turn their joints faster than the motors."""
    fast = {
        k: float(joint["gear_ratio"])
        for k, joint in enumerate(robot.joints, start=1)
        if 0.0 < abs(joint.get("gear_ratio", 1.0)) < 1.0
    }
    if fast:
        k, ratio = next(iter(fast.items()))
        yield Finding(
            "gear_ratio",
            "warning",
            f"gear_ratio of joint {', '.join(map(str, fast))} in {robot.kinematics_file}: found {ratio:.4g} on joint "
            f"{k}, expected the motor's turns per turn of the joint (this looks like 1/{1.0 / ratio:.4g})",
            {"joints": list(fast)},
            f"Write {1.0 / ratio:.6g} for joint {k} if the motor turns faster than its joint: errors of gears "
            "are searched for at multiples of the ratio.",
        )


def _scale(data: Dataset, robot: Robot) -> float | None:
    """Factor by which positions are too large, if it is that of a known unit."""
    riding = without_fixed_targets(data)
    if too_few_poses(riding.joints):
        return None
    scale = lengths.scale_of(joints_in_si_units(alignment_columns(riding), robot), robot)
    return scale if lengths.unit_of_points(scale, robot) else None


def positions_are_in_another(columns: Columns, robot: Robot) -> bool:
    """True where the unit of x, y, z must be wrong."""
    return any(name in POSITION for name, _, _ in wrong_units(columns, robot))


def in_si_units(columns: Columns, robot: Robot) -> Columns:
    """`columns` with joints and positions of a wrong unit converted to SI, so that the other checks can go on."""
    repaired = joints_in_si_units(columns, robot)
    if positions_are_in_another(columns, robot):
        repaired = lengths.scaled(repaired, lengths.nearest_unit(repaired, robot))
    return repaired


def joints_in_si_units(columns: Columns, robot: Robot) -> Columns:
    """`columns` with revolute joints, commanded or read back, that must be in degrees converted to radians."""
    wrong = {name for name, _, _ in wrong_units(columns, robot)}
    repaired = dict(columns)
    for stem in ("q", "qr"):
        joints = enumerate(robot.joints, start=1)
        turning = {f"{stem}{k}" for k, joint in joints if joint["type"] == "revolute"}
        if wrong & turning:
            repaired |= {name: np.radians(columns[name]) for name in turning & set(columns)}
    return repaired
