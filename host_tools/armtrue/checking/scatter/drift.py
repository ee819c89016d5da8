"""Drift that shows without a model: of reflectors fixed to the floor, and of poses measured again later."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.checking.report import Finding
from armtrue.checking.scatter.repeats import numbered, state_keys, without_means
from armtrue.io.dataset import Dataset, fixed_targets

# A drift is reported beyond this many standard deviations of its slope.
_DEVIATIONS = 5.0
# Repeats closer in time than this share of the session show no drift.
_LEAST_TIME_APART = 1e-3


def find(data: Dataset) -> Iterator[Finding]:
    """Findings on reflectors that are not mounted on the arm, and on repeated poses that drift."""
    if data.has_positions:
        yield from _fixed_reflectors(data)
        yield from _wandering_repeats(data)


def _fixed_reflectors(data: Dataset) -> Iterator[Finding]:
    set_up = numbered(np.zeros(data.count), state_keys(data, "target", "payload"))
    for code in fixed_targets(data):
        rows = data.columns["target"] == code
        name = data.labels["target"][code]
        times = data.clock[rows]
        shift, sigma = _common_shift(times, data.positions_m[rows], set_up[rows], float(np.ptp(times)))
        evidence = {"target": name, "rows": int(rows.sum()), "shift_m": shift, "sigma_m": sigma}
        if shift > _DEVIATIONS * sigma:
            yield Finding(
                "base_drift",
                "warning",
                f"target '{name}' does not move with the arm, but moved by {shift * 1e6:.0f} µm over the session "
                f"(± {sigma * 1e6:.0f} µm): base or instrument drifts",
                evidence,
                "Add the effect time_drift to the model, and measure fixed reflectors now and then.",
            )
        else:
            yield Finding(
                "fixed_reflector",
                "note",
                f"target '{name}' does not move with the arm and stayed within {max(shift, sigma) * 1e6:.0f} µm",
                evidence,
                "Nothing to do: a fit leaves its rows out.",
            )


def _wandering_repeats(data: Dataset) -> Iterator[Finding]:
    """A warning if repeated poses, each about its own mean, have a common slope over time."""
    if "repeat" not in data.columns or "time" not in data.columns:
        return
    pose = numbered(data.columns["repeat"], state_keys(data))
    again = np.bincount(pose)[pose] > 1
    if again.sum() < 6:
        return
    times = data.columns["time"].astype(np.float64)
    session_s = float(np.ptp(times))
    shift, sigma = _common_shift(times[again], data.positions_m[again], pose[again], session_s)
    if shift <= _DEVIATIONS * sigma:
        return
    yield Finding(
        "repeats_drift",
        "warning",
        f"repeated poses moved by {shift * 1e6:.0f} µm (± {sigma * 1e6:.0f} µm) over the session",
        {"shift_m": shift, "sigma_m": sigma, "rows": int(again.sum())},
        "armtrue diagnose distinguishes drift, warm-up and direction of approach; record temperatures.",
    )


def _common_shift(
    times: Array, positions: Array, group: NDArray[np.int64], session_s: float
) -> tuple[float, float]:
    """Length [m] of the linear shift during `session_s`, and its standard deviation [m].

    The slope is common to all groups; each has its own mean, so that points of two set-ups are not compared.
    """
    group = numbered(group)
    centred_times = without_means(times[:, None], group)[:, 0]
    freedom = 3 * (times.size - int(group.max()) - 2)
    if freedom <= 3 or session_s <= 0.0 or float(np.abs(centred_times).max()) < _LEAST_TIME_APART * session_s:
        return 0.0, math.inf
    power = float(centred_times @ centred_times)
    centred = without_means(positions, group)
    slope = centred_times @ centred / power
    left = centred - np.outer(centred_times, slope)
    sigma = math.sqrt(float((left**2).sum()) / freedom / power) * session_s
    return float(np.linalg.norm(slope)) * session_s, max(sigma, 1e-9)
