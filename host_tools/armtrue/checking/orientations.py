"""Orientations that do not turn with the arm: another order of the quaternion, the inverse, other Euler angles."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from armtrue.arrays import Array, nearest_rotation, rigid_motion
from armtrue.checking.alignment import Columns, align, alignment_columns, evenly, thinned
from armtrue.checking.report import Finding
from armtrue.io.columns import POSITION, QUATERNION
from armtrue.io.dataset import Dataset
from armtrue.io.layout import TURNS, RotationSource
from armtrue.io.robot import Robot
from armtrue.io.rotation import matrix_from_euler, matrix_from_rotation_vector
from armtrue.tables.chain import flanges, pose

# Nominal kinematics give the tool's orientation within a degree or two; a wrong convention is off by tens of degrees.
_LARGEST_ANGLE = math.radians(5.0)
_ROWS = 60
# A set-up with fewer rows keeps the base of the first one.
_FEWEST_OF_SET_UP = 4
_REMEDY = "Correct the rotation's order, sequence, axes or unit in dataset.yaml; until then fit without orientations."
# Other meanings of the columns as read: places of w, x, y, z among them, and whether the rotation is inverted.
_MEANT = {
    "the quaternion's components are in the order w, x, y, z and were read as x, y, z, w": (
        (1, 2, 3, 0),
        False,
    ),
    "the quaternion's components are in the order x, y, z, w and were read as w, x, y, z": (
        (3, 0, 1, 2),
        False,
    ),
    "the rotations are those of the measuring frame in the tool, the inverse of what is expected": (
        (0, 1, 2, 3),
        True,
    ),
}


def find(data: Dataset, measured: Columns, robot: Robot) -> list[Finding]:
    """One error if orientations do not follow the joints, with the convention under which they do, if there is one.

    `measured`: the joints of `data` in radians, whatever the file has them in.
    """
    if not all(name in data.columns for name in QUATERNION):
        return []
    quaternion = np.column_stack([data.columns[name] for name in QUATERNION])
    whole = np.isfinite(quaternion).all(axis=1) & (np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) < 0.1)
    if np.count_nonzero(whole) < 4:
        return []
    nominal = _nominal(measured, robot)
    target = data.columns.get("target", np.zeros(data.count))

    def typical_angle(places: tuple[int, ...], inverted: bool) -> float:
        turned = _matrices(quaternion[:, places])
        turned = np.swapaxes(turned, 1, 2) if inverted else turned
        return _typical_angle(nominal[whole], turned[whole], target[whole])

    angle = typical_angle((0, 1, 2, 3), False)
    if angle <= _LARGEST_ANGLE:
        return []
    words = f"measured orientations do not turn with the arm: typically {math.degrees(angle):.0f}° away"
    meant = (words for words, reading in _MEANT.items() if typical_angle(*reading) <= _LARGEST_ANGLE)
    if likeliest := next(meant, None):
        words += f"; they do where {likeliest}"
    evidence: dict[str, Any] = {"typical_angle_rad": angle}
    remedy = _REMEDY
    if data.turns is not None and data.rotation is not None:
        left, keys = _best_convention(nominal[whole], data.turns[whole], target[whole], data.rotation)
        if left <= _LARGEST_ANGLE:
            evidence["typical_angle_rad_if_changed"] = left
            words += f", and {math.degrees(left):.2g}° with the best of the other conventions"
            listed = {**keys, "columns": f"[{', '.join(keys['columns'])}]"}
            form = ", ".join(f"{key}: {value}" for key, value in listed.items())
            remedy = f"Give dataset.yaml 'rotation: {{{form}}}'."
    return [Finding("orientations_do_not_follow", "error", words, evidence, remedy)]


def rotation_that_follows(
    data: Dataset, robot: Robot, keys: dict[str, Any]
) -> tuple[dict[str, Any], float] | None:
    """The keys of dataset.yaml's `rotation` under which orientations follow the arm, and the median angle [degrees].

    `keys`: those under which `data` was read. None if orientations follow under no keys.
    """
    measured = alignment_columns(data)
    nominal = _nominal(measured, robot)
    target = data.columns.get("target", np.zeros(data.count))
    if data.turns is None:
        quaternion = np.column_stack([data.columns[name] for name in QUATERNION])
        if keys["form"] == "matrix":
            return _matrix_that_follows(nominal, _matrices(quaternion), target, keys)
        orders = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}
        turned = {order: _matrices(quaternion[:, places]) for order, places in orders.items()}
        angle, best = min((_typical_angle(nominal, turned[order], target), order) for order in orders)
        return ({**keys, "order": best}, math.degrees(angle)) if angle <= _LARGEST_ANGLE else None
    as_vector = _typical_angle(nominal, matrix_from_rotation_vector(data.turns), target)
    if as_vector <= _LARGEST_ANGLE:
        vector = {"form": "rotation_vector", "columns": keys["columns"], "unit": keys["unit"]}
        return vector, math.degrees(as_vector)
    assert data.rotation is not None
    left, named = _best_convention(nominal, data.turns, target, data.rotation)
    return (named, math.degrees(left)) if left <= _LARGEST_ANGLE else None


def _matrix_that_follows(
    nominal: Array, measured: Array, target: Array, keys: dict[str, Any]
) -> tuple[dict[str, Any], float] | None:
    """The keys with the matrix columns in the given or the transposed order, whichever follows the arm; else None."""
    names = keys["columns"]
    inverse = [names[3 * k + i] for i in range(3) for k in range(3)]
    for columns, matrices in ((names, measured), (inverse, np.swapaxes(measured, 1, 2))):
        angle = _typical_angle(nominal, matrices, target)
        if angle <= _LARGEST_ANGLE:
            return {**keys, "columns": columns}, math.degrees(angle)
    return None


def _nominal(measured: Columns, robot: Robot) -> Array:
    """Rotations (N, 3, 3) measuring_from_flange, with nominal kinematics and the aligned base of each set-up."""
    alignment = align(thinned(measured, _ROWS), robot)
    flange = pose(dict(alignment.measuring_from_base)) @ flanges(measured, robot.spec)
    rotation = flange[:, :3, :3].copy()
    if "station" not in measured:
        return rotation
    first = next(iter(alignment.flange_from_tool.values()))
    targets = measured.get("target", np.zeros(len(flange))).astype(np.int64)
    tools = np.array([alignment.flange_from_tool.get(str(code), first)["xyz"] for code in targets])
    points = np.einsum("nij,nj->ni", rotation, tools) + flange[:, :3, 3]
    seen = np.column_stack([measured[name] for name in POSITION])
    for station in np.unique(measured["station"]):
        rows = measured["station"] == station
        if np.count_nonzero(rows) >= _FEWEST_OF_SET_UP:
            rotation[rows] = rigid_motion(points[rows], seen[rows])[:3, :3] @ rotation[rows]
    return rotation


def _best_convention(
    nominal: Array, turns: Array, target: Array, source: RotationSource
) -> tuple[float, dict[str, Any]]:
    """The median angle [rad] and the keys of the Euler convention under which the orientations follow best.

    `turns`: the file's angles (N, 3) [rad] as read by `source`. Among equals the one with the fewest changes is taken.
    """
    chosen = evenly(len(turns), _ROWS)
    # Both units are tried with every sequence: under a wrong unit no sequence follows.
    units = {"deg": math.pi / 180.0, "rad": 1.0}
    own_unit = next((unit for unit, factor in units.items() if factor == source.factor), "mrad")
    best: tuple[float, int, dict[str, Any]] = (math.inf, 0, {})
    for unit, order, sequence, intrinsic in itertools.product(
        units, itertools.permutations(range(3)), TURNS, (True, False)
    ):
        values = turns[chosen][:, order] * (units[unit] / source.factor)
        matrices = matrix_from_euler(values, sequence, intrinsic)
        left = _typical_angle(nominal[chosen], matrices, target[chosen])
        changes = (unit != own_unit) + (sequence != source.sequence) + (intrinsic != source.intrinsic)
        changes += 2 * (order != (0, 1, 2))
        # Rounded, so that equivalent conventions are equal: intrinsic XYZ is extrinsic ZYX with its columns reversed.
        rank = (round(left, 6), changes)
        if rank < best[:2]:
            columns, axes = [source.headers[at] for at in order], "intrinsic" if intrinsic else "extrinsic"
            keys = {
                "form": "euler",
                "columns": columns,
                "sequence": sequence.upper(),
                "axes": axes,
                "unit": unit,
            }
            best = (*rank, keys)
    return best[0], best[2]


def _typical_angle(nominal: Array, measured: Array, target: Array) -> float:
    """Median angle [rad] between measured and nominal orientations, with the best attitude of each target."""
    angles = []
    for one in np.unique(target):
        rows = target == one
        relative = np.swapaxes(nominal[rows], 1, 2) @ measured[rows]
        attitude = nearest_rotation(relative.sum(axis=0))
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
