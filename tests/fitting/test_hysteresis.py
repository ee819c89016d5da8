"""Hysteresis without recorded travel: how far each joint came follows from the order of the rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import armtrue
import numpy as np
import pytest
from armtrue_sim import simulate

SCENARIO = {
    "arm": "kr30",
    "seed": 4,
    "poses": 200,
    "test_poses": 60,
    "directions": "order",
    "believed": ["base_frame", "tool_offset", "joint_offset", "link_geometry"],
    "hidden": [{"effect": "hysteresis", "joints": [2]}],
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hysteresis")
    simulate(SCENARIO).write(folder)
    assert "travel" not in (folder / "data.csv").read_text().splitlines()[0]
    return folder


def refined(folder: Path) -> tuple[armtrue.Fit, dict[str, Any]]:
    arm = armtrue.load_robot(folder / "robot.yaml")
    fit = armtrue.fit(
        armtrue.load_data(folder / "data.csv", arm), arm, armtrue.load_model(folder / "model.yaml", arm)
    )
    return armtrue.refine(fit)


def test_hysteresis_is_found_and_unordered_poses_assume_long_travel(files: Path) -> None:
    fit, story = refined(files)
    added = [e for e in fit.effects if isinstance(e, dict) and e["effect"] == "hysteresis"]
    assert [e["joints"] for e in added] == [[2]]
    assert story["steps"][-1]["verdict"] == "nothing_missing"
    arm = armtrue.load_robot(files / "robot.yaml")
    test = armtrue.load_data(files / "test.csv", arm)
    assert "travel2" not in test.columns
    assert any("a long travel since the last reversal" in note for note in fit.assumed(test)[1])
    # Most motions are much longer than friction's wind-up.
    off = np.linalg.norm(fit.predict(test) - test.positions_m, axis=1)
    assert np.median(off) < 8e-6


@pytest.mark.full
def test_prediction_with_hysteresis_depends_on_its_row_alone(files: Path) -> None:
    fit, _ = refined(files)
    arm = armtrue.load_robot(files / "robot.yaml")
    data = armtrue.load_data(files / "data.csv", arm)
    np.testing.assert_array_equal(fit.predict(data)[50:60], fit.predict(data.take(np.arange(50, 60))))
