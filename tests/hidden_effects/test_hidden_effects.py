"""A slice of the hidden-effect campaign; `./dev hidden` runs all of it and writes the figures to docs/results.md."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pairs
import pytest
from armtrue_sim.kinds import ARMS
from harness import Outcome, Settings, accounted_for, said_of, verdict_of
from harness import run_case as run_settings


def and_in_full(first: Any, *more: Any) -> list[Any]:
    """The first case runs in every test run; `./dev test full` runs the others too."""
    return [
        first,
        *(
            pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.full)
            for case in more
        ),
    ]


def arms_and_seeds(quick: set[tuple[str, int]], seeds: tuple[int, ...] = (1, 2)) -> list[Any]:
    """Every arm with every seed, those of `quick` in every run."""
    return [
        pytest.param(arm, seed, marks=() if (arm, seed) in quick else pytest.mark.full)
        for arm in ARMS
        for seed in seeds
    ]


HARD = ["gross_errors", "sixty_poses", "noise_x4", "missing_columns"]


def run_case(kind: str, arm: str, seed: int, reference: bool = False) -> Outcome:
    return run_settings(kind, arm, seed, Settings(reference=reference))


@pytest.mark.parametrize(("arm", "seed"), arms_and_seeds({("kr30", 1)}))
def test_one_hidden_effect_is_found_and_nothing_else(arm: str, seed: int) -> None:
    outcome = run_case("one_hidden", arm, seed, reference=True)
    assert verdict_of(outcome) == "right", outcome
    assert outcome.error_ratio <= 1.05


@pytest.mark.parametrize(("arm", "seed"), arms_and_seeds({("lbr", 3)}, seeds=(3,)))
def test_three_hidden_effects_are_found_and_nothing_else(arm: str, seed: int) -> None:
    outcome = run_case("three_hidden", arm, seed)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(("arm", "seed"), arms_and_seeds({("lbr", 1)}))
def test_complete_model_raises_no_alarm(arm: str, seed: int) -> None:
    outcome = run_case("nothing_hidden", arm, seed)
    assert (outcome.added, outcome.verdict) == (set(), "nothing_missing")


@pytest.mark.parametrize(
    ("arm", "seed"),
    and_in_full(
        *(("kr30", 7), ("cobot", 1), ("cobot", 10), ("lbr", 1), ("kr30", 1), ("irb2400", 1)),
        *((arm, 2) for arm in ARMS),
    ),
)
def test_formula_outside_the_catalogue_is_not_explained_away(arm: str, seed: int) -> None:
    outcome = run_case("outside_catalogue", arm, seed)
    assert verdict_of(outcome) == "right", outcome


def test_oval_tracker_circle_is_named() -> None:
    # The advice took the orders of the circle for those of a gear: every diagnosis that recommended them crashed.
    outcome = run_case("foreign_truth", "kr30", 34400)
    assert (verdict_of(outcome), outcome.added) == ("right", {"tracker_angles"})


@pytest.mark.parametrize(
    ("kind", "arm"),
    [
        case
        for kind, first in zip(HARD, ARMS, strict=True)
        for case in and_in_full((kind, first), *((kind, arm) for arm in ARMS if arm != first))
    ],
)
def test_hidden_effects_are_found_in_hard_circumstances(kind: str, arm: str) -> None:
    outcome = run_case(kind, arm, 2)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize(
    ("kind", "arm"),
    and_in_full(
        ("real_nothing", "cobot"), ("real_one", "kr30"), ("real_nothing", "kr30"), ("real_one", "cobot")
    ),
)
def test_arm_that_differs_from_robot_yaml_is_diagnosed_right(kind: str, arm: str) -> None:
    # Masses 20 % off, base not level, loads on the deflected arm: unless the search fits masses, it names wrong
    # effects.
    outcome = run_case(kind, arm, 20000)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.full
@pytest.mark.parametrize(
    ("kind", "arm", "seed"),
    and_in_full(
        ("real_one", "cobot", 29703),
        ("real_one", "cobot", 29704),
        ("real_one", "stanford", 29703),
        ("real_three", "rail", 33100),
        ("real_nothing", "irb2400", 29703),
        ("one_hidden", "scara", 29700),
        ("sixty_poses", "kr30", 29713),
    ),
)
def test_randomly_varied_arms_are_diagnosed_right(kind: str, arm: str, seed: int) -> None:
    # cobot 29703: with a residual this large, robot.yaml states each single mass better than the data do, and was taken
    # to state all of them together as well.
    outcome = run_settings(kind, arm, seed, Settings(reference=False, variants=True))
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.full
@pytest.mark.parametrize(
    ("one", "other", "arm"),
    [
        ("joint_compliance_2", "gear_harmonics_2", "cobot"),
        ("thermal_base", "time_drift", "kr30"),
        ("cross_compliance_2,3", "joint_compliance_3", "kr30"),
    ],
)
def test_pair_is_named_in_open_session_and_decided_in_the_other(one: str, other: str, arm: str) -> None:
    assert pairs.answer(run_case(f"open_{one}_or_{other}", arm, 0)) in ("right", "both")
    assert pairs.answer(run_case(f"decided_{one}_or_{other}", arm, 0)) == "right"


def test_verdict_depends_on_lost_effects_and_the_last_step() -> None:
    fine = Outcome("one_hidden", "kr30", 0, {"backlash 2"}, added={"backlash 2"}, verdict="nothing_missing")
    assert verdict_of(fine) == "right"
    assert verdict_of(replace(fine, lost={"joint_compliance 3"})) == "lost"
    assert verdict_of(replace(fine, verdict="unexplained_structure")) == "false alarm"
    assert verdict_of(replace(fine, accounted=False)) == "not accounted for"


def test_accounted_for_requires_every_change_to_be_named() -> None:
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


def test_one_of_several_names_of_a_foreign_truth_is_enough() -> None:
    outcome = Outcome("foreign_truth", "kr30", 0, {"dahl_friction 2"}, causes={"backlash 2", "hysteresis 2"})
    document = {
        "effects": [],
        "steps": [
            {
                "candidates": [{"effect": "hysteresis", "joints": [2], "probability": 0.1}],
                "probability_nothing": 0.9,
            }
        ],
    }
    assert said_of(outcome, document) == [(0.1, True), (0.9, False)]
    outcome.added = {"backlash 2"}
    assert said_of(outcome, document) == [(0.1, False), (0.9, True)]


def test_verdict_of_a_wrong_answer_names_the_error() -> None:
    wrong = Outcome("one_hidden", "kr30", 0, {"backlash 2"}, added={"backlash 3"}, verdict="nothing_missing")
    assert verdict_of(wrong) == "missed"
    extra = replace(wrong, added={"backlash 2", "warm_up"})
    assert verdict_of(extra) == "extra"
    squeezed = replace(wrong, kind="outside_catalogue", hidden={"custom"}, added={"warm_up"})
    assert verdict_of(squeezed) == "explained away"


def test_pair_answer_classifies_every_outcome() -> None:
    silent = Outcome("", "kr30", 0, {"hysteresis 2"}, verdict="nothing_missing")
    named = replace(silent, added={"hysteresis 2"})
    other = replace(silent, added={"backlash 2"}, sure={"backlash 2", "base_frame"})
    answers = {
        "right": replace(named, sure={"hysteresis 2"}),
        "both": named,
        "and a false one": replace(other, stand_ins={"hysteresis 2"}),
        "no column": replace(other, without_column={"hysteresis"}),
        "wrong": other,
        "else": replace(other, sure=set()),
        "nothing": silent,
    }
    assert tuple(answers) == pairs.ANSWERS
    assert {said: pairs.answer(outcome) for said, outcome in answers.items()} == {
        said: said for said in answers
    }
    assert pairs.answer(replace(silent, verdict="unexplained_structure")) == "else"
