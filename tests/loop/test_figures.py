"""The loop fails if its figures miss what they must show; its table and picture give these figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from armtrue_loop.figures import Errors, Figures, Step, draw, section_of
from armtrue_loop.plans import is_regular, make_plans
from armtrue_sim.build import build_arm
from armtrue_sim.scenario import Scenario

pytestmark = pytest.mark.without_bus
SCENARIO = Path(__file__).resolve().parents[2] / "sim/armtrue_loop/scenarios/warm-eccentric-gear.yaml"


def errors(mean_um: float) -> Errors:
    offsets = np.outer(1e-6 * mean_um * np.array([0.5, 1.0, 1.5]), [0.0, 0.6, 0.8])
    return Errors.of(offsets, np.zeros((3, 3)))


def figures(exact_um: float = 4.0) -> Figures:
    steps = [
        Step("nominal", "the arm as it was", errors(3000.0), errors(3000.0), None),
        Step("added-1", "+ backlash 2", errors(14.0), errors(exact_um), errors(4.0)),
    ]
    return Figures("made up", "inline", ["backlash 2"], ["backlash 2"], "nothing_missing", steps, 12.5)


def test_errors_are_distances_in_micrometres() -> None:
    assert errors(100.0).mean_um == pytest.approx(100.0)
    assert errors(100.0).max_um == pytest.approx(150.0)
    assert errors(100.0).rms_um == pytest.approx(100.0 * np.sqrt(3.5 / 3.0))


def test_loop_with_sufficient_figures_has_no_shortcomings() -> None:
    assert figures(exact_um=4.0 * 1.049).shortcomings() == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"steps": figures(exact_um=4.0 * 1.051).steps}, "times that of double precision"),
        ({"found": []}, "found were"),
        ({"found": ["backlash 2", "warm_up"]}, "found were"),
        ({"worst_following_increments": 1}, "following error of 1 increments"),
    ],
)
def test_each_shortcoming_is_a_sentence(change: dict[str, object], words: str) -> None:
    seen = figures()
    for name, value in change.items():
        setattr(seen, name, value)
    (sentence,) = seen.shortcomings()
    assert words in sentence


@pytest.mark.full
def test_picture_and_section_contain_the_figures(tmp_path: Path) -> None:
    svg, png = draw(figures(), tmp_path)
    section = section_of(figures())
    assert "| 14.0 |" in section
    assert section.count("| + backlash 2 |") == 1
    assert svg.read_text(encoding="utf-8").count("<svg") == 1
    assert png.read_bytes().startswith(b"\x89PNG")


def test_only_test_poses_are_kept_away_from_singularities() -> None:
    scenario = Scenario.from_file(SCENARIO)
    arm = build_arm(scenario)
    training, test = make_plans(scenario, arm)
    assert len(training.joints) == scenario.poses
    assert len(test.joints) == scenario.test_poses
    assert is_regular(arm, test.joints).all()
    assert not is_regular(arm, training.joints).all()
    assert len(np.unique(training.repeat)) == scenario.poses - (
        scenario.repeats["poses"] * scenario.repeats["times"]
    )
