"""Masses that are half of what the arm has: gears and motors left out of them, as in many URDFs."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from armtrue import fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate


@pytest.mark.parametrize("seed", [1, 2])
def test_half_of_the_masses_is_one_cause(seed: int, tmp_path: Path) -> None:
    # Each mass was drawn back to its file's by its prior, and what let it was named with more than 99 %.
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
