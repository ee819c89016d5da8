"""Backlash without recorded directions of approach: the order of the rows reveals it."""

from __future__ import annotations

from pathlib import Path

import armtrue
import pytest
from armtrue_sim import simulate


@pytest.mark.full
@pytest.mark.parametrize(
    ("arm", "seed", "joints"),
    [
        ("kr30", 131, [2, 3]),
        ("irb2400", 134, [2]),
    ],
)
def test_unrecorded_backlash_is_not_named_as_an_angle_effect(
    arm: str, seed: int, joints: list[int], tmp_path: Path
) -> None:
    hidden = [{"effect": "backlash", "joints": joints}]
    without = [f"dir{k}" for k in range(1, 7)]
    simulate(
        {
            "arm": arm,
            "seed": seed,
            "test_poses": 0,
            "hidden": hidden,
            "directions": "order",
            "columns": {"omit": without},
        },
        tmp_path,
    )
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data = armtrue.load_data(tmp_path / "data.csv", robot)
    assert not any(name.startswith(("dir", "travel")) for name in data.columns)
    # A joint moves up to large angles and down to small ones: joint_scale was named for that.
    _, story = armtrue.refine(armtrue.fit(data, robot, armtrue.load_model(tmp_path / "model.yaml", robot)))
    assert len(story.steps) == 1
    last = story.steps[-1]
    assert last["verdict"] == "unexplained_structure"
    assert last["unexplained"][0]["variables"][0] in [f"dir{k}" for k in joints]
    assert any("derive: {dir: from_order}" in sentence for sentence in last["advice"])
    assert "backlash" in [entry["effect"] for entry in last["untestable"]]
