"""Campaigns that were once diagnosed wrongly, and the cause of each error."""

from __future__ import annotations

import pytest
from harness import Settings, run_case, verdict_of

pytestmark = pytest.mark.full

# Kind, arm, seed, and what went wrong.
CASES = [
    ("real_nothing", "irb2400", 22000, "masses came last, for their many coefficients: a wave stood in their place"),
    ("one_hidden", "kr30", 21001, "less than a wave over a joint's range had fewer coefficients as a wave"),
    ("noise_x4", "kr30", 22002, "two shapes of one bent link had a third each: nothing was said to be missing"),
    ("real_three", "irb2400", 22000, "a spring that hardens or is soft waited behind what it was mistaken for"),
    ("real_three", "irb2400", 24002, "a balancer's phase ended in a local minimum: a table was advised for that"),
    ("real_nothing", "kr30", 24000, "repeats of an axis that repeats badly seemed better than all other poses"),
    ("real_one", "irb2400", 28206, "a joint that repeats badly was called a structure without a name"),
    ("real_three", "lbr", 22002, "springs that are not there were named for masses beyond their prior"),
    ("real_three", "kr30", 20014, "a hardening spring under heavier links was weighed as if it were linear"),
    ("three_hidden", "irb2400", 0, "a table and a nameless function were about as likely, and neither was added"),
    ("one_hidden", "kr30", 20801, "a balancer was looked at in one period alone, chosen before noise was known"),
    ("real_three", "kr30", 20702, "small waves came in before the masses that explain them"),
    ("real_three", "irb2400", 20704, "small waves came in before the masses that explain them"),
    ("real_three", "irb2400", 20700, "masses were kept out by a few poses beyond the nodes of a table"),
    ("outside_catalogue", "cobot", 20402, "a step was named by a load that goes along with the joint's angle"),
    ("outside_catalogue", "irb2400", 20406, "a step was named by a load that goes along with the joint's angle"),
    ("outside_catalogue", "irb2400", 21000, "a step was named by a load that goes along with the joint's angle"),
    ("outside_catalogue", "irb2400", 21001, "a step was named by a load that goes along with the joint's angle"),
    ("foreign_truth", "lbr", 20203, "warm-up was kept out, since a session's first minutes are seen once"),
    ("foreign_truth", "cobot", 20202, "warm-up was kept out, since a session's first minutes are seen once"),
    ("foreign_truth", "kr30", 20201, "four effects were named for what a beam adds to a hinge"),
    ("foreign_truth", "irb2400", 20200, "four effects were named for what a beam adds to a hinge"),
    ("gross_errors", "lbr", 20706, "backlash was put aside for a smooth function of the direction of approach"),
    ("three_hidden", "kr30", 20600, "a table stood for the one effect it hid, beside others that were still missing"),
    ("three_hidden", "lbr", 20501, "a table stood for the one effect it hid, beside others that were still missing"),
    ("three_hidden", "kr30", 20603, "a bump was kept out: its poses had been taken for gross errors"),
    ("thermal_pair_noise_x4", "cobot", 20000, "two heats under noise were said to be one"),
    ("thermal_pair_noise_x4", "lbr", 20000, "two heats under noise were said to be one"),
    ("three_hidden", "lbr", 3014, "bending of joint 1 was swapped for joint 2's, which left geometry unknown"),
    ("three_hidden", "cobot", 4008, "a balancer that carries nothing was named for harmonics"),
    ("three_hidden", "cobot", 5008, "bending of link 2 was named for link 1's and a part of axis 2's torsion"),
    ("three_hidden", "irb2400", 8012, "eccentricity came in under a table that needs none"),
    ("foreign_truth", "irb2400", 30901, "a spring that hardens stood for the way that a joint had come"),
    ("foreign_truth", "irb2400", 30906, "a spring that is soft stood for the way that a joint had come"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "arm", "seed", "wrong"), CASES, ids=[f"{k}-{a}-{s}" for k, a, s, _ in CASES]
)
def test_once_wrong_campaign_is_diagnosed_right(kind: str, arm: str, seed: int, wrong: str) -> None:
    outcome = run_case(kind, arm, seed, Settings(reference=False))
    assert verdict_of(outcome) == "right", f"again: {wrong}? {outcome}"


def test_smooth_table_is_uncertain_if_a_wave_fits_as_well() -> None:
    # The table was stated with 1.000: terms that seldom change in the search were never compared with waves.
    outcome = run_case("one_hidden", "kr30", 21001, Settings(reference=False))
    assert [told for told, true in outcome.said if told >= 0.9 and not true] == []


def test_bumped_reflectors_do_not_hide_the_balancer() -> None:
    # Reflectors bumped by millimetres hid the balancer's minimum from its search, and from the true model's as well.
    outcome = run_case("gross_errors", "kr30", 600, Settings(reference=True))
    assert verdict_of(outcome) == "right", outcome
    assert 0.95 < outcome.error_ratio <= 1.05
