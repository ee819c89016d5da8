"""The array type of this package, and what several modules compute of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Doubles, of the shape that a function's docstring gives.
Array = NDArray[np.float64]


def rms_length(vectors: Array) -> float:
    """Root mean square length of `vectors` (N, k)."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def nearest_rotation(matrix: Array) -> Array:
    """The rotation (3, 3) nearest to a matrix (Kabsch)."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def rigid_motion(source: Array, goal: Array) -> Array:
    """The 4 × 4 rigid motion of `source` (N, 3) onto `goal` (N, 3) with the least sum of squared distances."""
    from_middle, to_middle = source.mean(axis=0), goal.mean(axis=0)
    result = np.eye(4)
    result[:3, :3] = nearest_rotation((source - from_middle).T @ (goal - to_middle)).T
    result[:3, 3] = to_middle - result[:3, :3] @ from_middle
    return result
