"""An error that differs between poses but not between repeats of a pose is not a joint's repeatability."""

from __future__ import annotations

from pathlib import Path

import pytest
from armtrue import diagnose, fit, load_data, load_model, load_robot
from armtrue_sim import simulate


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
def test_pattern_too_fine_to_be_named_is_not_called_noise(seed: int, tmp_path: Path) -> None:
    # The pattern moves one joint. It was taken for poor repeatability of that joint, and repeats were then compared
    # with this repeatability.
    fine = {
        "effect": "custom", "name": "fine", "coordinate": "motor2", "expression": "sin(37*q1)*cos(41*q3)",
        "joints": [1, 3], "value": 6e-5,
    }  # fmt: skip
    simulate(
        {
            "arm": "kr30",
            "seed": seed,
            "poses": 200,
            "test_poses": 0,
            "repeats": {"poses": 8, "times": 3},
            "hidden": [fine],
        },
        tmp_path,
    )
    robot = load_robot(tmp_path / "robot.yaml")
    found = diagnose(
        fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot))
    )
    assert found["verdict"] == "unexplained_structure"
    assert found["lack_of_fit"]["against"] == "repeats"
    assert found["lack_of_fit"]["log10_p"] < -5.0


@pytest.mark.full
def test_clustered_gross_errors_are_reported_as_structure(tmp_path: Path) -> None:
    # All poses near one angle of axis 2 were kept out as bumped reflectors, and the rest was called noise.
    bump = {
        "effect": "custom", "name": "bump", "coordinate": "motor2", "expression": "exp(-((q2 + 0.8)*30)^2)",
        "joints": [2], "value": 1e-3,
    }  # fmt: skip
    simulate({"arm": "kr30", "seed": 1, "poses": 260, "test_poses": 0, "hidden": [bump]}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    fitted = fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot))
    assert len(fitted.document["rejected"]) > 4
    found = diagnose(fitted)
    assert found["verdict"] == "unexplained_structure"
    assert [entry["variable"] for entry in found["unexplained"]] == ["q2"]
    assert "kept out as gross errors" in found["unexplained"][0]["shape"]
