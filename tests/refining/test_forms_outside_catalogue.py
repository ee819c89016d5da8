"""Causes outside the catalogue that resemble one of its effects: said as such, no effect in their place.

A spring that is softer at some angles of its joint than at others, and a zero that changes with the square of a
temperature.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from armtrue import fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate


def refined(folder: Path, arm: str, hidden: dict[str, object]) -> dict[str, Any]:
    """The last step of `refine` on a campaign with this effect hidden."""
    simulate({"arm": arm, "seed": 1, "poses": 240, "test_poses": 0, "hidden": [hidden]}, folder)
    robot = load_robot(folder / "robot.yaml")
    first = fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))
    _best, story = refine(first)
    last: dict[str, Any] = story["steps"][-1]
    return last


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
    last = refined(tmp_path, arm, uneven)
    assert last["verdict"] == "unexplained_structure"
    assert last["unexplained"][0]["variable"] == f"tau{joint}*q{joint}"
    assert "stiffness varies" in last["unexplained"][0]["shape"]
    assert not [e for e in last["effects"] if e.get("probability") is not None]


@pytest.mark.parametrize(
    ("arm", "joint", "value"), [("kr30", 2, 1e-6), pytest.param("cobot", 3, 3e-6, marks=pytest.mark.full)]
)
def test_square_of_temperature_is_structure_and_no_self_heating(
    tmp_path: Path, arm: str, joint: int, value: float
) -> None:
    curved = {"effect": "custom", "name": "curved", "coordinate": f"motor{joint}", "joints": [joint],
              "expression": "dT_arm^2", "value": value}  # fmt: skip
    last = refined(tmp_path, arm, curved)
    assert last["verdict"] == "unexplained_structure"
    assert last["unexplained"][0]["variable"] == "dT_arm"
    assert "square of the temperature change" in last["unexplained"][0]["shape"]
    assert not [e for e in last["effects"] if e.get("probability") is not None]
    assert any(f"coordinate motor{joint} with the expression dT_arm^2" in line for line in last["advice"])
