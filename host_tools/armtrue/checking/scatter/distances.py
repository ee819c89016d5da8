"""Distances between reflectors of one tool: on a rigid tool they are the same at all poses, whatever the arm does."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.checking.report import Finding
from armtrue.checking.scatter.repeats import joint_keys, numbered, repeats_scatter_m, state_keys
from armtrue.io.dataset import Dataset

_FEWEST_DISTANCES = 10
# A distance with this many times the scatter of the steadiest is loose; noise grows less than that with distance.
_TIMES = 3.0
# Smaller scatter is ordinary tracker noise [m].
_LEAST_M = 20e-6
# Quantile of the deviations that gives the scale: a reflector may be loose in half of the distances, others bumped.
_SHARE = 0.8
_NORMAL_AT_SHARE = 1.2816


def find(data: Dataset) -> Iterator[Finding]:
    """A warning for each reflector of `data` (all mounted on the arm) whose distances from all others scatter.

    Distances are between reflectors measured one after another at one pose. Their scatter is compared with that of the
    steadiest pair or, with only two reflectors, with that of repeated poses.
    """
    if "target" not in data.columns:
        return
    scales = _scales(data)
    names = data.labels["target"]
    targets = sorted({target for pair in scales for target in pair})
    if len(targets) == 2:
        # Repeats scatter in three axes together; a distance lies along one axis and has the noise of both its ends.
        firmest = repeats_scatter_m(data) * math.sqrt(2.0 / 3.0)
        ((pair, scale),) = scales.items()
        who = f"reflectors '{names[pair[0]]}' and '{names[pair[1]]}'"
        if scale > max(_TIMES * firmest, _LEAST_M):
            of_repeats = f"while repeated poses scatter by {firmest * 1e6:.0f} µm"
            yield _finding(f"between {who}", scale, of_repeats, who)
        return
    if not scales:
        return
    firm = min(scales, key=lambda pair: scales[pair])
    holds = f"while that between '{names[firm[0]]}' and '{names[firm[1]]}' scatters by {scales[firm] * 1e6:.0f} µm"
    for target in targets:
        least = min(scale for pair, scale in scales.items() if target in pair)
        if least > max(_TIMES * scales[firm], _LEAST_M):
            who = f"reflector '{names[target]}'"
            yield _finding(f"from {who} to the others", least, holds, who)


def _finding(between: str, scale: float, compared: str, who: str) -> Finding:
    return Finding(
        "loose_reflector",
        "warning",
        f"the distance {between} scatters by {scale * 1e6:.0f} µm from pose to pose, {compared}: on a rigid tool it is "
        "the same at all poses",
        {"scatter_m": scale},
        f"Check whether {who} or its nest is loose, and measure again, or remove its rows.",
    )


def _scales(data: Dataset) -> dict[tuple[int, int], float]:
    """Robust standard deviation [m] of the distance of each pair of reflectors measured at enough poses.

    A pose is a run of rows with equal joints, set-up and load: after another pose the arm does not return exactly.
    Distances of one seat (column nest) are compared with each other only, and so are those of one set-up, whose scale
    may differ.
    """
    targets = data.columns["target"].astype(np.int64)
    state = np.column_stack([joint_keys(data), state_keys(data, "target")])
    pose = np.concatenate([[0], np.cumsum(np.any(np.diff(state, axis=0) != 0, axis=1))])
    seat = numbered(np.zeros(data.count), state_keys(data, "target", "payload"))
    points = {}
    for target in np.unique(targets):
        rows = np.flatnonzero(targets == target)
        of_pose, first = np.unique(pose[rows], return_index=True)
        points[int(target)] = (of_pose, rows[first])
    scales = {}
    for one, other in itertools.combinations(points, 2):
        _, at, beside = np.intersect1d(points[one][0], points[other][0], return_indices=True)
        if at.size >= _FEWEST_DISTANCES:
            row, partner = points[one][1][at], points[other][1][beside]
            apart = np.linalg.norm(data.positions_m[row] - data.positions_m[partner], axis=1)
            scales[one, other] = _scale(apart, seat[row])
    return scales


def _scale(values: Array, group: NDArray[np.int64]) -> float:
    off = np.abs(values - [np.median(values[group == number]) for number in group])
    return float(np.quantile(off, _SHARE)) / _NORMAL_AT_SHARE
