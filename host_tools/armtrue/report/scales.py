"""Axes: from values to places on paper, and the round values to write beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armtrue.arrays import Array

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Scale:
    """Values from `low` to `high`, linear or logarithmic."""

    low: float
    high: float
    logarithmic: bool = False

    def share(self, values: Array | float) -> Array:
        """Place of each value between the ends: 0 at `low`, 1 at `high`."""
        array = np.asarray(values, dtype=np.float64)
        if self.logarithmic:
            span = math.log(self.high / self.low)
            return np.asarray(np.log(np.maximum(array, 1e-300) / self.low) / span)
        return np.asarray((array - self.low) / (self.high - self.low))

    def ticks(self, wanted: int = 5) -> list[float]:
        """Round values inside, about `wanted` of them."""
        return self._decades(wanted) if self.logarithmic else self._even(wanted)

    def _even(self, wanted: int) -> list[float]:
        raw = (self.high - self.low) / max(1, wanted)
        power = 10.0 ** math.floor(math.log10(raw))
        step = next(power * s for s in _STEPS if power * s >= raw * 0.999)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [k * step for k in range(first, last + 1)]

    def _decades(self, wanted: int) -> list[float]:
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        factors = (1,) if last - first > wanted else (1, 2, 5) if last - first < 3 else (1, 3)
        values = [f * 10.0**k for k in range(first, last + 1) for f in factors]
        return [v for v in values if self.low * 0.999 <= v <= self.high * 1.001]


def around(values: Array, *, margin: float = 0.04) -> Scale:
    """A linear scale over all values with a little room; one value alone gets room around it."""
    low, high = float(np.min(values)), float(np.max(values))
    room = margin * (high - low) or 0.05 * abs(high) or 1.0
    return Scale(low - room, high + room)


def symmetric(size: float) -> Scale:
    """A linear scale from −`size` to `size`."""
    return Scale(-(size or 1.0), size or 1.0)


def tick_text(value: float) -> str:
    """A tick's value without needless digits, with a real minus sign."""
    text = f"{value:.6g}" if 1e-4 <= abs(value) < 1e6 or value == 0.0 else f"{value:.0e}"
    return text.replace("-", "−")
