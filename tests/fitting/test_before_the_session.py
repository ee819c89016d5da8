"""Predictions for poses before the first fitted one: the arm was as cold as at the first."""

from __future__ import annotations

from pathlib import Path

import armtrue
import numpy as np
import pytest
from armtrue_sim import simulate


@pytest.mark.parametrize("earlier_s", [1200.0, 86400.0])
def test_arm_before_its_warm_up_is_cold(tmp_path: Path, earlier_s: float) -> None:
    # 1 - exp(-t/tau) is huge at negative t: a day before the session the predicted position was 1e20 m away.
    simulate({"arm": "kr30", "seed": 2, "poses": 150, "hidden": [{"effect": "warm_up"}]}, tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    model = armtrue.load_model(tmp_path / "model.yaml", robot)
    warm = armtrue.Model([*model.effects, {"effect": "warm_up"}])
    fit = armtrue.fit(armtrue.load_data(tmp_path / "data.csv", robot), robot, warm)
    start = armtrue.load_data(tmp_path / "test.csv", robot)
    start.columns["time"][:] = 0.0
    before = armtrue.load_data(tmp_path / "test.csv", robot)
    before.columns["time"][:] = -earlier_s
    assert np.array_equal(fit.predict(before), fit.predict(start))
