"""Causes that can resemble a step: drift, temperature, loads, approach directions, periodic errors of joints.

They are projected out of the residuals before a step is searched, so that none is taken for one.
"""

from __future__ import annotations

import numpy as np

from armtrue.arrays import Array
from armtrue.checking.moved.geometry import Geometry, moved_by, seen_part
from armtrue.io.columns import commanded_joints
from armtrue.io.dataset import Dataset

_LEAST_SEEN = 1e-3
# Powers above 1 describe a drift that is not linear, such as a warm-up.
_POWERS_OF_TIME = (1, 2, 3)
_HARMONICS = (1, 2)


def span_of_all_else(data: Dataset, geometry: Geometry, progress: Array) -> Array:
    """Orthonormal basis (3N, r) of geometry and these causes; `progress` (N,): from -1 to 1 in order of time.

    Groups of causes are added, the likelier first, while the unknowns are at most a third of the equations.
    """
    count = data.count
    weight = np.repeat(geometry.follows.astype(np.float64), 3)[:, None]
    parts, unknowns = [geometry.span], geometry.span.shape[1]
    for group in _groups(data, geometry, progress):
        if group and unknowns + len(group) <= count:
            parts.append(np.stack(group, axis=2).reshape(3 * count, -1) * weight)
            unknowns += len(group)
    design = np.hstack(parts)
    design = design / np.maximum(1e-15, np.linalg.norm(design, axis=0))
    return seen_part(design, _LEAST_SEEN)[0]


def _groups(data: Dataset, geometry: Geometry, progress: Array) -> list[list[Array]]:
    base = [moved_by(geometry.frames[0], geometry.points, geometry.reach_m)[:, axis] for axis in range(6)]
    motors = [_by_joint(geometry, k) for k in range(geometry.chain.joint_count)]
    joints = np.column_stack([data.columns[name] for name in commanded_joints(data.columns)])
    link = geometry.chain.link_variables(joints)
    temperatures = [values for name, values in data.columns.items() if name.startswith("temp_")]
    warmths = [values - values.mean() for values in temperatures if np.ptp(values) > 0.0]
    came_from = [data.columns.get(f"dir{k}") for k in range(1, len(motors) + 1)]
    with_sides = zip(motors, came_from, strict=True)
    directions = [motor * side[:, None] for motor, side in with_sides if side is not None]
    turning = [k for k in range(len(motors)) if not geometry.chain.prismatic[k]]
    # Displacements of the points for joint errors sin(angle), cos(angle).
    angles = [[(motors[k], order * link[:, k]) for k in turning] for order in _HARMONICS]
    waves = [
        [motor * wave(a)[:, None] for motor, a in group for wave in (np.sin, np.cos)] for group in angles
    ]
    return [
        [one * (progress**power)[:, None] for power in _POWERS_OF_TIME for one in base],
        [motor * progress[:, None] for motor in motors],
        _by_loads(data, geometry, motors),
        directions,
        [one * warmth[:, None] for warmth in warmths for one in [*base, *motors]],
        *waves,
    ]


def _by_joint(geometry: Geometry, k: int) -> Array:
    """Shifts of the points (N, 3) per unit of joint `k`, from 0: [m per m], turns in metres at full reach."""
    frame = geometry.frames[k + 1]
    axis = frame[:, :3, 2]
    if geometry.chain.prismatic[k]:
        return np.asarray(axis)
    return np.asarray(np.cross(axis, geometry.points - frame[:, :3, 3]) / geometry.reach_m)


def _by_loads(data: Dataset, geometry: Geometry, motors: list[Array]) -> list[Array]:
    """Shifts of the points by compliant joints under a weight at each later frame, and the payload at the tool."""
    gravity = geometry.frames[0][0, :3, :3] @ geometry.chain.gravity
    payload = data.columns.get("payload", np.zeros(data.count))
    loads = []
    for k, motor in enumerate(motors):
        if geometry.chain.prismatic[k]:
            continue
        frame = geometry.frames[k + 1]
        places = [*(later[:, :3, 3] for later in geometry.frames[k + 2 :]), geometry.points]
        for place in places:
            torque = np.cross(frame[:, :3, 2], place - frame[:, :3, 3]) @ gravity
            if np.ptp(torque) > 1e-6:
                loads.append(motor * torque[:, None])
        if np.ptp(payload) > 0.0:
            loads.append(motor * (torque * payload)[:, None])
    return loads
