"""robot.yaml with half of the true masses: gears and motors are left out, as in many URDFs."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from armtrue import fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate
from armtrue_sim.cases import hidden_cases


@pytest.mark.quick("2")
@pytest.mark.parametrize("seed", [1, 2])
def test_halved_masses_are_named_as_one_cause(seed: int, tmp_path: Path) -> None:
    # Priors drew the masses back to the file's, and an effect that explained the rest was named with more than 99 %.
    simulate(
        {"arm": "cobot", "seed": seed, "poses": 80, "test_poses": 0, "payloads": [0.0, 2.0, 5.0]}, tmp_path
    )
    content = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    for link in content["links"]:
        link["mass"] *= 0.5
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(content))
    robot = load_robot(tmp_path / "robot.yaml")
    first = fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot))
    _best, story = refine(first)
    added = [step["added"]["effect"] for step in story["steps"] if step["added"]]
    assert added == ["mass_parameters"]
    assert story["steps"][-1]["verdict"] == "nothing_missing"


@pytest.mark.full
def test_refine_handles_a_mass_that_only_fitted_springs_show(tmp_path: Path) -> None:
    # The search looked that mass up in the fit, which had been built before the springs were known, and read out of
    # bounds: every second run of this campaign crashed, or reported that there was no memory left.
    hidden_cases("real_nothing", "irb2400", 31907).campaign.write(tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    data, model = load_data(tmp_path / "data.csv", robot), load_model(tmp_path / "model.yaml", robot)
    for _ in range(3):
        _best, story = refine(fit(data, robot, model))
        assert story["steps"][-1]["verdict"] == "nothing_missing"
        assert {entry["effect"] for entry in story["steps"][-1]["effects"]} >= {"mass_parameters"}
