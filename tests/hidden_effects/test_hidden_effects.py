"""A slice of the hidden-effect campaign; `./dev hidden` runs all of it and writes the figures to docs/results.md."""

from __future__ import annotations

import pytest
from armtrue_sim.cases import ARMS
from harness import Outcome, run_case, verdict_of

SEEDS = (1, 2)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("arm", ARMS)
def test_one_hidden_effect_is_found_and_nothing_else(arm: str, seed: int) -> None:
    outcome = run_case("one_hidden", arm, seed)
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


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("arm", ARMS)
def test_what_no_effect_names_is_not_explained_away(arm: str, seed: int) -> None:
    outcome = run_case("outside_catalogue", arm, seed)
    assert verdict_of(outcome) == "right", outcome


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("kind", ["gross_errors", "sixty_poses", "noise_x4", "missing_columns"])
def test_hard_circumstances(kind: str, arm: str) -> None:
    outcome = run_case(kind, arm, 2)
    assert verdict_of(outcome) == "right", outcome


def test_the_judge_knows_a_wrong_answer() -> None:
    wrong = Outcome(
        "one_hidden", "kr30", 0, {"backlash 2"}, [], [], {"backlash 3"}, "nothing_missing", [], 2.0, 1.0, 0.0
    )
    assert verdict_of(wrong) == "missed"
    extra = Outcome(
        "one_hidden",
        "kr30",
        0,
        {"backlash 2"},
        [],
        [],
        {"backlash 2", "warm_up"},
        "nothing_missing",
        [],
        1.0,
        1.0,
        0.0,
    )
    assert verdict_of(extra) == "extra"
    squeezed = Outcome(
        "outside_catalogue", "kr30", 0, {"custom"}, [], [], {"warm_up"}, "nothing_missing", [], 1.0, 1.0, 0.0
    )
    assert verdict_of(squeezed) == "explained away"
