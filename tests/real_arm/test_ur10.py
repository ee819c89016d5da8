"""The real UR10: errors of fits on poses that took no part in them. `./dev ur10` prints the whole table."""

from __future__ import annotations

import dataclasses

import armtrue
import numpy as np
import pytest
from ur10 import (
    EXAMPLE,
    GEOMETRY,
    MEASUREMENTS,
    SPRINGS,
    TABLES,
    Split,
    error_mm,
    model_of,
    rms,
    robot,
    splits,
)

pytestmark = pytest.mark.skipif(
    not MEASUREMENTS.is_dir(), reason=f"no UR10 measurements at {MEASUREMENTS} (not part of this repository)"
)


@pytest.fixture(scope="module")
def cut() -> dict[str, Split]:
    return splits()


def held_out_rms_mm(split: Split, effects: list) -> float:
    arm = robot()
    return rms(error_mm(armtrue.fit(split.train, arm, model_of(effects, arm)), split.held_out))


def test_geometry_fit_of_series_c_predicts_to_510_um(cut):
    assert held_out_rms_mm(cut["C"], GEOMETRY) <= 0.51


def test_tables_fit_of_series_c_predicts_to_100_um(cut):
    assert held_out_rms_mm(cut["C"], TABLES) <= 0.10


@pytest.mark.full
def test_springs_fit_of_series_a_predicts_later_poses_to_105_um(cut):
    assert held_out_rms_mm(cut["A"], SPRINGS) <= 0.105


def test_scatter_of_a_joint_with_the_reflector_on_its_axis_is_realistic():
    # Axis 6 runs 0.3 mm beside the reflector: its scatter was given as 0.18 rad.
    arm = robot()
    data = armtrue.load_data(EXAMPLE / "series_c.yaml", arm)
    few = data.take(np.random.default_rng(6).permutation(data.count)[:150])
    few = dataclasses.replace(
        few, columns={name: few.columns[name] for name in [*(f"q{k}" for k in range(1, 7)), "x", "y", "z"]}
    )
    noise = armtrue.diagnose(armtrue.fit(few, arm, model_of(GEOMETRY, arm)))["noise"]
    assert max(noise["joints_urad"]) < 1000.0


def said(diagnosis: armtrue.Diagnosis) -> tuple[str, float, list[tuple[str, list[int], float]]]:
    """Verdict and probable candidates of a diagnosis, rounded so that two runs agree."""
    probable = [
        (c["effect"], c["joints"], round(c["probability"], 3))
        for c in diagnosis.candidates
        if c["probability"] > 0.02
    ]
    return diagnosis.verdict, round(diagnosis["probability_nothing"], 3), probable


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_diagnosis_of_the_saved_fit_equals_refines_last_step(cut, tmp_path, seed):
    # Read from a file, effects that a search had added were taken as effects of the user's model, and smoothness and
    # weights differed from those at the end of refine: in 7 of 16 cases, the diagnosis of the file named a missing
    # effect although refine had reported that nothing is missing.
    arm, data = robot(), cut["C"].train
    few = data.take(np.random.default_rng(seed).permutation(data.count)[:100])
    final, story = armtrue.refine(armtrue.fit(few, arm, model_of(GEOMETRY, arm)))
    final.save(tmp_path / "best.json")
    read = armtrue.Fit(armtrue.Fit.load(tmp_path / "best.json").document, None, few)
    assert said(armtrue.diagnose(read)) == said(story.steps[-1])


@pytest.mark.full
def test_diagnosis_of_geometry_alone_names_transmission_pwl(cut):
    arm = robot()
    result = armtrue.diagnose(armtrue.fit(cut["C"].train, arm, model_of(GEOMETRY, arm)))
    best = result["candidates"][0]
    assert result["verdict"] == "missing_effect"
    assert best["effect"] == "transmission_pwl"
    assert best["recommend"]
    assert any("cycles a turn" in sentence for sentence in result["advice"])


@pytest.mark.full
def test_orientations_beside_positions_do_not_make_positions_worse(cut):
    # Wrist errors that the model lacks appear in orientations: weighted by how they scatter, these made the error on
    # unseen poses a quarter larger.
    arm, data = robot(), cut["A"].train
    columns = {name: values for name, values in data.columns.items() if name not in ("qw", "qx", "qy", "qz")}
    springs = [*TABLES, {"effect": "joint_compliance", "joints": [3]}, {"effect": "backlash", "joints": [5]}]

    def unseen_um(measured: armtrue.Dataset) -> float:
        fit = armtrue.fit(measured, arm, model_of(springs, arm))
        return float(fit.document["error"]["held_out"]["mean_um"])

    assert unseen_um(data) <= 1.02 * unseen_um(dataclasses.replace(data, columns=columns))
