"""Means and spread of a residual over bins of a state variable, and how much of it the bins explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array

_MOST_BINS = 16
_LEAST_BINS = 5
_ROWS_A_BIN = 20
# The mean of fewer rows than this is not shown.
_LEAST_ROWS = 5
# Up to this many different values, each has its own bin.
DISCRETE = 8
_BAND = (5.0, 95.0)
# Bins explain 0 ± √(2 (bins − 1)) / rows of pure noise (adjusted share); six such sigmas in 300 looks are not chance.
_BEYOND_CHANCE = 6.0
# Where chance alone could explain this share of the variance, finding no trend tells nothing.
_PLAIN_SHARE = 0.5


@dataclass(frozen=True)
class Binned:
    """Bins of one variable, lowest first.

    All (bins,): `centre`, `mean`, `error` (two standard errors of the mean), `low` and `high` (5 and 95 % of readings).
    `explained`: share of the variance that bin means explain, minus the share they would explain of noise. `trend`:
    True if that is beyond chance. `tells`: True if there are enough rows to see a trend.
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
    """The bin of every value (N,): one for each value if there are few different ones, else bins of equal count."""
    different, inverse = np.unique(values, return_inverse=True)
    if different.size <= DISCRETE:
        return np.asarray(inverse)
    bins = int(np.clip(values.size // _ROWS_A_BIN, _LEAST_BINS, _MOST_BINS))
    # With few rows there are fewer bins, so that none is too small to be shown.
    bins = max(1, min(bins, values.size // _LEAST_ROWS))
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, bins + 1)[1:-1]))
    return np.searchsorted(edges, values, side="right")


def binned(values: Array, readings: Array, weight: Array) -> Binned:
    """Bin `readings` (N,) by `values` (N,); means carry `weight` (N,), as do the shares."""
    _, label, rows = np.unique(bin_of(values), return_inverse=True, return_counts=True)

    def total(of: Array) -> Array:
        return np.asarray(np.bincount(label, of), dtype=np.float64)

    def or_one(sums: Array) -> Array:
        return np.where(sums > 0.0, sums, 1.0)

    grand = float(np.average(readings, weights=weight))
    sums = or_one(total(weight))
    means = total(weight * readings) / sums
    scatter = total(weight * (readings - means[label]) ** 2)
    independent = sums**2 / or_one(total(weight**2))
    error = 2.0 * np.sqrt(scatter / sums / np.maximum(1.0, independent - 1.0))
    centre = total(values) / rows
    # The band is of well-known readings: those of almost no weight would only widen it. Bins without any use all.
    known = weight >= 0.1 * np.median(weight)
    known |= ~np.isin(label, label[known])
    bands = [np.percentile(readings[known & (label == k)], _BAND) for k in range(rows.size)]
    lows, highs = np.transpose(bands)
    enough = rows >= _LEAST_ROWS
    centre, means, error, lows, highs = (column[enough] for column in (centre, means, error, lows, highs))
    between = float(sums[enough] @ (means - grand) ** 2)
    within = float(scatter[enough].sum())
    bins, count = centre.size, values.size
    plain = between / (between + within) if between + within > 0.0 else 0.0
    freedom = max(1, count - bins)
    adjusted = 1.0 - (1.0 - plain) * (count - 1) / freedom
    accident = _BEYOND_CHANCE * np.sqrt(2.0 * max(1, bins - 1)) / freedom
    trend = bool(bins > 1 and adjusted > accident)
    tells = trend or bool(bins > 1 and accident < _PLAIN_SHARE)
    return Binned(centre, means, error, lows, highs, float(adjusted), trend, tells)
