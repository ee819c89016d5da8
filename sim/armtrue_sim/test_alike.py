"""Causes that look alike: the session stated for a pair separates them."""

import numpy as np
import pytest

from .alike import DOUBLES, left, name, odds, ordinary

HEAT_AND_SIDES = [d for d in DOUBLES if name(d.taken_for) in ("warm_up", "joint_offset 2")]


@pytest.mark.parametrize("double", HEAT_AND_SIDES, ids=lambda d: name(d.cause))
def test_only_the_deciding_session_separates_look_alikes(double):
    before, after = (left(double, session, "kr30", 1)[1] for session in (ordinary, double.session))
    assert odds(before) == "even"
    assert odds(after) == "beyond 10^99"


@pytest.mark.parametrize("double", DOUBLES, ids=lambda d: name(d.cause))
def test_double_leaves_no_more_error_than_geometry_alone(double):
    alone, beside = left(double, ordinary, "kr30", 2)
    assert beside <= alone * (1.0 + 1e-9)


def test_odds_follow_the_noise():
    assert odds(0.0) == "even"
    # 60 poses, 8 um: half of 60 / ln 10.
    assert odds(8e-6) == f"10^{60 / 2 / np.log(10.0):.0f}"
