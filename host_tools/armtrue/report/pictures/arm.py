"""The arm and its error vectors for the three-dimensional picture, in integers that take few characters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.report.gathered.state import joint_unit
from armtrue.report.gathered.steps import Step
from armtrue.report.gathered.thinning import spread_rows
from armtrue.tables.chain import chain_from_robot, pose

_MOST_VECTORS = 1500
_WORST_KEPT = 60
_MILLIMETRE = 1e-3
_TENTH_MICROMETRE = 1e-7
# Frames nearer together than this [m] are one corner of the drawn arm.
_SAME_PLACE_M = 1e-3


def arm_corners(step: Step, row: int) -> Array:
    """Corners (M, 3) [m] of the nominal arm at a measured pose, from base to reflector, in the measuring frame."""
    fit = step.fit
    document = fit.document
    chain = chain_from_robot(document["robot"])
    measuring_from_base = pose(document["measuring_from_base"])
    frames = chain.frames(fit.data.joints[row : row + 1])
    corners = [np.zeros(3), *(frame[0, :3, 3] for frame in frames)]
    corners.append((frames[-1][0] @ chain.end)[:3, 3])
    placed = [measuring_from_base[:3, :3] @ corner + measuring_from_base[:3, 3] for corner in corners]
    placed.append(fit.data.positions_m[row])
    kept = [placed[0]]
    for corner in placed[1:]:
        if np.linalg.norm(corner - kept[-1]) > _SAME_PLACE_M:
            kept.append(corner)
    return np.array(kept)


def typical_pose(joints: Array) -> int:
    """The row of joints (N, n) that is nearest to the median of all."""
    spread = np.maximum(np.ptp(joints, axis=0), 1e-9)
    return int(np.argmin(np.sum(((joints - np.median(joints, axis=0)) / spread) ** 2, axis=1)))


def typical_row(step: Step) -> int:
    """The measured pose whose joints are nearest to the median of all."""
    return typical_pose(step.fit.data.joints)


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
        "arm": _integers(arm_corners(last, typical_row(last)), _MILLIMETRE),
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
