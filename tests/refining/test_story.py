"""The order in which a refinement tells what it found: each step is one that a reader sees the error fall by."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import armtrue
from armtrue_sim import simulate


def test_what_is_seen_alone_comes_first_and_what_only_a_table_uncovers_comes_after_it(tmp_path: Path) -> None:
    """On a real UR10, fifteen steps that lowered nothing came before the one that took four fifths of the error."""
    scenario = {
        "arm": "kr30",
        "seed": 6,
        "poses": 450,
        "test_poses": 0,
        "believed": ["base_frame", "tool_offset", "joint_offset", "link_geometry", "joint_compliance"],
        "hidden": [
            {
                "effect": "transmission_pwl",
                "joints": [1, 2, 3],
                "shape": "table",
                "size": 1.5e-4,
                "spacing": 12.0,
            },
            {"effect": "gear_harmonics", "joints": [4]},
            {"effect": "thermal_base"},
        ],
    }
    simulate(scenario, tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data = armtrue.load_data(tmp_path / "data.csv", robot)
    _, story = armtrue.refine(armtrue.fit(data, robot, armtrue.load_model(tmp_path / "model.yaml", robot)))
    errors = [step["error"]["held_out"]["rms_um"] for step in story.steps]
    names = [step["added"] and step["added"]["effect"] for step in story.steps]
    table = names.index("transmission_pwl")
    falls = [before - after for before, after in pairwise(errors)]
    assert falls[table - 1] == max(falls)
    assert all(fall > 0.02 * errors[0] for fall in falls[:table])
    assert {"thermal_base", "gear_harmonics"} <= set(names[table + 1 :])
