"""Base and tool found with nominal kinematics, without starting values; a wrong convention leaves a larger residual."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.io.columns import POSITION, commanded_joints
from armtrue.io.dataset import Dataset
from armtrue.io.robot import Robot

Columns = dict[str, Array]

# The largest distance per metre of reach that nominal geometry leaves under the right conventions.
NOMINAL_ERROR_PER_REACH = 0.01


@dataclass(frozen=True)
class Alignment:
    """Base, tools and residuals with nominal kinematics. `scale`: 1000 if positions are in millimetres."""

    rms_m: float
    scale: float
    measuring_from_base: dict[str, list[float]]
    flange_from_tool: dict[str, dict[str, list[float]]]
    residual_m: Array


def align(columns: Columns, robot: Robot) -> Alignment:
    """Align `columns` (q1…qn, x, y, z, and target if present) with `robot`.

    Errors: ValueError if there are too few rows to align.
    """
    from armtrue import _core

    found: dict[str, Any] = json.loads(_core.align(robot.json(), columns))
    return Alignment(
        found["rms_m"],
        found["scale"],
        found["measuring_from_base"],
        found["flange_from_tool"],
        np.asarray(found["residual_m"], dtype=np.float64),
    )


def alignment_columns(data: Dataset) -> Columns:
    """The columns of `data` that an alignment reads; without orientations, whose conventions are not yet checked."""
    kept = [name for name in ("target", "station") if name in data.columns]
    wanted = [*commanded_joints(data.columns), *POSITION, *kept]
    return {name: data.columns[name] for name in wanted}


def thinned(columns: Columns, most_rows: int) -> Columns:
    """At most `most_rows` rows, spread evenly over the file."""
    chosen = evenly(len(next(iter(columns.values()))), most_rows)
    return {name: values[chosen] for name, values in columns.items()}


def evenly(count: int, most: int) -> NDArray[np.int64]:
    """At most `most` of the indices 0 to `count` - 1, spread evenly."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).astype(np.int64))
