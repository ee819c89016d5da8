"""Measured lengths compared with the arm's: another unit, or a wrong scale."""

from __future__ import annotations

import math

import numpy as np

from armtrue.checking.alignment import Columns, align, thinned
from armtrue.checking.scatter.repeats import set_up_of_row
from armtrue.io.columns import POSITION, UNITS
from armtrue.io.robot import Robot

# Errors of nominal geometry change the scale by less than this.
TOLERANCE = 0.02
# Plurals of the units that positions may be in.
_NAMES = {"m": "metres", "mm": "millimetres", "cm": "centimetres", "in": "inches", "ft": "feet"}
_ROWS = 200
# No arm reaches further [m]: where one seems to, its own lengths are in another unit.
_LONGEST_ARM_M = 30.0


def scaled(columns: Columns, scale: float) -> Columns:
    """`columns` with positions divided by `scale`."""
    return {name: values / scale if name in POSITION else values for name, values in columns.items()}


def spread(columns: Columns) -> float:
    """Median distance of the positions from the middle of their set-up; never 0."""
    points = np.column_stack([columns[name] for name in POSITION])
    set_up = set_up_of_row(columns)
    middles = np.array([np.median(points[set_up == one], axis=0) for one in range(int(set_up.max()) + 1)])
    return max(1e-9, float(np.median(np.linalg.norm(points - middles[set_up], axis=1))))


def scale_of(columns: Columns, robot: Robot) -> float:
    """Factor by which the positions are too large for the arm; valid only under the right conventions."""
    return align(thinned(columns, _ROWS), robot).scale


def nearest_unit(columns: Columns, robot: Robot) -> float:
    """Scale of the known unit of length, other than the metre, that is nearest to that of the positions."""
    scale = scale_of(columns, robot)
    if not scale > 0.0:
        return 1000.0
    others = (UNITS[unit][1] for unit in _NAMES if unit != "m")
    return 1.0 / min(others, key=lambda size: abs(math.log(scale * size)))


def true_unit(scale: float, read_as: str = "m") -> str | None:
    """The unit of lengths that come out `scale` times too large when read in `read_as`; None where none is known."""
    size = UNITS[read_as][1] / scale if read_as in _NAMES else math.inf
    others = (unit for unit in _NAMES if unit != read_as)
    return next((unit for unit in others if abs(UNITS[unit][1] / size - 1.0) < TOLERANCE), None)


def unit_of_points(scale: float, robot: Robot) -> str | None:
    """The unit of the measured positions that explains `scale`; None if there is none, or the arm's unit is wrong."""
    return None if _arm_is_in_another(scale, robot) else _mistaken(scale)[0]


def words_of_points(scale: float) -> str:
    """The unit, in words, that makes positions `scale` times as large as the arm."""
    true, read = _mistaken(scale)
    named = _NAMES[true] if true else "another unit"
    return named if read == "m" else f"{named}, read as {_NAMES[read]}"


def sentence(scale: float, robot: Robot) -> str:
    """Sentence that measured positions are `scale` times as large as the arm, with the unit that explains it."""
    if _arm_is_in_another(scale, robot):
        return (
            f"the arm's kinematics reach {robot.reach_m:.4g} m, and are {1.0 / scale:.5g} times as large as the "
            f"measured positions: the lengths in {robot.kinematics_file} look like {words_of_points(1.0 / scale)}"
        )
    true, read = _mistaken(scale)
    exact = ""
    if true and read != "m":
        factor = UNITS[read][1] / UNITS[true][1]
        exact = f" = {factor:.4g}" if factor > 1.0 else f" = 1/{1.0 / factor:.4g}"
    words = f"they look like {words_of_points(scale)}"
    if true is None:
        words = f"{robot.kinematics_file} or the instrument's scale is wrong"
    return f"the measured positions are {scale:.5g}{exact} times as large as the arm's kinematics: {words}"


def remedy(scale: float, robot: Robot) -> str:
    """Sentence on how to correct `scale`."""
    if _arm_is_in_another(scale, robot):
        return f"Write the lengths in {robot.kinematics_file} in metres."
    if true := unit_of_points(scale, robot):
        return f"Give x, y, z 'unit: {true}' in a dataset.yaml."
    return f"Compare {robot.kinematics_file} with the arm's data sheet."


def _mistaken(scale: float) -> tuple[str | None, str]:
    """The true unit of lengths that are `scale` times too large (None: unknown), and the unit they were read in."""
    return next(((true, read) for read in _NAMES if (true := true_unit(scale, read))), (None, "m"))


def _arm_is_in_another(scale: float, robot: Robot) -> bool:
    return scale < 1.0 and robot.reach_m > _LONGEST_ARM_M
