"""Orientations that do not turn with the arm: another order of the quaternion, the inverse, other Euler angles."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.checking.alignment import Columns, align, thinned
from armtrue.checking.report import Finding
from armtrue.io.columns import QUATERNION, commanded_joints
from armtrue.io.dataset import Dataset
from armtrue.io.layout import TURNS, RotationSource
from armtrue.io.robot import Robot
from armtrue.io.rotation import matrix_from_euler

Array = NDArray[np.float64]

# Nominal arms turn their tool within a degree or two of the truth; a wrong convention misses by tens.
_LARGEST_ANGLE = math.radians(5.0)
_ROWS = 60
_REMEDY = (
    "Mend the rotation's order, sequence, axes or unit in dataset.yaml; until then fit without orientations."
)
# What was meant by the columns as they were read: places of w, x, y, z among them, whether inverted, and in words.
_MEANT = (
    (
        (1, 2, 3, 0),
        False,
        "the quaternion's numbers stand in the order w, x, y, z and were read as x, y, z, w",
    ),
    (
        (3, 0, 1, 2),
        False,
        "the quaternion's numbers stand in the order x, y, z, w and were read as w, x, y, z",
    ),
    (
        (0, 1, 2, 3),
        True,
        "the rotations are those of the measuring frame in the tool, the inverse of what is expected",
    ),
)


def find(data: Dataset, measured: Columns, robot: Robot) -> list[Finding]:
    """One error where orientations do not follow the joints, with the convention that mends it where one does.

    `measured`: the joints of `data` in radians, whatever the file has them in.
    """
    if not all(name in data.columns for name in QUATERNION):
        return []
    from armtrue.tables.chain import chain_from_robot, pose

    quaternion = np.column_stack([data.columns[name] for name in QUATERNION])
    whole = np.isfinite(quaternion).all(axis=1) & (np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) < 0.1)
    if np.count_nonzero(whole) < 4:
        return []
    alignment = align(thinned(measured, _ROWS), robot)
    chain = chain_from_robot(robot.spec)
    flange = (
        chain.frames(np.column_stack([measured[name] for name in commanded_joints(measured)]))[-1] @ chain.end
    )
    nominal = pose(dict(alignment.measuring_from_base))[:3, :3] @ flange[:, :3, :3]
    target = data.columns.get("target", np.zeros(data.count))

    def typical_angle(places: tuple[int, ...], inverted: bool) -> float:
        turned = _matrices(quaternion[:, places])
        turned = np.swapaxes(turned, 1, 2) if inverted else turned
        return _typical_angle(nominal[whole], turned[whole], target[whole])

    angle = typical_angle((0, 1, 2, 3), False)
    if angle <= _LARGEST_ANGLE:
        return []
    words = f"measured orientations do not turn with the arm: typically {math.degrees(angle):.0f}° away"
    for places, inverted, meant in _MEANT:
        if typical_angle(places, inverted) <= _LARGEST_ANGLE:
            words += f"; they do where {meant}"
            break
    evidence: dict[str, Any] = {"typical_angle_rad": angle}
    remedy = _REMEDY
    if data.turns is not None and data.rotation is not None:
        left, keys = _best_convention(nominal[whole], data.turns[whole], target[whole], data.rotation)
        if left <= _LARGEST_ANGLE:
            evidence["typical_angle_rad_if_changed"] = left
            words += f", and {math.degrees(left):.2g}° where they are read otherwise"
            remedy = f"Give dataset.yaml 'rotation: {keys}'."
    return [Finding("orientations_do_not_follow", "error", words, evidence, remedy)]


def _best_convention(
    nominal: Array, turns: Array, target: Array, source: RotationSource
) -> tuple[float, str]:
    """The typical angle [rad] of the convention of Euler angles under which they follow best, and its keys.

    `turns`: the file's angles (N, 3) [rad] as read by `source`. The fewest changes come first among equals.
    """
    chosen = np.unique(np.linspace(0, len(turns) - 1, _ROWS).astype(np.int64))
    # Degrees read as radians or the other way round change what every sequence makes of them.
    units = {"deg": math.pi / 180.0, "rad": 1.0}
    own_unit = next((unit for unit, factor in units.items() if factor == source.factor), "mrad")
    best = (math.inf, 0, "")
    for unit, order, sequence, intrinsic in itertools.product(
        units, itertools.permutations(range(3)), TURNS, (True, False)
    ):
        values = turns[chosen][:, order] * (units[unit] / source.factor)
        matrices = matrix_from_euler(values, sequence, intrinsic)
        left = _typical_angle(nominal[chosen], matrices, target[chosen])
        changes = (unit != own_unit) + (sequence != source.sequence) + (intrinsic != source.intrinsic)
        changes += 2 * (order != (0, 1, 2))
        # Angles apart by rounding are equal: intrinsic XYZ is extrinsic ZYX with its columns the other way round.
        rank = (round(left, 6), changes)
        if rank < best[:2]:
            columns = ", ".join(source.headers[at] for at in order)
            axes = "intrinsic" if intrinsic else "extrinsic"
            keys = f"{{form: euler, columns: [{columns}], sequence: {sequence.upper()}, axes: {axes}, unit: {unit}}}"
            best = (*rank, keys)
    return best[0], best[2]


def _typical_angle(nominal: Array, measured: Array, target: Array) -> float:
    """Median angle [rad] between what is measured and the arm with the attitude of each target found."""
    angles = []
    for one in np.unique(target):
        rows = target == one
        relative = np.swapaxes(nominal[rows], 1, 2) @ measured[rows]
        u, _, vt = np.linalg.svd(relative.sum(axis=0))
        attitude = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        cosine = (np.einsum("nij,ij->n", relative, attitude) - 1.0) / 2.0
        angles.append(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return float(np.median(np.concatenate(angles)))


def _matrices(quaternion: Array) -> Array:
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
