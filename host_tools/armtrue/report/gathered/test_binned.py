"""Bin means: trends are found, and noise is not taken for a trend."""

from __future__ import annotations

import numpy as np

from armtrue.report.gathered.binned import bin_of, binned


def test_trend_is_found_with_its_size():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 1.0, 600)
    y = 3.0 * x + rng.normal(0.0, 1.0, 600)
    found = binned(x, y, np.ones(600))
    assert found.trend
    assert abs(found.explained - 0.75) < 0.05
    assert np.abs(found.mean - 3.0 * found.centre).max() < 0.6


def test_noise_shows_no_trend_in_500_trials():
    rng = np.random.default_rng(4)
    x = rng.uniform(0.0, 1.0, 240)
    looks = [binned(x, rng.normal(0.0, 1.0, 240), np.ones(240)) for _ in range(500)]
    assert not any(look.trend for look in looks)
    assert abs(np.mean([look.explained for look in looks])) < 0.01


def test_error_bars_contain_the_true_mean_in_95_percent():
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(200):
        found = binned(rng.uniform(0.0, 1.0, 400), rng.normal(2.0, 1.0, 400), np.ones(400))
        inside += (np.abs(found.mean - 2.0) <= found.error).tolist()
    assert 0.93 < np.mean(inside) < 0.98


def test_few_distinct_values_get_own_bins_except_single_rows():
    values = np.array([-1.0] * 50 + [1.0] * 60 + [0.0])
    assert np.unique(bin_of(values)).size == 3
    found = binned(values, values * 2.0, np.ones(111))
    assert found.centre.tolist() == [-1.0, 1.0]
    assert found.mean.tolist() == [-2.0, 2.0]


def test_readings_of_zero_weight_are_ignored():
    values = np.repeat([0.0, 1.0], 40)
    readings = np.tile([1.0, 100.0], 40)
    found = binned(values, readings, np.tile([1.0, 0.0], 40))
    assert found.mean.tolist() == [1.0, 1.0]
    assert found.high.tolist() == [1.0, 1.0]


def test_few_rows_give_few_bins_and_cannot_show_a_trend():
    x = np.arange(12.0)
    found = binned(x, np.tile([1.0, -1.0], 6), np.ones(12))
    assert found.centre.tolist() == [2.5, 8.5]
    assert not found.tells
    assert binned(np.arange(240.0), np.tile([1.0, -1.0], 120), np.ones(240)).tells


def test_too_few_rows_give_no_bins_and_no_trend():
    found = binned(np.array([1.0, 2.0, 3.0]), np.array([5.0, 6.0, 9.0]), np.ones(3))
    assert found.centre.size == 0
    assert not found.trend
    assert not found.tells
