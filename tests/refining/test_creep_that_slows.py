"""A creep whose form no effect has is named time_drift, and the remainder is reported."""

from __future__ import annotations

from pathlib import Path

import pytest
from armtrue import fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
def test_creep_that_slows_down_is_named_time_drift(tmp_path: Path, seed: int) -> None:
    creep = {"effect": "custom", "name": "creep", "coordinate": "base.tz", "value": 4e-4}
    simulate(
        {"arm": "kr30", "seed": seed, "poses": 240, "test_poses": 0,
         "hidden": [{**creep, "expression": "1 - exp(-time/2000)"}]},
        tmp_path,
    )  # fmt: skip
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(tmp_path / "data.csv", robot)
    for name in [name for name in data.columns if name.startswith("temp_")]:
        del data.columns[name]  # they rise as the creep does
    first = fit(data, robot, load_model(tmp_path / "model.yaml", robot))
    _best, story = refine(first)
    last = story["steps"][-1]
    added = {e["effect"]: e["probability"] for e in last["effects"] if e.get("probability") is not None}
    assert added.keys() == {"time_drift"}
    assert added["time_drift"] > 0.9
    held_out = [step["error"]["held_out"]["mean_um"] for step in story["steps"]]
    assert held_out[-1] < 0.8 * held_out[0]
    # A straight line does not explain all of it.
    assert last["verdict"] == "unexplained_structure"
    assert last["unexplained"][0]["variables"] == ["time"]
    # A custom effect of time would count as the arm's, and no direction column shows what depends on time.
    said = " ".join(last["advice"])
    assert "station" in said
    assert "custom" not in said
    assert "as backlash does" not in said
