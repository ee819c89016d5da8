"""Errors of one joint with kinks, random heights or a step: a table or the step is named, no wave."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from armtrue import fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate


def last_step(folder: Path, arm: str, seed: int, hidden: dict[str, Any]) -> dict[str, Any]:
    """The end of `refine` for a campaign with one hidden error."""
    simulate({"arm": arm, "seed": seed, "poses": 240, "test_poses": 0, "hidden": [hidden]}, folder)
    robot = load_robot(folder / "robot.yaml")
    first = fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))
    _best, story = refine(first)
    result: dict[str, Any] = story["steps"][-1]
    return result


def found(last: dict[str, Any]) -> list[tuple[str, list[int]]]:
    return [(e["effect"], e["joints"]) for e in last["effects"] if e.get("probability") is not None]


@pytest.mark.parametrize(
    ("arm", "joint"),
    [
        ("irb2400", 1),
        pytest.param("cobot", 3, marks=pytest.mark.full),
        pytest.param("cobot", 5, marks=pytest.mark.full),
    ],
)
def test_kink_is_a_table_without_harmonics(tmp_path: Path, arm: str, joint: int) -> None:
    # Its slow part is larger than any table with short correlation lengths would have.
    kink = {"effect": "custom", "name": "kink", "coordinate": f"motor{joint}", "expression": f"abs(q{joint} - 0.3)",
            "joints": [joint], "value": 2e-4}  # fmt: skip
    last = last_step(tmp_path, arm, 4000 + joint, kink)
    assert found(last) == [("transmission_pwl", [joint])]
    assert last["verdict"] == "nothing_missing"


@pytest.mark.parametrize("seed", [2013034578, *(pytest.param(s, marks=pytest.mark.full) for s in (1, 2, 3))])
def test_random_table_is_a_table_without_a_wave(tmp_path: Path, seed: int) -> None:
    # Between the correlation lengths that a search has, it must not find the table rougher or smoother than it is.
    last = last_step(tmp_path, "kr30", seed, {"effect": "transmission_pwl", "joints": [1], "shape": "table"})
    assert found(last) == [("transmission_pwl", [1])]


@pytest.mark.parametrize("at", [-0.209, *(pytest.param(a, marks=pytest.mark.full) for a in (-0.5, 0.1, 0.4))])
def test_step_is_named_with_the_angle_that_has_it(tmp_path: Path, at: float) -> None:
    # Axis 2's load varies with the angle. A step between two nodes of the angle's smooth function was one of the load.
    step = {"effect": "custom", "name": "joint_step", "coordinate": "motor1", "expression": f"sign(q2 - {at})",
            "joints": [2], "value": -1.3e-4}  # fmt: skip
    last = last_step(tmp_path, "irb2400", 878480894, step)
    assert last["verdict"] == "unexplained_structure"
    assert last["unexplained"][0]["variable"] == "q2"
    assert found(last) == []
