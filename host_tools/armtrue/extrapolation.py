"""Ranges of the fitted columns, and how far other rows lie outside them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armtrue.io import Dataset, Robot

# A few hundred poses do not reach the last few percent of a joint's range, and the model still holds there.
_BEYOND_RANGE = 0.05
# Margin for a joint that stood still while the others moved [rad, m].
_SAME_JOINT = 1e-3
# A trend in time or temperature is trusted for a quarter of its measured span beyond that span.
_BEYOND_SPAN = 0.25
_SAME_VALUE = 1e-3
_JOINT = re.compile(r"q[0-9]+")
# Directions, travels and numbers of set-ups have no meaningful range; a read-back follows its joint.
_NO_RANGE = re.compile(r"(qr|dir|travel)[0-9]+|station|nest|target|repeat")
_UNITS = {"temp_": "°C", "payload": "kg", "tau": "Nm"}


def is_joint(name: str) -> bool:
    """True for q1…qn."""
    return bool(_JOINT.fullmatch(name))


@dataclass(frozen=True)
class Beyond:
    """A column with values outside its fitted range.

    `rows` (N,): mask of the rows outside. `amount`: the largest distance from the range, in the column's SI unit.
    `span`: width of the fitted range. `effects`: those whose terms name the column; empty for a joint.
    """

    name: str
    rows: NDArray[np.bool_]
    amount: float
    span: float
    effects: list[str]

    def words(self, robot: Robot) -> str:
        """`q5 by up to 132°`, `time by up to 2.1 h, 4.2 times the span that was fitted`."""
        if is_joint(self.name):
            turns = robot.joints[int(self.name[1:]) - 1]["type"] == "revolute"
            size = f"{math.degrees(self.amount):.0f}°" if turns else f"{1000.0 * self.amount:.0f} mm"
            return f"{self.name} by up to {size}"
        words = f"{self.name} by up to {_size(self.name, self.amount)}"
        times = f", {self.amount / self.span:.1f} times the span that was fitted" if self.span > 0.0 else ""
        return words + times


def ranges_of(data: Dataset, names: Iterable[str]) -> dict[str, list[float]]:
    """Lowest and highest value of those columns that have a range; that of `time` also tells which rows are later."""
    return {
        name: [float(data.columns[name].min()), float(data.columns[name].max())]
        for name in names
        if name in data.columns and not _NO_RANGE.fullmatch(name)
    }


def duration(seconds: float) -> str:
    """`300 s`, `2.1 h`."""
    return f"{seconds / 3600.0:.1f} h" if seconds >= 7200.0 else f"{seconds:.0f} s"


def _size(name: str, value: float) -> str:
    """`value` of a column other than a joint, with its unit as far as the column's name tells it."""
    if name == "time":
        return duration(value)
    unit = next((unit for stem, unit in _UNITS.items() if name.startswith(stem)), "")
    return f"{value:.3g} {unit}".rstrip()


def margin(name: str, lo: float, hi: float) -> float:
    """How far beyond `lo` to `hi` a column may go before it counts as outside."""
    if is_joint(name):
        return max(_SAME_JOINT, _BEYOND_RANGE * (hi - lo))
    return max(_SAME_VALUE * max(1.0, abs(lo), abs(hi)) if hi == lo else 0.0, _BEYOND_SPAN * (hi - lo))
