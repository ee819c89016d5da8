"""A table is reported as a table: its cost, and what would replace it by a physical effect."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from armtrue import Model, diagnose, fit, load_data, load_robot
from armtrue_sim import simulate

GEOMETRY = [
    {"effect": name}
    for name in ("base_frame", "tool_offset", "joint_offset", "link_geometry", "joint_compliance")
]
WAVES = {"effect": "gear_harmonics", "joints": [3], "scale": 4.0}
LINE = {
    "effect": "custom", "name": "line", "coordinate": "motor3", "expression": "sin(9*q3)", "joints": [3], "value": 2e-4,
}  # fmt: skip
ROUGH = {"effect": "transmission_pwl", "joints": [3], "scale": 4.0}


@pytest.mark.quick("hidden0-gear_harmonics on joint 3")
@pytest.mark.parametrize(
    ("hidden", "words"),
    [(WAVES, "gear_harmonics on joint 3"), (ROUGH, "turn joint 3 alone"), (LINE, "cycles=[9")],
)
def test_table_states_its_cost_and_next_step(tmp_path: Path, hidden: dict[str, Any], words: str) -> None:
    simulate({"arm": "kr30", "seed": 4, "poses": 240, "test_poses": 0, "hidden": [hidden]}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    table = {"effect": "transmission_pwl", "joints": [3]}
    data = load_data(tmp_path / "data.csv", robot)
    found = diagnose(fit(data, robot, Model([*GEOMETRY, table])))
    poses = len(np.unique(np.stack([data.columns[f"q{k}"] for k in range(1, 7)]), axis=1).T)
    (said,) = found["tables"]
    assert (said["effect"], said["joints"]) == ("transmission_pwl", [3])
    assert said["nodes_per_pose"] == pytest.approx(said["nodes"] / poses)
    assert words in said["next"]
    (sentence,) = [s for s in found["advice"] if "a table, not physics" in s]
    assert sentence.startswith("transmission_pwl 3: ")
    assert said["next"] in sentence


def test_physical_effects_are_not_reported_as_tables(tmp_path: Path) -> None:
    simulate({"arm": "kr30", "seed": 4, "poses": 60, "test_poses": 0}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    found = diagnose(fit(load_data(tmp_path / "data.csv", robot), robot, Model(GEOMETRY)))
    assert found["tables"] == []
    assert not any("not physics" in s for s in found["advice"])


@pytest.mark.full
def test_table_of_a_prismatic_joint_advises_to_move_it(tmp_path: Path) -> None:
    # A wave in metres was searched for per turn, and harmonics of a gear were advised for a rail.
    simulate({"arm": "stanford", "seed": 4, "poses": 120, "test_poses": 0}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    table = {"effect": "transmission_pwl", "joints": [3]}
    data = load_data(tmp_path / "data.csv", robot)
    (said,) = diagnose(fit(data, robot, Model([*GEOMETRY[:4], table])))["tables"]
    assert said["next"].startswith("move joint 3 alone")
    assert said["cycles"] is None


@pytest.mark.full
def test_slope_of_a_table_is_not_named_joint_scale(tmp_path: Path) -> None:
    """Waves have a slope over the range of a joint; orientations determine it, and it was named joint_scale."""
    waves = {"effect": "transmission_pwl", "joints": [1, 2, 3, 4, 5, 6], "shape": "waves"}
    scenario = {"arm": "kr30", "seed": 3, "poses": 700, "test_poses": 0, "columns": {"add": ["orientation"]}}
    simulate({**scenario, "instrument": {"sigma": 10e-6}, "hidden": [waves]}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    table = {"effect": "transmission_pwl", "joints": [1, 2, 3, 4, 5, 6]}
    found = diagnose(fit(load_data(tmp_path / "data.csv", robot), robot, Model([*GEOMETRY, table])))
    assert not any(c["recommend"] for c in found["candidates"] if c["effect"] == "joint_scale")
