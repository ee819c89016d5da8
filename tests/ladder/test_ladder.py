"""The levels of the IRB2400 ladder lower the error as in the paper, down to the arm's own repeatability."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from grids import covered_nodes, fit_grid, weights
from ladder import GRID, REFINED, REFINED_GRID, Comparison, Ladder, climb, compare_grids, grid_nodes


@pytest.fixture(scope="module")
def ladder() -> Ladder:
    return climb()


@pytest.fixture(scope="module")
def comparison(ladder: Ladder) -> Comparison:
    return compare_grids(ladder)


@pytest.mark.full
def test_every_level_of_the_paper_lowers_mean_and_maximum(ladder):
    climbed = ladder.levels[: GRID + 1]
    assert all(after.exact.mean() < before.exact.mean() for before, after in pairwise(climbed))
    assert all(after.exact.max() < before.exact.max() for before, after in pairwise(climbed))


@pytest.mark.full
def test_ladder_begins_like_the_paper_and_ends_lower(ladder):
    nominal, last = ladder.levels[0].measured * 1e3, ladder.levels[GRID].measured * 1e3
    assert 1.0 < nominal.max() < 2.0
    assert 0.3 < nominal.mean() < 0.6
    assert last.max() < 0.172
    assert last.mean() < 0.066


@pytest.mark.full
def test_last_level_reaches_the_repeatability_of_the_arm(ladder):
    assert ladder.levels[GRID].exact.mean() < ladder.repeatability.mean()
    # After refine and the grid, the error of a new measurement is little more than that of drives and tracker.
    assert ladder.levels[-1].name == REFINED_GRID
    assert ladder.levels[-1].measured.mean() < 1.12 * ladder.repeatability.mean()
    assert ladder.levels[-1].measured.max() < 1.2 * ladder.repeatability.max()


@pytest.mark.full
def test_refined_model_is_better_than_the_grid_level(ladder):
    by_name = {level.name: level for level in ladder.levels}
    assert by_name[REFINED].exact.mean() < 0.7 * ladder.levels[GRID].exact.mean()


@pytest.mark.full
def test_joint_space_grid_beats_cartesian_grid_of_equal_size(comparison):
    assert comparison.joint.mean() < comparison.cartesian.mean() < comparison.before.mean()
    assert len(comparison.joint_grid.values) == len(comparison.cartesian_grid.values)


@pytest.mark.full
def test_product_grid_is_as_good_as_the_numpy_grid(ladder, comparison):
    assert ladder.levels[GRID].exact.mean() < 1.1 * comparison.joint.mean()
    assert grid_nodes(ladder.levels[GRID].document) == comparison.nodes


def test_grid_fits_a_multilinear_field_and_is_zero_far_outside():
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.0, 1.0, (300, 3))
    field = np.stack([points[:, 0] * points[:, 1], points[:, 2], points[:, 0] - points[:, 2]], axis=1)
    grid = fit_grid(points, field * 1e-4, (3, 3, 3))
    assert np.abs(grid.evaluate(points * 0.9) - 1e-4 * _field(points * 0.9)).max() < 5e-6
    assert np.all(grid.evaluate(np.full((1, 3), 3.0)) == 0.0)


def _field(points):
    return np.stack([points[:, 0] * points[:, 1], points[:, 2], points[:, 0] - points[:, 2]], axis=1)


def test_weights_sum_to_one_and_nodes_without_data_are_uncovered():
    low, high = np.zeros(3), np.ones(3)
    inside = np.random.default_rng(2).uniform(0.0, 1.0, (50, 3))
    assert np.allclose(weights(inside, low, high, (3, 4, 5)).sum(axis=1), 1.0)
    corner = covered_nodes(np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]]), low, high, (3, 3, 3))
    assert corner.sum() == 8
