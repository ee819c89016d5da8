"""Joints that stand at a few values each, on a grid: such poses do not show what a joint does between its values."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.checking.report import Finding
from armtrue.io.dataset import Dataset
from armtrue.io.robot import Robot

# An axis with two positions is an index: it is corrected at these two only. With more than eight values the steps are
# short enough for the slow waves of gears.
_FEWEST_VALUES = 3
_MOST_VALUES = 8
# A value on a grid is taken at many poses; with fewer for each, the values are those of so many poses.
_POSES_PER_VALUE = 3
# Joint values closer than this are one value, [rad] and [m]: drives stop within it.
_SAME_TURN = math.radians(0.1)
_SAME_WAY_M = 1e-4
# A joint that moves by less has no waves to be taken for others [rad, m].
_LEAST_TURN = math.radians(20.0)
_LEAST_WAY_M = 0.02


def find(data: Dataset, robot: Robot) -> Iterator[Finding]:
    """A warning that names all joints with few values. `data`: joints in radians and metres."""
    same = {k: _same(robot, k) for k in robot.motors}
    counts = {k: count for k in robot.motors if (count := _count(data.columns[f"q{k}"], *same[k]))}
    if not counts:
        return
    values = np.column_stack([_numbered(data.columns[f"q{k}"], same[k][0]) for k in robot.motors])
    poses = len(np.unique(values, axis=0))
    counts = {k: count for k, count in counts.items() if _POSES_PER_VALUE * count <= poses}
    if counts:
        yield _finding(data, counts, poses)


def _same(robot: Robot, k: int) -> tuple[float, float]:
    """The distance within which values of joint `k` are one, and the least range that counts as motion."""
    revolute = robot.joints[k - 1]["type"] == "revolute"
    return (_SAME_TURN, _LEAST_TURN) if revolute else (_SAME_WAY_M, _LEAST_WAY_M)


def _count(values: Array, same: float, least: float) -> int:
    """The number of different `values` if they are few and the joint moves, else 0."""
    if not values.size or float(np.ptp(values)) < least:
        return 0
    count = len(_least_of_each(values, same, _MOST_VALUES + 1))
    return count if _FEWEST_VALUES <= count <= _MOST_VALUES else 0


def _least_of_each(values: Array, same: float, most: int) -> list[float]:
    """The different `values`, of each the least one, rising; not more than `most`."""
    ordered = np.sort(values)
    found: list[float] = []
    at = 0
    while at < ordered.size and len(found) < most:
        found.append(float(ordered[at]))
        at = int(np.searchsorted(ordered, found[-1] + same, side="right"))
    return found


def _numbered(values: Array, same: float) -> NDArray[np.int64]:
    """The number (N,) of each of the different `values`."""
    return np.searchsorted(_least_of_each(values, same, values.size), values, side="right").astype(np.int64)


def _finding(data: Dataset, counts: dict[int, int], poses: int) -> Finding:
    joints: dict[int, list[str]] = {}
    for k, count in counts.items():
        joints.setdefault(count, []).append(f"q{k}")
    words = [f"{count} values of {', '.join(names)}" for count, names in joints.items()]
    listed = " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
    return Finding(
        "few_joint_values",
        "warning",
        f"{data.file.name}: found only {listed} in {poses} poses, a coarse grid: errors between these values do not "
        "show, not even in the held-out error, because the held-out poses have the same values; and periodic errors "
        "of a joint with short periods look like slow ones on this grid (aliasing), so a fit may confuse them",
        {"values": {str(k): count for k, count in counts.items()}, "poses": poses},
        "Add 20 or more poses with these joints at random within their ranges, or those of "
        "'armtrue plan --robot R --model M --poses 20'. Nothing to do for a joint that is only ever used at these "
        "values.",
    )
