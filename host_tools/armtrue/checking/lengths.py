"""Lengths measured against lengths of the arm: another unit, or a scale that is wrong."""

from __future__ import annotations

import math

from armtrue.checking.alignment import NOMINAL_ERROR_PER_REACH, Columns, align, thinned
from armtrue.checking.report import Finding
from armtrue.io.columns import POSITION
from armtrue.io.robot import Robot

# Nominal geometry never misjudges lengths by as much.
_TOLERANCE = 0.02
_UNITS = {
    1000.0: "millimetres",
    100.0: "centimetres",
    1 / 0.0254: "inches",
    1 / 0.3048: "feet",
    1e-3: "kilometres",
}
_ROWS = 200
_PASSES = 3
# A scale is believed when it leaves at most this share of the residual.
_CONVINCING = 1 / 3
_ANOTHER_UNIT = 1.25


def scaled(columns: Columns, scale: float) -> Columns:
    """`columns` with positions divided by `scale`."""
    return {name: values / scale if name in POSITION else values for name, values in columns.items()}


def nearest_unit(columns: Columns, robot: Robot) -> float:
    """Scale of the unit of length that positions, in no matter what convention else, come nearest to."""
    scale = align(thinned(columns, _ROWS), robot).scale
    return _nearest(scale) if scale > 0.0 else 1000.0


def find_scale(columns: Columns, robot: Robot) -> float:
    """How many times as large as the arm the measured positions are; 1 where no scale makes them follow it.

    A scale counts only where it explains the residual: under wrong conventions any scale comes out.
    """
    sample = thinned(columns, _ROWS)
    start = align(sample, robot)
    scale, latest = 1.0, start
    for _ in range(_PASSES):
        scale *= latest.scale
        if not (math.isfinite(scale) and scale > 0.0):
            return 1.0
        latest = align(scaled(sample, scale), robot)
    # The alignment brings positions to the arm's size by itself where a unit is wrong: nothing is left to lessen then.
    another_unit = max(start.scale, 1.0 / start.scale) > _ANOTHER_UNIT
    explains = latest.rms_m < NOMINAL_ERROR_PER_REACH * robot.reach_m and (
        another_unit or latest.rms_m < _CONVINCING * start.rms_m
    )
    return scale if explains and abs(scale - 1.0) > _TOLERANCE else 1.0


def find(scale: float) -> list[Finding]:
    """An error where lengths measured and lengths of the arm do not agree."""
    if scale == 1.0:
        return []
    nearest = _nearest(scale)
    known = abs(nearest / scale - 1.0) < _TOLERANCE
    words = f"they look like {_UNITS[nearest]}" if known else "robot.yaml or the instrument's scale is wrong"
    return [
        Finding(
            "scale",
            "error",
            f"the measured positions are {scale:.5g} times as large as the arm's kinematics: {words}",
            {"scale": scale},
            "Give the unit of x, y, z in a dataset.yaml."
            if known
            else "Compare robot.yaml with the arm's data sheet.",
        )
    ]


def _nearest(scale: float) -> float:
    return min(_UNITS, key=lambda known: abs(math.log(known / scale)))
