"""Means and spread of a residual over bins of a state variable, and how much of it the bins explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array

_MOST_BINS = 16
_LEAST_BINS = 5
_ROWS_A_BIN = 20
# Fewer rows than this say nothing of a mean.
_LEAST_ROWS = 5
# Up to so many different values, each is a bin of its own.
DISCRETE = 8
_BAND = (5.0, 95.0)
# Bins of pure noise explain 0 ± √(2 (bins − 1)) / rows of it, adjusted; six of these in 300 looks is no accident.
_BEYOND_CHANCE = 6.0
# Where even a trend that explains so much could be an accident, no trend found says nothing.
_PLAIN_SHARE = 0.5


@dataclass(frozen=True)
class Binned:
    """Bins of one variable, lowest first.

    All (bins,): `centre`, `mean`, `error` (two standard errors of the mean), `low` and `high` (5 and 95 % of readings).
    `explained`: share of the variance that bin means explain, less what they would of noise. `trend`: no accident.
    `tells`: there are rows enough for a trend to be seen.
    """

    centre: Array
    mean: Array
    error: Array
    low: Array
    high: Array
    explained: float
    trend: bool
    tells: bool


def bin_of(values: Array) -> NDArray[np.intp]:
    """The bin of every value (N,): one for each of few different values, else bins of equal count."""
    different, inverse = np.unique(values, return_inverse=True)
    if different.size <= DISCRETE:
        return np.asarray(inverse)
    bins = int(np.clip(values.size // _ROWS_A_BIN, _LEAST_BINS, _MOST_BINS))
    # Few rows are few bins rather than bins too small to count.
    bins = max(1, min(bins, values.size // _LEAST_ROWS))
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, bins + 1)[1:-1]))
    return np.searchsorted(edges, values, side="right")


def binned(values: Array, readings: Array, weight: Array) -> Binned:
    """Bin `readings` (N,) by `values` (N,); means carry `weight` (N,), as do the shares."""
    label = bin_of(values)
    rows: list[tuple[float, ...]] = []
    between = within = 0.0
    grand = float(np.average(readings, weights=weight))
    for which in np.unique(label):
        inside = label == which
        if int(inside.sum()) < _LEAST_ROWS:
            continue
        w, r = weight[inside], readings[inside]
        total = float(w.sum()) or 1.0
        mean = float(w @ r) / total
        scatter = float(w @ (r - mean) ** 2)
        count = total**2 / (float(w @ w) or 1.0)
        spread = np.sqrt(scatter / total / max(1.0, count - 1.0))
        # Readings are spread as the well-known ones are: those of no weight would only widen the band.
        known = inside & (weight >= 0.1 * np.median(weight))
        low, high = np.percentile(readings[known] if known.any() else r, _BAND)
        rows.append((float(np.average(values[inside])), mean, 2.0 * spread, low, high))
        between += total * (mean - grand) ** 2
        within += scatter
    centre, means, error, lows, highs = np.array(rows).reshape(-1, 5).T
    bins, count = centre.size, values.size
    plain = between / (between + within) if between + within > 0.0 else 0.0
    freedom = max(1, count - bins)
    adjusted = 1.0 - (1.0 - plain) * (count - 1) / freedom
    accident = _BEYOND_CHANCE * np.sqrt(2.0 * max(1, bins - 1)) / freedom
    trend = bool(bins > 1 and adjusted > accident)
    tells = trend or bool(bins > 1 and accident < _PLAIN_SHARE)
    return Binned(centre, means, error, lows, highs, float(adjusted), trend, tells)
