"""Rotations and poses as plain arrays. A pose is a pair (rotation, translation); batches lead with N."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]


def rot_x(angle: float) -> Array:
    """3x3 rotation about x by `angle` radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rot_z(angle: float) -> Array:
    """3x3 rotation about z by `angle` radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def matrix_from_rpy(rpy: Sequence[float] | Array) -> Array:
    """3x3 rotation from roll, pitch, yaw about the *fixed* axes x, y, z (contract.md): Rz(y) Ry(p) Rx(r)."""
    roll, pitch, yaw = (float(v) for v in rpy)
    c, s = np.cos(pitch), np.sin(pitch)
    return rot_z(yaw) @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) @ rot_x(roll)


def rpy_from_matrix(rotation: Array) -> Array:
    """Roll, pitch, yaw (radians) of a 3x3 rotation; pitch within +-pi/2."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([roll, pitch, yaw])


def exp_so3(vector: Array) -> Array:
    """Rotations exp([v]x) of rotation vectors (..., 3), in radians, as (..., 3, 3): Rodrigues' formula."""
    vector = np.asarray(vector, dtype=float)
    angle2 = np.einsum("...i,...i->...", vector, vector)
    angle = np.sqrt(angle2)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    # The series keeps full precision where the quotients would cancel.
    sinc = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    cosc = np.where(small, 0.5 - angle2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    skew = np.zeros((*vector.shape[:-1], 3, 3))
    skew[..., 0, 1], skew[..., 0, 2] = -vector[..., 2], vector[..., 1]
    skew[..., 1, 0], skew[..., 1, 2] = vector[..., 2], -vector[..., 0]
    skew[..., 2, 0], skew[..., 2, 1] = -vector[..., 1], vector[..., 0]
    return np.eye(3) + sinc[..., None, None] * skew + cosc[..., None, None] * (skew @ skew)


def quaternion_from_matrix(rotation: Array) -> Array:
    """Unit quaternions (w, x, y, z), w >= 0, of rotations (N, 3, 3), as (N, 4).

    Bar-Itzhack's eigenvector form, chosen because it needs no case distinction near a half turn.
    """
    r = rotation
    k = np.empty((len(r), 4, 4))
    k[:, 0, 0] = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    for i in range(3):
        j, m = (i + 1) % 3, (i + 2) % 3
        k[:, 0, i + 1] = k[:, i + 1, 0] = r[:, m, j] - r[:, j, m]
        k[:, i + 1, i + 1] = r[:, i, i] - r[:, j, j] - r[:, m, m]
        k[:, i + 1, j + 1] = k[:, j + 1, i + 1] = r[:, j, i] + r[:, i, j]
    q = np.linalg.eigh(k)[1][:, :, -1]
    return q * np.where(q[:, :1] < 0.0, -1.0, 1.0)


@dataclass(frozen=True)
class Pose:
    """A rigid transform `parent_from_child`: 3x3 rotation and translation in metres."""

    rotation: Array
    translation: Array

    @classmethod
    def identity(cls) -> Pose:
        """The transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_xyz_rpy(cls, xyz: Sequence[float], rpy: Sequence[float]) -> Pose:
        """From metres and fixed-axes roll, pitch, yaw in radians."""
        return cls(matrix_from_rpy(rpy), np.asarray(xyz, dtype=float))

    @classmethod
    def from_vector(cls, tx_ty_tz_rx_ry_rz: Sequence[float] | Array) -> Pose:
        """Trans(t) exp([r]x): the virtual joint V of docs/model.md."""
        v = np.asarray(tx_ty_tz_rx_ry_rz, dtype=float)
        return cls(exp_so3(v[3:]), v[:3])

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Pose:
        """The transform the other way."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def xyz_rpy(self) -> dict[str, list[float]]:
        """As robot.yaml writes it: {"xyz": [3], "rpy": [3]}."""
        return {
            "xyz": [float(v) for v in self.translation],
            "rpy": [float(v) for v in rpy_from_matrix(self.rotation)],
        }
