"""Thinning of rows and curves."""

import numpy as np

from armtrue.report.gathered.thinning import loudest, spread_rows


def test_few_rows_are_all_kept():
    assert spread_rows(5, 10).tolist() == [0, 1, 2, 3, 4]


def test_rows_are_thinned_evenly_and_required_rows_kept():
    keep = np.array([7, 11_111])
    rows = spread_rows(12_000, 1500, keep)
    assert rows.size <= 1500
    assert set(keep) <= set(rows.tolist())
    assert rows[0] == 0
    assert rows[-1] == 11_999
    assert np.diff(rows).max() <= 10


def test_thinned_curve_keeps_its_peaks():
    values = np.zeros(5000)
    values[[17, 2500, 4999]] = [3.0, 5.0, 4.0]
    peaks, starts = loudest(values, 300)
    assert peaks.size == starts.size == 300
    assert {17, 2500, 4999} <= set(peaks.tolist())
