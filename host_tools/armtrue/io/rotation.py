"""Conversion of rotations in the forms that files use to matrices and unit quaternions (w, x, y, z).

Arrays may carry any leading dimensions. Formulas: J. Diebel, Representing Attitude: Euler Angles, Unit Quaternions,
and Rotation Vectors, Stanford 2006.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armtrue.arrays import Array


def matrix_about(axis: str, angle_rad: ArrayLike) -> Array:
    """Rotation matrix (…, 3, 3) about the coordinate axis `x`, `y` or `z`."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    matrix = np.zeros((*angle.shape, 3, 3))
    matrix[..., k, k] = 1.0
    matrix[..., i, i] = matrix[..., j, j] = np.cos(angle)
    matrix[..., j, i] = np.sin(angle)
    matrix[..., i, j] = -matrix[..., j, i]
    return matrix


def matrix_from_euler(angles_rad: ArrayLike, sequence: str, intrinsic: bool) -> Array:
    """Rotation matrix (…, 3, 3) from angles (…, 3) about the axes of `sequence`, such as `xyz`.

    Intrinsic: each turn about the axes as turned by those before. Extrinsic: about the fixed axes.
    """
    angles = np.asarray(angles_rad, dtype=np.float64)
    turns = [matrix_about(axis, angles[..., i]) for i, axis in enumerate(sequence)]
    first, second, third = turns if intrinsic else turns[::-1]
    return np.asarray(first @ second @ third, dtype=np.float64)


def matrix_from_rpy(rpy_rad: ArrayLike) -> Array:
    """Rotation matrix from roll, pitch, yaw about the fixed axes x, y, z: the convention of robot.yaml and URDF."""
    return matrix_from_euler(rpy_rad, "xyz", intrinsic=False)


def rpy_from_matrix(matrix: Array) -> list[float]:
    """Roll, pitch, yaw (fixed axes x, y, z) of one rotation matrix; at pitch ±90° the roll is taken as 0."""
    cosine = float(np.hypot(matrix[0, 0], matrix[1, 0]))
    pitch = float(np.arctan2(-matrix[2, 0], cosine))
    if cosine <= 1e-9:
        return [0.0, pitch, float(np.arctan2(-matrix[0, 1], matrix[1, 1]))]
    roll = float(np.arctan2(matrix[2, 1], matrix[2, 2]))
    return [roll, pitch, float(np.arctan2(matrix[1, 0], matrix[0, 0]))]


def matrix_from_rotation_vector(vector_rad: ArrayLike) -> Array:
    """Rotation matrix (…, 3, 3) from axis times angle (…, 3): Rodrigues' formula."""
    vector = np.asarray(vector_rad, dtype=np.float64)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    # np.sinc(t) is sin(pi t) / (pi t): both factors stay exact where the angle is 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross), dtype=np.float64)


def quaternion_from_matrix(matrix: Array) -> Array:
    """Unit quaternion (…, 4), w first and not negative, from rotation matrices (…, 3, 3).

    Takes the largest of the four components as the divisor (Shepperd 1978), so that no rotation loses precision.
    """
    m = np.asarray(matrix, dtype=np.float64)
    d0, d1, d2 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    fourfold_squares = np.stack(
        [1 + d0 + d1 + d2, 1 + d0 - d1 - d2, 1 - d0 + d1 - d2, 1 - d0 - d1 + d2], axis=-1
    )
    wx, wy, wz = (m[..., j, i] - m[..., i, j] for i, j in ((1, 2), (2, 0), (0, 1)))
    xy, xz, yz = (m[..., j, i] + m[..., i, j] for i, j in ((0, 1), (0, 2), (1, 2)))
    w2, x2, y2, z2 = np.moveaxis(fourfold_squares, -1, 0)
    products = np.stack(
        [
            np.stack([w2, wx, wy, wz], axis=-1),
            np.stack([wx, x2, xy, xz], axis=-1),
            np.stack([wy, xy, y2, yz], axis=-1),
            np.stack([wz, xz, yz, z2], axis=-1),
        ],
        axis=-2,
    )
    largest = np.argmax(fourfold_squares, axis=-1)
    quaternion = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    quaternion = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return np.asarray(np.where(quaternion[..., :1] < 0, -quaternion, quaternion), dtype=np.float64)
