"""Values that are impossible for any arm and laboratory: wrong units, lost positions, too few poses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.io.columns import POSITION
from armtrue.io.robot import Robot
from armtrue.units import plural

# A revolute joint commanded further than this beyond its limits cannot be in radians.
_BEYOND_LIMITS_RAD = 2.0 * math.pi
# Without limits: two turns either way, as wrists that turn endlessly are turned back from time to time.
_WITHOUT_LIMITS_RAD = 4.0 * math.pi
# A tool that robot.yaml does not give may reach this far from the flange [m].
_UNKNOWN_TOOL_M = 2.0
# Points lie half a reach from their median: 500 for 1 m of reach in millimetres, 50 in centimetres, 20 in inches.
_MILLIMETRES_PER_REACH = 150.0
# Temperatures that an arm can have; in kelvin the figures are larger.
_COLDEST_C, HOTTEST_C = -80.0, 200.0
_ABSOLUTE_ZERO_C = -273.15
_LARGEST_SIGMA_M = 0.05
# Base and tool are nine numbers; with fewer poses than this the residuals are too few to check them.
_FEWEST_POSES = 10
_SAME_POSE = 1e-6
_LEAST_MOTION = 0.05


class WrongUnitError(InputError):
    """A column's unit must be wrong. `of_geometry`: it is one of the joints or points, whose units init guesses."""

    def __init__(self, column: str, message: str) -> None:
        super().__init__(message)
        self.of_geometry = column in POSITION or column.startswith("q")


def joint_bounds(joint: dict[str, object]) -> tuple[float, float]:
    """Range outside which a joint's figure cannot be in radians (revolute) or metres (prismatic)."""
    limits = joint.get("limits")
    if joint["type"] == "prismatic":
        return (-100.0, 100.0)
    if isinstance(limits, list):
        return (limits[0] - _BEYOND_LIMITS_RAD, limits[1] + _BEYOND_LIMITS_RAD)
    return (-_WITHOUT_LIMITS_RAD, _WITHOUT_LIMITS_RAD)


def wrong_units(columns: dict[str, Array], robot: Robot) -> list[tuple[str, int, str]]:
    """Return `(column, index, expected)` for the first entry of each column whose unit must be wrong."""
    found: list[tuple[str, int, str]] = []

    def look(name: str, bad: NDArray[np.bool_], expected: str) -> None:
        if bad.any():
            found.append((name, int(np.argmax(bad)), expected))

    for k, joint in enumerate(robot.joints, start=1):
        lowest, highest = joint_bounds(joint)
        unit, likely = ("radians", "degrees") if joint["type"] == "revolute" else ("metres", "millimetres")
        expected = f"{unit} between {lowest:.3g} and {highest:.3g} (these look like {likely})"
        for name in (f"q{k}", f"qr{k}"):
            values = columns.get(name, np.zeros(0))
            look(name, (values < lowest) | (values > highest), expected)
    if all(name in columns for name in POSITION):
        positions = np.column_stack([columns[name] for name in POSITION])
        # The median, so that a few gross errors have no influence.
        distance = float(np.median(np.linalg.norm(positions - np.median(positions, axis=0), axis=1)))
        largest = 2.0 * robot.reach_m + _UNKNOWN_TOOL_M
        if distance > largest:
            in_millimetres = distance > _MILLIMETRES_PER_REACH * robot.reach_m
            likely = "millimetres" if in_millimetres else "inches or centimetres"
            furthest = POSITION[int(np.argmax(np.abs(positions[0])))]
            span = f"metres within the arm's span of {largest:.3g} m of one another"
            found.append((furthest, 0, f"{span} (these look like {likely})"))
    for name, values in columns.items():
        if name.startswith("temp_"):
            wrong = (values < _COLDEST_C) | (values > HOTTEST_C)
            look(name, wrong, _temperature_expected(values[wrong]))
    expected = "a standard deviation in metres (these look like millimetres)"
    look("sigma", columns.get("sigma", np.zeros(0)) > _LARGEST_SIGMA_M, expected)
    return found


def _temperature_expected(wrong: Array) -> str:
    """The expected value, in words, for impossible temperatures `wrong`; their likely cause is told by the first."""
    expected = "a temperature in °C"
    if wrong.size and wrong[0] <= _ABSOLUTE_ZERO_C:
        return f"{expected} (below absolute zero it is a mark for a missing value: leave out these rows or the column)"
    if wrong.size and wrong[0] < _COLDEST_C:
        return f"{expected}, not below {_COLDEST_C:.0f}"
    return f"{expected} (these look like kelvin)"


def refuse_wrong_units(path: Path, columns: dict[str, Array], rows: NDArray[np.int64], robot: Robot) -> None:
    """Raise WrongUnitError for the first column whose unit must be wrong."""
    for name, at, expected in wrong_units(columns, robot):
        found = f"{path} row {rows[at]} column {name}: found {columns[name][at]:.6g}, expected {expected}"
        raise WrongUnitError(name, found)


def too_few_poses(joints: Array) -> str | None:
    """Why poses `joints` (N, n) cannot determine base and tool (too few or too close together); None if they can."""
    different = len(np.unique(np.round(joints / _SAME_POSE), axis=0))
    if different < _FEWEST_POSES:
        return f"found {plural(different, 'different pose')}, expected at least {_FEWEST_POSES}"
    widest = float(np.ptp(joints, axis=0).max())
    if widest < _LEAST_MOTION:
        return f"found no joint that moves more than {widest:.3g}, expected {_LEAST_MOTION} at least"
    return None


def refuse_too_few_poses(path: Path, joints: Array) -> None:
    """Raise InputError if poses `joints` (N, n) cannot determine base and tool."""
    reason = too_few_poses(joints)
    if reason is not None:
        raise InputError(f"{path}: {reason}")
