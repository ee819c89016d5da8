"""Planned poses on simulated arms: they settle ambiguities, and improve first campaigns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from armtrue_sim import presets
from trial import CASES, HEAT, Case, settled, try_campaign, try_case, try_heat, try_sensors

SEEDS = (1, 2, 3)
POSES = 8


@pytest.mark.full
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.hidden)
def test_planned_poses_settle_the_ambiguity(case: Case, tmp_path: Path) -> None:
    outcomes = [outcome for seed in case.seeds if (outcome := try_case(case, seed, POSES, tmp_path))]
    assert outcomes, "no seed leaves an ambiguity that poses can settle"
    for outcome in outcomes:
        assert settled(outcome.planned), outcome
    assert np.median([o.planned for o in outcomes]) < np.median([o.random for o in outcomes])


@pytest.mark.full
@pytest.mark.parametrize("cause", HEAT)
@pytest.mark.parametrize("seed", SEEDS)
def test_diagnosis_names_the_cause_after_the_planned_session(cause: str, seed: int, tmp_path: Path) -> None:
    outcome = try_heat(cause, seed, POSES, tmp_path)
    assert {entry["effect"] for entry in outcome.before.open} == set(HEAT)
    assert outcome.recommended == cause
    assert not outcome.after.open, outcome.after
    time, warmth = outcome.plan.columns["time"], outcome.plan.columns["temp_arm"]
    assert np.all(np.diff(time) >= 0.0)
    assert np.count_nonzero(np.diff(warmth)) == len(set(warmth)) - 1
    # In the first session time and temperature rose together.
    assert np.corrcoef(time, warmth)[0, 1] < 0.0


@pytest.mark.full
@pytest.mark.parametrize("cause", ["arm", "stand"])
def test_planned_session_identifies_the_thermometer(
    cause: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(presets._load("kr30")["temperature"], "sensors", ["arm", "stand"])
    outcome = try_sensors(cause, 3, POSES, tmp_path)
    for candidate in outcome.first["candidates"]:
        rivals = candidate["confounded_with"]
        assert len(set(rivals)) == len(rivals), "one name for both thermometers"
    open_before = [(entry["effect"], entry.get("sensor")) for entry in outcome.before.open]
    assert {("thermal_expansion", "arm"), ("thermal_expansion", "stand")} <= set(open_before)
    assert {"temp_arm", "temp_stand"} <= outcome.plan.columns.keys()
    truths = {entry["truth"] for entry in outcome.plan.figures["separations"]}
    assert {f"thermal_expansion 1,2,3,4,5,6 sensor {name}" for name in ("arm", "stand")} <= truths
    assert outcome.after.entry["sensor"] == cause
    assert not outcome.after.open, outcome.after


@pytest.mark.full
def test_planned_first_campaign_predicts_better_than_random(tmp_path: Path) -> None:
    outcomes = [try_campaign(20, seed, tmp_path) for seed in SEEDS]
    assert np.mean([o.planned for o in outcomes]) < 0.9 * np.mean([o.random for o in outcomes])
