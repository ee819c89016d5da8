"""Planned poses do on simulated arms what they promise: they settle ambiguities, and make first campaigns better."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from trial import CASES, Case, settled, try_campaign, try_case

SEEDS = (1, 2, 3)
POSES = 8


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.hidden)
def test_what_is_ambiguous_is_settled_by_the_planned_poses(case: Case, tmp_path: Path) -> None:
    outcomes = [outcome for seed in SEEDS if (outcome := try_case(case, seed, POSES, tmp_path))]
    assert outcomes, "no seed leaves an ambiguity that poses can settle"
    for outcome in outcomes:
        assert not settled(outcome.before), outcome
        assert settled(outcome.planned), outcome
    assert np.median([o.planned for o in outcomes]) < np.median([o.random for o in outcomes])


def test_a_planned_first_campaign_predicts_better_than_a_random_one(tmp_path: Path) -> None:
    outcomes = [try_campaign(20, seed, tmp_path) for seed in SEEDS]
    assert np.mean([o.planned for o in outcomes]) < 0.9 * np.mean([o.random for o in outcomes])
