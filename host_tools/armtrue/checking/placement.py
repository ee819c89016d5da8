"""Closed-form lower bound on the residual between arm and points, for hundreds of readings of a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.checking.alignment import Columns
from armtrue.checking.scatter.repeats import set_up_of_row, without_means
from armtrue.io.columns import POSITION
from armtrue.io.robot import Robot
from armtrue.tables.chain import flanges

# A and c of one set-up.
UNKNOWNS_OF_BASE = 12
_AT_A_TIME = 128
_ROBUST_PASSES = 4
# Keeps the normal equations solvable where a tool cannot be told from the base.
_RIDGE = 1e-9


@dataclass(frozen=True)
class Reading:
    """One way to read a file: the columns (q1…qn, x, y, z, target where there is one) and the arm, both as changed."""

    columns: Columns
    spec: dict[str, Any]

    @property
    def robot(self) -> Robot:
        """The arm of this reading."""
        return Robot(self.spec)

    def with_columns(self, **changed: Array) -> Reading:
        """This reading with some columns replaced."""
        return Reading({**self.columns, **changed}, self.spec)

    def with_spec(self, **changed: Any) -> Reading:
        """This reading with some keys of robot.yaml replaced."""
        return Reading(self.columns, {**self.spec, **changed})


def lower_bounds(readings: Sequence[Reading]) -> Array:
    """Approximate least RMS distance of each of `readings` over all bases and tools, relative to the points' spread.

    Base rotation and the measurements' scale are relaxed to any 3 × 3 matrix: p = A x + c − R t is linear in A, c and
    the tool t, where R and p are the flange's attitude and place. Rows with a gross error, as from a bumped reflector,
    get little weight. All readings need the same number of rows.
    """
    found = [_relaxed(readings[first : first + _AT_A_TIME]) for first in range(0, len(readings), _AT_A_TIME)]
    return np.concatenate(found) if found else np.empty(0)


def _relaxed(readings: Sequence[Reading]) -> Array:
    systems = [relaxed_system(reading) for reading in readings]
    # A reading with fewer reflectors has fewer tools: the columns of the others are zero, and so is their solution.
    unknowns = max(system[0].shape[2] for system in systems)
    rows = np.stack(
        [np.pad(system[0], ((0, 0), (0, 0), (0, unknowns - system[0].shape[2]))) for system in systems]
    )  # (H, N, 3, unknowns)
    right = np.stack([system[1] for system in systems])  # (H, N, 3)
    count, poses = rows.shape[:2]
    weight = np.ones((count, poses))
    for _ in range(_ROBUST_PASSES):
        root = np.sqrt(weight)[:, :, None]
        flat = (rows * root[..., None]).reshape(count, 3 * poses, unknowns)
        target = (right * root).reshape(count, 3 * poses, 1)
        normal = np.swapaxes(flat, 1, 2) @ flat
        ridge = _RIDGE * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(unknowns)
        solution = np.linalg.solve(normal + ridge, np.swapaxes(flat, 1, 2) @ target)
        distance = np.linalg.norm(right - (rows @ solution[:, None])[..., 0], axis=2)
        scale = np.maximum(1e-9, 2.0 * np.median(distance, axis=1, keepdims=True))
        weight = 1.0 / (1.0 + (distance / scale) ** 2)
    rms = np.sqrt((weight * distance**2).sum(axis=1) / weight.sum(axis=1))
    # Points were scaled to unit spread: A, the first nine unknowns, gives them this spread on the arm.
    spread = np.linalg.norm(solution[:, :9, 0], axis=1) / np.sqrt(3.0)
    return np.asarray(rms / np.maximum(spread, 1e-12))


def relaxed_system(reading: Reading) -> tuple[Array, Array]:
    """Matrix (N, 3, unknowns) and right side (N, 3) of the relaxed problem: three equations for each measurement.

    Unknowns: the 12 of each set-up of the tracker, then the position of each tool.
    """
    columns = reading.columns
    flange = flanges(columns, reading.spec)
    point = np.column_stack([columns[name] for name in POSITION])
    # Each set-up of the tracker has its own A and c.
    set_up = set_up_of_row(columns)
    point = without_means(point, set_up)
    point = point / max(1e-12, float(np.sqrt((point**2).sum(axis=1).mean())))
    bases = UNKNOWNS_OF_BASE * (int(set_up.max()) + 1)
    codes = np.unique(columns["target"], return_inverse=True)[1] if "target" in columns else None
    tools = 1 if codes is None else int(codes.max()) + 1
    count = len(point)
    rows = np.zeros((count, 3, bases + 3 * tools))
    every = np.arange(count)
    for axis in range(3):
        first = UNKNOWNS_OF_BASE * set_up + 3 * axis
        rows[every[:, None], axis, first[:, None] + np.arange(3)] = point
        rows[every, axis, UNKNOWNS_OF_BASE * set_up + 9 + axis] = 1.0
    for tool in range(tools):
        of_tool = slice(None) if codes is None else codes == tool
        own = slice(bases + 3 * tool, bases + 3 * tool + 3)
        rows[of_tool, :, own] = -flange[of_tool, :3, :3]
    return rows, flange[:, :3, 3]
