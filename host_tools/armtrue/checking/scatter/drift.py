"""Drift that shows without a model: of reflectors fixed to the floor, and of poses measured again later."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from armtrue.arrays import Array
from armtrue.checking.report import Finding
from armtrue.io.dataset import Dataset, fixed_targets

# A drift is reported beyond this many standard deviations of its slope.
_DEVIATIONS = 5.0


def find(data: Dataset) -> Iterator[Finding]:
    """Findings on reflectors that are not mounted on the arm, and on repeated poses that drift."""
    if data.has_positions:
        yield from _fixed_reflectors(data)
        yield from _wandering_repeats(data)


def _fixed_reflectors(data: Dataset) -> Iterator[Finding]:
    for code in fixed_targets(data):
        rows = data.columns["target"] == code
        name = data.labels["target"][code]
        shift, sigma = _shift_over(data.clock[rows], data.positions_m[rows])
        drifts = shift > _DEVIATIONS * sigma
        evidence = {"target": name, "rows": int(rows.sum()), "shift_m": shift, "sigma_m": sigma}
        if drifts:
            yield Finding(
                "base_drift",
                "warning",
                f"target '{name}' does not ride on the arm, yet moved by {shift * 1e6:.0f} µm over the session "
                f"(± {sigma * 1e6:.0f} µm): base or instrument drifts",
                evidence,
                "Add the effect time_drift to the model, and measure fixed reflectors now and then.",
            )
        else:
            yield Finding(
                "fixed_reflector",
                "note",
                f"target '{name}' does not ride on the arm and stood still within {max(shift, sigma) * 1e6:.0f} µm",
                evidence,
                "Nothing to do: a fit leaves its rows out.",
            )


def _wandering_repeats(data: Dataset) -> Iterator[Finding]:
    """A warning if repeated poses, each about its own mean, have a common slope over time."""
    if "repeat" not in data.columns or "time" not in data.columns:
        return
    key = data.columns["repeat"] * (1 + len(data.labels.get("target", []))) + data.columns.get(
        "target", np.zeros(data.count)
    )
    _, pose = np.unique(key, return_inverse=True)
    sizes = np.bincount(pose)
    again = sizes[pose] > 1
    if again.sum() < 6:
        return
    positions, times = data.positions_m, data.columns["time"].astype(np.float64)
    centred = np.column_stack([*positions.T, times])[again]
    pose = pose[again]
    for column in range(4):
        sums = np.bincount(pose, weights=centred[:, column])
        centred[:, column] -= (sums / np.maximum(np.bincount(pose), 1))[pose]
    span = float(np.ptp(times))
    if span <= 0.0 or float(np.abs(centred[:, 3]).max()) < 1e-3 * span:
        return
    shift, sigma = _shift_over(centred[:, 3], centred[:, :3], span=span, groups=len(np.unique(pose)))
    if shift <= _DEVIATIONS * sigma:
        return
    yield Finding(
        "repeats_drift",
        "warning",
        f"poses measured again later lie {shift * 1e6:.0f} µm (± {sigma * 1e6:.0f} µm) away over the session",
        {"shift_m": shift, "sigma_m": sigma, "rows": int(again.sum())},
        "Let armtrue diagnose tell drift, warm-up and direction of approach apart; record temperatures.",
    )


def _shift_over(
    times: Array, positions: Array, span: float | None = None, groups: int = 1
) -> tuple[float, float]:
    """Length [m] of the linear shift during the time `span`, and its standard deviation [m]."""
    centred_times = times - times.mean()
    power = float(centred_times @ centred_times)
    if power == 0.0 or times.size <= groups + 2:
        return 0.0, math.inf
    centred = positions - positions.mean(axis=0)
    slope = centred_times @ centred / power
    left = centred - np.outer(centred_times, slope)
    freedom = 3 * (times.size - groups - 1)
    duration = float(np.ptp(times)) if span is None else span
    sigma = math.sqrt(float((left**2).sum()) / freedom / power) * duration
    return float(np.linalg.norm(slope)) * duration, max(sigma, 1e-9)
