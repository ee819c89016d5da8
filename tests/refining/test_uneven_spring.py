"""A spring that is softer at some angles of its joint than at others: said as such, no effect in its place."""

from __future__ import annotations

from pathlib import Path

import pytest
from armtrue import fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate


@pytest.mark.parametrize(
    ("arm", "joint", "form"),
    [
        ("kr30", 2, "cos(2*q2)"),
        pytest.param("kr30", 3, "sin(q3)", marks=pytest.mark.full),
        pytest.param("cobot", 2, "sin(q2)", marks=pytest.mark.full),
        pytest.param("cobot", 3, "sin(2*q3 + 0.7)", marks=pytest.mark.full),
        pytest.param("irb2400", 3, "cos(2*q3)", marks=pytest.mark.full),
    ],
)
def test_uneven_spring_is_structure_and_no_effect(tmp_path: Path, arm: str, joint: int, form: str) -> None:
    # A tenth of the springs of these arms, in rad/Nm.
    value = {"kr30": 1.9e-7, "irb2400": 2.2e-7, "cobot": 3.7e-6}[arm]
    uneven = {"effect": "custom", "name": "uneven", "coordinate": f"motor{joint}", "joints": [joint],
              "expression": f"tau{joint}*{form}", "value": value}  # fmt: skip
    simulate({"arm": arm, "seed": 1, "poses": 240, "test_poses": 0, "hidden": [uneven]}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    first = fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot))
    _best, story = refine(first)
    last = story["steps"][-1]
    assert last["verdict"] == "unexplained_structure"
    assert last["unexplained"][0]["variable"] == f"tau{joint}*q{joint}"
    assert "stiffness varies" in last["unexplained"][0]["shape"]
    assert not [e for e in last["effects"] if e.get("probability") is not None]
