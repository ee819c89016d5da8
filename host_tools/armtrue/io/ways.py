"""Directions of approach to each pose, and the joints' travel in them, derived from the order of the rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.io.columns import commanded_joints

# A commanded joint that moves less than this [rad, m] has not moved.
_STANDSTILL = 1e-6
# Fewer motions may agree with the stated directions by chance.
_FEWEST_MOTIONS = 20
# Largest share of the steps from row to row that may contradict the order, as after interruptions of a session.
_MOST_CONTRADICTIONS = 0.01


def directions(columns: dict[str, Array]) -> dict[str, Array]:
    """Direction in which each joint last moved, from the order of poses; 0 until it first moves."""
    result: dict[str, Array] = {}
    for name in commanded_joints(columns):
        steps = np.diff(columns[name], prepend=columns[name][:1])
        moved = np.abs(steps) > _STANDSTILL
        last_moved = np.maximum.accumulate(np.where(moved, np.arange(steps.size), 0))
        result[f"dir{name[1:]}"] = np.where(moved[last_moved], np.sign(steps[last_moved]), 0.0)
    return result


def travels(columns: dict[str, Array]) -> dict[str, Array]:
    """`travel1…traveln` [rad, m] of the joints whose recorded directions agree with the motion from row to row.

    Rows are in order of time if that was recorded. A joint that came from elsewhere (an intermediate point, another
    program) contradicts its `dir`; a joint that does so more than once in a hundred steps gets no travel.
    """
    order = _order(columns)
    result: dict[str, Array] = {}
    for name in commanded_joints(columns):
        side = columns.get(f"dir{name[1:]}")
        if side is None or f"travel{name[1:]}" in columns:
            continue
        way = _travel(columns[name][order], side[order])
        if way is not None:
            result[f"travel{name[1:]}"] = np.empty(order.size)
            result[f"travel{name[1:]}"][order] = way
    return result


def agreements(columns: dict[str, Array]) -> dict[int, dict[str, float]]:
    """For each joint with a recorded `dir`, the share (0 to 1) of its motions that agree with it, by interpretation.

    "as it stands"; "one row late" and "one row early": the value is in the row after or before its own; "reversed":
    with the other sign; "0 for −1" and "1 for −1, 0 for 1": only if none is −1. A motion is a step from row to row, in
    order of time if that was recorded. Joints with too few motions are left out.
    """
    order = _order(columns)
    result: dict[int, dict[str, float]] = {}
    for name in commanded_joints(columns):
        if f"dir{name[1:]}" not in columns:
            continue
        step, side = np.diff(columns[name][order]), columns[f"dir{name[1:]}"][order]
        # The first and the last row lack a neighbour.
        moved = np.flatnonzero(np.abs(step[:-1]) > _STANDSTILL) + 1
        if moved.size < _FEWEST_MOTIONS:
            continue
        way = np.sign(step[moved - 1])
        read = {
            "as it stands": side[moved],
            "one row late": side[moved + 1],
            "one row early": side[moved - 1],
            "reversed": -side[moved],
        }
        if side.min() == 0.0:
            read |= {"0 for −1": 2.0 * side[moved] - 1.0, "1 for −1, 0 for 1": 1.0 - 2.0 * side[moved]}
        result[int(name[1:])] = {how: float(np.mean(values == way)) for how, values in read.items()}
    return result


def _order(columns: dict[str, Array]) -> NDArray[np.intp]:
    if "time" in columns:
        return np.argsort(columns["time"], kind="stable")
    return np.arange(len(next(iter(columns.values()))))


def _travel(q: Array, side: Array) -> NDArray[np.float64] | None:
    step = np.diff(q)
    moved = np.abs(step) > _STANDSTILL
    contradicts = np.where(moved, np.sign(step), side[:-1]) != side[1:]
    if np.count_nonzero(moved) < _FEWEST_MOTIONS or contradicts.mean() > _MOST_CONTRADICTIONS:
        return None
    # The travel to the first row, and to a row that contradicts, is not known: it is taken as the joint's range, since
    # most motions are long.
    far = float(np.ptp(q))
    result = np.full(q.size, far)
    for row in range(1, q.size):
        if contradicts[row - 1]:
            continue
        goes_on = side[row] == side[row - 1]
        result[row] = abs(step[row - 1]) + (result[row - 1] if goes_on else 0.0)
    return result
