"""Which rows are of one pose, and how much such rows scatter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.io.dataset import Dataset

_SAME_POSE_RAD = 1e-6
# Columns beside the joints that change where the same joints put the point: reflector and its seat, set-up of the
# tracker, load. Rows that differ in one of them are no repeats.
_STATE = ("target", "nest", "station", "payload")


def joint_keys(data: Dataset) -> NDArray[np.int64]:
    """Joints of each row as integers (N, joints), equal for rows of one pose."""
    return np.round(data.joints / _SAME_POSE_RAD).astype(np.int64)


def state_keys(data: Dataset, *but: str) -> Array:
    """The columns (N, k) that decide, beside the joints, where a point is expected, except those named in `but`."""
    kept = [data.columns[name] for name in _STATE if name in data.columns and name not in but]
    return np.column_stack(kept) if kept else np.zeros((data.count, 0))


def pose_of_row(data: Dataset, *more: Array) -> NDArray[np.int64]:
    """The number (N,) of each row's pose: rows of one number have the same joints, reflector, seat, set-up and load.

    `more`: further columns (N,) or (N, k) in which rows of one number agree.
    """
    return numbered(joint_keys(data), state_keys(data), *more)


def set_up_of_row(columns: dict[str, Array]) -> NDArray[np.int64]:
    """The number (N,) of the tracker's set-up in each row of `columns`, from 0; all 0 without a column station."""
    count = len(next(iter(columns.values())))
    return numbered(columns.get("station", np.zeros(count)))


def numbered(*columns: Array | NDArray[np.int64]) -> NDArray[np.int64]:
    """The number (N,) of each row's combination of values in `columns`, from 0."""
    combined = np.column_stack(columns)
    return np.unique(combined, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def repeats_scatter_m(data: Dataset) -> float:
    """Standard deviation [m], x, y and z together, of repeated poses about their mean; inf if none was repeated.

    Rows of one pose also agree in the directions of approach: differences due to backlash are not noise.
    """
    directions = [values for name, values in data.columns.items() if name.startswith("dir")]
    poses = pose_of_row(data, *directions)
    # Copied rows are not independent measurements.
    own = np.unique(np.column_stack([poses, data.positions_m]), axis=0, return_index=True)[1]
    return scatter_m(data.positions_m[own], poses[own])


def scatter_m(positions: Array, pose: NDArray[np.int64]) -> float:
    """Standard deviation [m], all axes together, of `positions` (N, 3) about their pose's mean; inf without repeats."""
    freedom = len(positions) - len(np.unique(pose))
    if freedom == 0:
        return math.inf
    return math.sqrt(float((without_means(positions, numbered(pose)) ** 2).sum()) / freedom)


def without_means(values: Array, group: NDArray[np.int64]) -> Array:
    """`values` (N, k) with each column's mean over its `group` (N,), numbered from 0, subtracted."""
    sizes = np.maximum(np.bincount(group), 1)
    means = np.column_stack([np.bincount(group, weights=column) for column in values.T]) / sizes[:, None]
    return np.asarray(values - means[group])
