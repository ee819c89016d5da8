"""The key `explained` of a candidate is what a fit with it explains."""

from __future__ import annotations

from pathlib import Path

import pytest
from armtrue import Fit, Model, diagnose, fit, load_data, load_model, load_robot
from armtrue_sim import simulate

GEOMETRY = [{"effect": name} for name in ("base_frame", "tool_offset", "joint_offset", "link_geometry")]


def squares(fitted: Fit) -> float:
    return float(fitted.document["error"]["train"]["rms_um"]) ** 2


@pytest.mark.full
def test_refit_confirms_what_candidates_explain(tmp_path: Path) -> None:
    # The forms of a beam had `explained` of zero, in spite of all the evidence for them.
    simulate(
        {"arm": "kr30", "seed": 4, "poses": 240, "test_poses": 0,
         "believed": [entry["effect"] for entry in GEOMETRY],
         "hidden": [{"effect": "bending_compliance", "joints": [1]}]},
        tmp_path,
    )  # fmt: skip
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(tmp_path / "data.csv", robot)
    plain = fit(data, robot, Model(GEOMETRY))
    paying = [c for c in diagnose(plain)["candidates"] if c["delta_bic"] < -100.0]
    assert {(c["effect"], c["options"].get("shape")) for c in paying} >= {
        ("bending_compliance", None),
        ("bending_compliance", "beam"),
    }
    for c in paying[:5]:
        entry = {"effect": c["effect"], "joints": c["joints"], **c["options"]}
        fuller = fit(data, robot, Model([*GEOMETRY, entry]))
        explained = 1.0 - squares(fuller) / squares(plain)
        if fuller.document["nonlinear"]:  # the fit finds the shape, the candidate has the nearest of a few
            assert explained - 0.06 < c["explained"] < explained + 0.02, entry
        else:
            assert c["explained"] == pytest.approx(explained, abs=0.02), entry


@pytest.mark.full
def test_reason_of_a_candidate_agrees_with_its_figures(tmp_path: Path) -> None:
    simulate({"arm": "kr30", "seed": 5, "poses": 240, "test_poses": 0, "hidden": [
        {"effect": "gear_harmonics", "joints": [3]}, {"effect": "thermal_expansion"}]}, tmp_path)  # fmt: skip
    robot = load_robot(tmp_path / "robot.yaml")
    model = load_model(tmp_path / "model.yaml", robot)
    found = diagnose(fit(load_data(tmp_path / "data.csv", robot), robot, model))
    said = [c for c in found["candidates"] if "held-out mean" in c["why"]]
    assert said
    for c in said:
        assert f"explains {100 * c['explained']:.1f} %" in c["why"]
        assert c["held_out_mean_um_if_added"] == pytest.approx(
            found["error"]["held_out"]["mean_um"] * (1.0 - c["explained"]) ** 0.5
        )
