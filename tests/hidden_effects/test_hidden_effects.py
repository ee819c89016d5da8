"""A slice of the hidden-effect campaign; `./dev hidden` runs all of it and writes the figures to docs/results.md."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from armtrue_sim.kinds import ARMS
from harness import Outcome, Settings, accounted_for, verdict_of
from harness import run_case as run_settings


def and_in_full(first: Any, *more: Any) -> list[Any]:
    """One case for every change; `./dev test full` has the others too."""
    return [
        first,
        *(
            pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.full)
            for case in more
        ),
    ]


SEEDS = and_in_full(1, 2)
HARD = ["gross_errors", "sixty_poses", "noise_x4", "missing_columns"]


def run_case(kind: str, arm: str, seed: int, reference: bool = False) -> Outcome:
    return run_settings(kind, arm, seed, Settings(reference=reference))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("arm", ARMS)
def test_one_hidden_effect_is_found_and_nothing_else(arm: str, seed: int) -> None:
    outcome = run_case("one_hidden", arm, seed, reference=True)
    assert verdict_of(outcome) == "right", outcome
    assert outcome.error_ratio <= 1.05


@pytest.mark.parametrize("arm", ARMS)
def test_three_hidden_effects_are_found_and_nothing_else(arm: str) -> None:
    outcome = run_case("three_hidden", arm, 3)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("arm", ARMS)
def test_nothing_hidden_is_no_alarm(arm: str, seed: int) -> None:
    outcome = run_case("nothing_hidden", arm, seed)
    assert (outcome.added, outcome.verdict) == (set(), "nothing_missing")


@pytest.mark.parametrize(
    ("arm", "seed"),
    [
        ("kr30", 7),
        *and_in_full(
            ("cobot", 1), ("cobot", 10), ("lbr", 1), ("kr30", 1), ("irb2400", 1), *((arm, 2) for arm in ARMS)
        ),
    ],
)
def test_what_no_effect_names_is_not_explained_away(arm: str, seed: int) -> None:
    outcome = run_case("outside_catalogue", arm, seed)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(
    ("kind", "arm"),
    [
        case
        for kind, first in zip(HARD, ARMS, strict=True)
        for case in and_in_full((kind, first), *((kind, arm) for arm in ARMS if arm != first))
    ],
)
def test_hard_circumstances(kind: str, arm: str) -> None:
    outcome = run_case(kind, arm, 2)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(
    ("kind", "arm"),
    [
        ("real_nothing", "cobot"),
        *and_in_full(("real_one", "kr30"), ("real_nothing", "kr30"), ("real_one", "cobot")),
    ],
)
def test_an_arm_unlike_its_file_hides_nothing_and_alarms_nobody(kind: str, arm: str) -> None:
    # Masses 20 % off, the base not level, loads where the arm stands: the search weighs the links, or it is led astray.
    outcome = run_case(kind, arm, 20000)
    assert verdict_of(outcome) == "right", outcome


def test_one_cause_with_many_coefficients_competes_with_two_that_have_few() -> None:
    # Masses came last, as tables do for their many nodes; by then a wave of axis 3 and a balancer stood in their place.
    outcome = run_case("real_nothing", "irb2400", 22000)
    assert verdict_of(outcome) == "right", outcome


def test_less_than_a_wave_over_the_range_of_a_joint_is_no_line_and_no_table() -> None:
    # A wave of three a turn, over the third of a turn that the joint moves, had two coefficients less than harmonics.
    outcome = run_case("one_hidden", "kr30", 21001)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(("kind", "arm"), and_in_full(("noise_x4", "kr30"), ("real_three", "irb2400")))
def test_an_effect_is_as_sure_as_all_its_forms_together(kind: str, arm: str) -> None:
    # Two shapes of one bent link and a third candidate had a third each: nothing was said to be missing. A spring that
    # hardens or is soft waited behind what it was mistaken for.
    outcome = run_case(kind, arm, 22002 if kind == "noise_x4" else 22000)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(
    ("kind", "arm", "seed"),
    [
        # The balancer's ratio and phase ended in a local minimum, and a table of axis 2 was recommended for that.
        pytest.param("real_three", "irb2400", 24002, id="nonlinear parameters are searched for again"),
        # Axis 2 repeats to 25 µrad: repeats seemed better than all other poses, and these "unexplained".
        pytest.param("real_nothing", "kr30", 24000, id="repeats count by what scatters at their pose"),
        # The test of structure knows no joint that repeats badly: a function of q4 and dir2 was left "unexplained".
        pytest.param("real_one", "irb2400", 28206, id="the evidence has a word in what is structure"),
        # Springs that are not there were named for it; tests/fitting/test_load_effects.py has the fit alone.
        pytest.param("real_three", "lbr", 22002, id="no mass stands for a moment beyond its prior"),
    ],
)
def test_arms_unlike_their_files_are_diagnosed(kind: str, arm: str, seed: int) -> None:
    outcome = run_case(kind, arm, seed)
    assert verdict_of(outcome) == "right", outcome


def test_links_heavier_than_stated_bend_a_hardening_spring_by_its_slope_where_it_is() -> None:
    # Weighed as if the spring were linear, they left a wave on axis 2 that stood for nothing in the arm.
    outcome = run_case("real_three", "kr30", 20014)
    assert verdict_of(outcome) == "right", outcome


def test_a_function_of_one_joint_that_its_table_can_have_is_no_structure_without_a_name() -> None:
    # Table and nameless function were about as likely, and nothing of three effects was added.
    outcome = run_case("three_hidden", "irb2400", 0)
    assert verdict_of(outcome) == "right", outcome


def test_what_three_others_stood_for_is_tried_in_the_form_that_fits_it() -> None:
    # With noise not known yet another period of the balancer did best, and only that one was looked at closely.
    outcome = run_case("one_hidden", "kr30", 20801)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(("arm", "seed"), and_in_full(("kr30", 20702), ("irb2400", 20704)))
def test_a_small_effect_waits_until_the_large_ones_are_in(arm: str, seed: int) -> None:
    # The first search was sure of waves of joint 3 too, a thousandth of what was hidden. A search beside the hidden
    # effects names the masses instead of these waves.
    outcome = run_case("real_three", arm, seed)
    assert verdict_of(outcome) == "right", outcome


def test_what_is_sure_comes_in_though_chance_moves_unseen_poses_by_a_per_mille() -> None:
    # Masses, of which the search was sure, were kept out by a few poses beyond the nodes of a table.
    outcome = run_case("real_three", "irb2400", 20700)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(
    ("arm", "seed"), and_in_full(("cobot", 20402), ("irb2400", 20406), ("irb2400", 21000), ("irb2400", 21001))
)
def test_a_step_is_named_by_the_variable_in_which_it_is_sharp(arm: str, seed: int) -> None:
    # A load that goes along with the joint's angle explained the smoothed step as well, and was named first.
    outcome = run_case("outside_catalogue", arm, seed)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(("arm", "seed"), and_in_full(("lbr", 20203), ("cobot", 20202)))
def test_what_runs_with_time_is_not_refused_for_the_times_it_has_not_seen(arm: str, seed: int) -> None:
    # Gears warm by their duty: diagnose was sure of warm_up, and refine kept it out, since the session's first
    # minutes cannot be told from the others.
    outcome = run_case("foreign_truth", arm, seed)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(("arm", "seed"), and_in_full(("kr30", 20201), ("irb2400", 20200)))
def test_a_link_that_bends_along_its_length_is_one_cause(arm: str, seed: int) -> None:
    # As a hinge at its joint, up to four other effects were named for what the shape of a beam adds.
    outcome = run_case("foreign_truth", arm, seed)
    assert verdict_of(outcome) == "right", outcome


def test_an_effect_is_not_put_aside_for_a_smooth_function_of_its_own_form() -> None:
    # Backlash left a function of the direction of approach: "depends on dir2", and no effect was named.
    outcome = run_case("gross_errors", "lbr", 20706)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(("arm", "seed"), and_in_full(("kr30", 20600), ("lbr", 20501)))
def test_a_table_does_not_stand_for_what_physics_explains_together(arm: str, seed: int) -> None:
    # Beside effects that were still missing, a joint's table explained more than the one effect it hid.
    outcome = run_case("three_hidden", arm, seed)
    assert verdict_of(outcome) == "right", outcome


def test_a_smooth_table_is_not_sure_where_a_wave_explains_as_much() -> None:
    # The table was said with 1.000: what seldom changes in the search was never set against waves.
    outcome = run_case("one_hidden", "kr30", 21001)
    assert [told for told, true in outcome.said if told >= 0.9 and not true] == []


def test_a_bump_comes_in_though_its_poses_were_taken_for_gross_errors() -> None:
    # The model without the table had kept those poses out, and was judged by the others alone.
    outcome = run_case("three_hidden", "kr30", 20603)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize("arm", and_in_full("cobot", "lbr"))
def test_two_heats_under_noise_or_warm_up_are_both_readings(arm: str) -> None:
    outcome = run_case("thermal_pair_noise_x4", arm, 20000)
    assert verdict_of(outcome) == "right", outcome


def test_bumped_reflectors_do_not_lead_a_search_astray() -> None:
    # Reflectors bumped by millimetres hid the balancer's valley from its search, and from the true model's as well.
    outcome = run_case("gross_errors", "kr30", 600, reference=True)
    assert verdict_of(outcome) == "right", outcome
    assert 0.95 < outcome.error_ratio <= 1.05


def test_what_is_there_is_not_swapped_for_what_says_less_about_geometry() -> None:
    # Bending of joint 2 in the place of joint 1's explained less, but left two of geometry's parameters unknown.
    outcome = run_case("three_hidden", "lbr", 3014)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(
    ("arm", "seed"),
    [
        pytest.param("cobot", 4008, id="a balancer that carries nothing, for harmonics"),
        pytest.param("cobot", 5008, id="bending of link 2, for link 1's and part of axis 2's torsion"),
        pytest.param("irb2400", 8012, id="six minutes of eccentricity under a table that needs none"),
    ],
)
def test_what_is_strange_or_hardly_known_does_not_win_by_a_hair(arm: str, seed: int) -> None:
    outcome = run_case("three_hidden", arm, seed)
    assert verdict_of(outcome) == "right", outcome


def test_the_judge_sees_what_a_last_step_leaves() -> None:
    fine = Outcome("one_hidden", "kr30", 0, {"backlash 2"}, added={"backlash 2"}, verdict="nothing_missing")
    assert verdict_of(fine) == "right"
    assert verdict_of(replace(fine, lost={"joint_compliance 3"})) == "lost"
    assert verdict_of(replace(fine, verdict="unexplained_structure")) == "false alarm"
    assert verdict_of(replace(fine, accounted=False)) == "not accounted for"


def test_the_judge_wants_every_effect_named_by_a_step() -> None:
    def step(effects: list[str], added: str | None = None, removed: tuple[str, ...] = ()) -> dict[str, Any]:
        return {
            "effects": effects,
            "added": {"effect": added, "joints": []} if added else None,
            "removed": [{"effect": name, "joints": []} for name in removed],
        }

    start = step(["base_frame"])
    assert accounted_for([start, step(["base_frame", "warm_up"], "warm_up")])
    assert accounted_for([start, step(["warm_up"], "warm_up", ("base_frame",))])
    assert not accounted_for([start, step(["base_frame", "warm_up", "time_drift"], "warm_up")])
    assert not accounted_for([start, step(["warm_up"], "warm_up")])


def test_the_judge_knows_a_wrong_answer() -> None:
    wrong = Outcome("one_hidden", "kr30", 0, {"backlash 2"}, added={"backlash 3"}, verdict="nothing_missing")
    assert verdict_of(wrong) == "missed"
    extra = replace(wrong, added={"backlash 2", "warm_up"})
    assert verdict_of(extra) == "extra"
    squeezed = replace(wrong, kind="outside_catalogue", hidden={"custom"}, added={"warm_up"})
    assert verdict_of(squeezed) == "explained away"
