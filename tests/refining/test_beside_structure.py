"""A cause that runs with time is named although something of the arm's posture is left that no effect explains."""

from __future__ import annotations

from pathlib import Path

import pytest
from armtrue import diagnose, fit, load_data, load_model, load_robot
from armtrue_sim import simulate

PRODUCT = {
    "effect": "custom", "name": "joint_product", "coordinate": "motor2", "expression": "sin(q1)*cos(q3)",
    "joints": [1, 3], "value": 3e-4,
}  # fmt: skip


@pytest.mark.parametrize("seed", [3, 4])
def test_drift_is_named_beside_a_function_of_two_angles(tmp_path: Path, seed: int) -> None:
    hidden = [PRODUCT, {"effect": "time_drift", "scale": 20.0}]
    simulate({"arm": "kr30", "seed": seed, "poses": 240, "test_poses": 0, "hidden": hidden}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    fitted = fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot))
    found = diagnose(fitted)
    named = {c["effect"]: c["probability"] for c in found["candidates"] if c["probability"] > 0.5}
    assert named.keys() == {"time_drift"}
    assert found["verdict"] == "missing_effect"
