"""The arm and its error vectors for the three-dimensional picture, in integers that take few characters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.report.gathered.state import joint_unit
from armtrue.report.gathered.steps import Step
from armtrue.report.gathered.thinning import spread_rows
from armtrue.report.pictures.effect_picture import corners, typical_pose
from armtrue.tables.chain import chain_from_robot, pose

_MOST_VECTORS = 1500
_WORST_KEPT = 60
_MILLIMETRE = 1e-3
_TENTH_MICROMETRE = 1e-7
# Frames nearer together than this [m] are one corner of the drawn arm.
_SAME_PLACE_M = 1e-3


def arm_corners(step: Step, row: int) -> Array:
    """Corners (M, 3) [m] of the nominal arm at a measured pose, from base to reflector, in the measuring frame."""
    document, data = step.fit.document, step.fit.data
    base = pose(document["measuring_from_base"])
    in_base = corners(chain_from_robot(document["robot"]), data.joints[row], {})
    first, *others = [*(in_base @ base[:3, :3].T + base[:3, 3]), data.positions_m[row]]
    kept = [first]
    for corner in others:
        if np.linalg.norm(corner - kept[-1]) > _SAME_PLACE_M:
            kept.append(corner)
    return np.array(kept)


def scene_rows(step: Step) -> NDArray[np.intp]:
    """Indices of the rows that are drawn: all, or a part of very many that includes the worst."""
    worst = np.argsort(-np.linalg.norm(step.residual_m, axis=1))[:_WORST_KEPT]
    return spread_rows(step.fit.data.count, _MOST_VECTORS, worst)


def scene(steps: list[Step], what: str = "error") -> dict[str, Any]:
    """The data that the viewer draws. `what`: name of the arrows, in a word or two.

    `arm` and `points` in mm, `vectors` (of the first and the last step) in 0.1 µm, `joints` in degrees, `rows` of the
    file.
    """
    shown = [steps[0]] if len(steps) == 1 else [steps[0], steps[-1]]
    last = steps[-1]
    rows, data = scene_rows(last), last.fit.data
    units = [joint_unit(joint) for joint in last.fit.robot.joints]
    joints = data.joints[rows] / np.array([factor for _, factor in units])
    return {
        "arm": _integers(arm_corners(last, typical_pose(data.joints)), _MILLIMETRE),
        "points": _integers(data.positions_m[rows], _MILLIMETRE),
        "vectors": [_integers(step.residual_m[rows], _TENTH_MICROMETRE) for step in shown],
        "what": what,
        "names": [step.called for step in shown],
        "joints": np.round(joints).astype(int).ravel().tolist(),
        "joint_units": [unit for unit, _ in units],
        "rows": data.rows[rows].tolist(),
        "total": data.count,
    }


def _integers(values: Array, unit: float) -> list[int]:
    return [int(v) for v in np.round(np.asarray(values) / unit).ravel()]
