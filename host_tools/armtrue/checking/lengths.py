"""Lengths measured against lengths of the arm: another unit, or a scale that is wrong."""

from __future__ import annotations

import math

import numpy as np

from armtrue.checking.alignment import Columns, align, thinned
from armtrue.io.columns import POSITION
from armtrue.io.robot import Robot

# Nominal geometry never misjudges lengths by as much.
TOLERANCE = 0.02
_UNITS = {
    1000.0: "millimetres",
    100.0: "centimetres",
    1 / 0.0254: "inches",
    1 / 0.3048: "feet",
    1e-3: "kilometres",
}
_ROWS = 200
# No arm reaches further [m]: where one seems to, its own lengths are in another unit.
_LONGEST_ARM_M = 30.0


def scaled(columns: Columns, scale: float) -> Columns:
    """`columns` with positions divided by `scale`."""
    return {name: values / scale if name in POSITION else values for name, values in columns.items()}


def spread(columns: Columns) -> float:
    """Median distance of the positions from their middle; never 0."""
    points = np.column_stack([columns[name] for name in POSITION])
    return max(1e-9, float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1))))


def nearest_unit(columns: Columns, robot: Robot) -> float:
    """Scale of the unit of length that positions, in no matter what convention else, come nearest to."""
    scale = align(thinned(columns, _ROWS), robot).scale
    return _nearest(scale) if scale > 0.0 else 1000.0


def sentence(scale: float, robot: Robot) -> str:
    """Say that measured positions are `scale` times as large as the arm, and what unit that looks like."""
    if _arm_is_in_another(scale, robot):
        return (
            f"the arm's kinematics reach {robot.reach_m:.4g} m, and are {1.0 / scale:.5g} times as large as the "
            f"measured positions: the lengths in {robot.kinematics_file} look like {_UNITS[_nearest(1.0 / scale)]}"
        )
    words = f"they look like {_UNITS[_nearest(scale)]}"
    if not _is_known(scale):
        words = f"{robot.kinematics_file} or the instrument's scale is wrong"
    return f"the measured positions are {scale:.5g} times as large as the arm's kinematics: {words}"


def remedy(scale: float, robot: Robot) -> str:
    """What to do about `scale`."""
    if _arm_is_in_another(scale, robot):
        return f"Write the lengths in {robot.kinematics_file} in metres."
    known = _is_known(scale)
    return (
        "Give the unit of x, y, z in a dataset.yaml."
        if known
        else f"Compare {robot.kinematics_file} with the arm's data sheet."
    )


def _arm_is_in_another(scale: float, robot: Robot) -> bool:
    return scale < 1.0 and robot.reach_m > _LONGEST_ARM_M


def _is_known(scale: float) -> bool:
    return abs(_nearest(scale) / scale - 1.0) < TOLERANCE


def _nearest(scale: float) -> float:
    return min(_UNITS, key=lambda known: abs(math.log(known / scale)))
