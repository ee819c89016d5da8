"""Stated covariances of predictions are right: 95 % regions hold 95 % of what fresh poses exactly are."""

from __future__ import annotations

import numpy as np
import pytest
from regions import ARMS, share_inside, shares

# Errors of one arm move together: its own share scatters by 5 %, so that the mean of 12 does by 1.5 %.
FEW_ARMS = 12


def test_regions_of_few_arms_hold_fresh_poses() -> None:
    assert 0.90 < np.mean(shares(FEW_ARMS)) < 0.99


@pytest.mark.full
def test_regions_of_many_arms_hold_95_percent_of_fresh_poses() -> None:
    assert 0.93 < np.mean(shares(ARMS)) < 0.97


@pytest.mark.full
def test_regions_that_are_a_third_too_small_are_noticed() -> None:
    assert np.mean(shares(FEW_ARMS, pretend=0.67)) < 0.85


def test_an_error_of_the_instrument_widens_the_regions_though_no_prediction_contains_it() -> None:
    """What tracker_angles and base_frame share moves all poses by tens of micrometres at once."""
    found = [share_inside("kr30", ["joint_compliance", "tracker_angles"], seed=700 + i) for i in range(4)]
    assert np.mean(found) > 0.93
