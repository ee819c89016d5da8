"""How warm a gear is by its own work no single pose knows: a prediction is of the arm at its mean warmth."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from armtrue import fit, load_data, load_model, load_robot
from armtrue_sim import simulate


def test_a_prediction_is_of_an_arm_as_warm_as_it_was_on_average(tmp_path: Path) -> None:
    # A cold arm was predicted: a fit's own rows were off by all that the gear had warmed.
    simulate(
        {
            "arm": "kr30",
            "seed": 1,
            "poses": 200,
            "test_poses": 0,
            "believed": [
                "base_frame",
                "tool_offset",
                "joint_offset",
                {"effect": "self_heating", "joints": [2]},
            ],
            "columns": {"add": ["duty"]},
        },
        tmp_path,
    )
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(tmp_path / "data.csv", robot)
    fitted = fit(data, robot, load_model(tmp_path / "model.yaml", robot))
    predicted = fitted.predict(data)
    left_out = data.positions_m - fitted.residuals() - predicted
    turned = dataclasses.replace(data, columns={**data.columns, "q2": data.columns["q2"] + 1e-4})
    lever = (fitted.predict(turned) - predicted) / 1e-4
    # Of the angle by which warmth turns axis 2, weighed by how far a turn moves the reflector.
    mean = (left_out * lever).sum() / (lever**2).sum()
    spread = np.sqrt((left_out**2).sum() / (lever**2).sum())
    assert spread > 1e-6
    assert abs(mean) < 0.2 * spread
