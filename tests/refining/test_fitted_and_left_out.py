"""A candidate of the last search of a refinement that a fit has shown not to help."""

from __future__ import annotations

from pathlib import Path

import armtrue
import pytest
from armtrue_sim import simulate


@pytest.mark.full
def test_candidate_fitted_and_left_out_is_not_advised_again(tmp_path: Path) -> None:
    hidden = [{"effect": "gear_harmonics", "joints": [3]}]
    simulate({"arm": "cobot", "seed": 94, "poses": 240, "test_poses": 0, "hidden": hidden}, tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data = armtrue.load_data(tmp_path / "data.csv", robot)
    # The payload of a quarter of the poses was not recorded. Other masses look a little like that.
    data.columns["payload"][60:120] = 0.0
    _, story = armtrue.refine(armtrue.fit(data, robot, armtrue.load_model(tmp_path / "model.yaml", robot)))
    last = story.steps[-1]
    assert last["verdict"] != "missing_effect"
    assert not any(candidate["recommend"] for candidate in last["candidates"])
    assert last["advice"][0].startswith("mass_parameters (probability ")
    assert not any("armtrue add FIT mass_parameters" in sentence for sentence in last["advice"])
    left_out = next(c for c in last["candidates"] if c["effect"] == "mass_parameters")
    assert left_out["why"].startswith("was fitted and left out")
