"""Grids of corrections over any three variables, to compare joint space with Cartesian space on the same data.

Not the product's grid (fitter/effects/residual_grid.cc): a plain one in numpy, the same for both spaces, so that
nothing but the variables differs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FOLDS = 4
# Ratios of a node's second difference to a residual's noise: the strength with the least held-out error is taken.
SMOOTHNESS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
# Values are held four times as loosely as second differences, as in the product.
VALUE = 4.0


@dataclass
class Grid:
    """A multilinear grid over three variables with three values a node.

    low, high (3,): of the variables over the data. counts: nodes on each axis. values (nodes, 3) [m]. covered (nodes,):
    nodes of cells that hold data; the others stay zero.
    """

    low: Array
    high: Array
    counts: tuple[int, int, int]
    values: Array
    covered: NDArray[np.bool_]
    held_out_rms: float

    def evaluate(self, points: Array) -> Array:
        """Corrections (N, 3) [m] at points (N, 3); they fade to zero over the outermost cell's width outside."""
        return weights(points, self.low, self.high, self.counts) @ self.values


def weights(points: Array, low: Array, high: Array, counts: tuple[int, int, int]) -> Array:
    """Multilinear weights (N, nodes) of all nodes at points (N, 3)."""
    result = np.ones((len(points), 1))
    for axis, count in enumerate(counts):
        place = (points[:, axis] - low[axis]) / (high[axis] - low[axis]) * (count - 1)
        hats = np.clip(1.0 - np.abs(place[:, None] - np.arange(count)), 0.0, 1.0)
        result = (result[:, :, None] * hats[:, None, :]).reshape(len(points), -1)
    return result


def fit_grid(points: Array, errors: Array, counts: tuple[int, int, int], seed: int = 0) -> Grid:
    """Fit a grid to errors (N, 3) [m] at points (N, 3), its smoothness by cross-validation."""
    low, high = points.min(axis=0), points.max(axis=0)
    basis = weights(points, low, high, counts)
    covered = covered_nodes(points, low, high, counts)
    seen = basis[:, covered]
    penalties = _penalties(counts, covered)
    noise = float(np.median(np.abs(errors))) or 1.0
    fold = np.random.default_rng(seed).permutation(len(points)) % FOLDS
    best = (np.inf, SMOOTHNESS[0])
    for strength in SMOOTHNESS:
        left = np.concatenate(
            [
                errors[fold == f]
                - seen[fold == f] @ _solve(seen[fold != f], errors[fold != f], penalties, strength, noise)
                for f in range(FOLDS)
            ]
        )
        best = min(best, (float(np.sqrt(np.mean(np.sum(left**2, axis=1)))), strength))
    values = np.zeros((basis.shape[1], 3))
    values[covered] = _solve(seen, errors, penalties, best[1], noise)
    return Grid(low, high, counts, values, covered, best[0])


def covered_nodes(points: Array, low: Array, high: Array, counts: tuple[int, int, int]) -> NDArray[np.bool_]:
    """Nodes (flat) of all cells that hold a point."""
    covered = np.zeros(counts, dtype=np.bool_)
    place = (points - low) / (high - low) * (np.array(counts) - 1)
    cell = np.clip(np.floor(place).astype(int), 0, np.array(counts) - 2)
    for corner in np.ndindex(2, 2, 2):
        covered[tuple((cell + corner).T)] = True
    return covered.ravel()


def _penalties(counts: tuple[int, int, int], covered: NDArray[np.bool_]) -> Array:
    """Rows of second differences along each axis and of values, over the covered nodes."""
    number = np.full(covered.size, -1)
    number[covered] = np.arange(covered.sum())
    grid = number.reshape(counts)
    rows = []
    for axis in range(3):
        lines = np.moveaxis(grid, axis, 0)
        for a, b, c in zip(lines[:-2], lines[1:-1], lines[2:], strict=True):
            triples = np.stack([a.ravel(), b.ravel(), c.ravel()], axis=1)
            for triple in triples[np.all(triples >= 0, axis=1)]:
                row = np.zeros(covered.sum())
                row[triple] = (1.0, -2.0, 1.0)
                rows.append(row)
    return np.concatenate([np.array(rows).reshape(-1, covered.sum()), np.eye(covered.sum()) / VALUE])


def _solve(basis: Array, errors: Array, penalties: Array, strength: float, noise: float) -> Array:
    """Least squares of errors with Σ (penalty · values)² at `strength` times the noise."""
    normal = basis.T @ basis + penalties.T @ penalties / strength**2
    solution: Array = np.linalg.solve(normal, basis.T @ (errors / noise)) * noise
    return solution
