"""Warnings where the springs of a fit contradict the gravity of robot.yaml."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import armtrue_sim
import pytest
from armtrue import fitting
from armtrue.io import load_data, load_model, load_robot
from armtrue.springs import warnings_of_springs


@pytest.fixture
def warnings(tmp_path: Path) -> Callable[..., list[str]]:
    def of_fit(arm: str, seed: int, gravity: list[float], masses: bool = True, **more: Any) -> list[str]:
        campaign = armtrue_sim.simulate({"arm": arm, "seed": seed, "hidden": [], **more})
        campaign.robot["gravity"] = gravity
        if not masses:
            del campaign.robot["links"]
        campaign.write(tmp_path)
        robot = load_robot(tmp_path / "robot.yaml")
        model = load_model(tmp_path / "model.yaml", robot)
        fit = fitting.fit(load_data(tmp_path / "data.csv", robot), robot, model, folds=2)
        return list(fit.document["warnings"])

    return of_fit


@pytest.mark.quick("False-lbr-7", "True-kr30-31")
@pytest.mark.parametrize(("arm", "seed"), [("irb2400", 53), ("kr30", 31), ("cobot", 192), ("lbr", 7)])
@pytest.mark.parametrize("masses", [True, False])
def test_fit_warns_of_gravity_with_the_wrong_sign(warnings, arm, seed, masses):
    assert warnings(arm, seed, [0.0, 0.0, -9.81], masses) == []
    (said,) = warnings(arm, seed, [0.0, 0.0, 9.81], masses)
    assert "joint_compliance[2]" in said
    assert "come out negative" in said
    assert "gravity of robot.yaml points the other way" in said
    assert "'gravity: [0.0, 0.0, -9.81]'" in said


@pytest.mark.parametrize("gravity", [[9.81, 0.0, 0.0], [0.0, -9.81, 0.0]])
@pytest.mark.parametrize(("arm", "seed"), [("irb2400", 53), ("kr30", 191), ("cobot", 192)])
def test_fit_warns_of_gravity_along_a_wrong_axis(warnings, arm, seed, gravity):
    (said,) = warnings(arm, seed, gravity)
    assert "no joint deflects under load" in said
    assert "° from the measuring frame's −z" in said


def test_missing_effects_cause_no_gravity_warning(warnings):
    hidden = [{"effect": "gear_harmonics", "joints": [2, 3]}, {"effect": "backlash", "joints": [2, 3]}]
    for seed in (1, 2, 3):
        assert warnings("kr30", seed, [0.0, 0.0, -9.81], hidden=hidden) == []


def springs(*values: float | None, sign: int = 1, unit: str = "rad/Nm") -> list[dict[str, Any]]:
    return [
        {"name": f"spring[{k}]", "value": value or 0.0, "sigma": value and 1.0, "sign": sign, "unit": unit}
        for k, value in enumerate(values)
    ]


def test_uncertain_springs_cause_no_gravity_warning(tmp_path, warnings):
    warnings("kr30", 1, [0.0, 0.0, -9.81])
    robot = load_robot(tmp_path / "robot.yaml")
    level = {"measuring_from_base": {"xyz": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}}
    assert warnings_of_springs({**level, "parameters": springs(-50.0)}, robot)
    for parameters in (
        [],
        springs(-50.0, 50.0),
        springs(-9.0, 9.0),
        springs(None),
        springs(-50.0, sign=0),
        springs(-50.0, unit="rad"),
    ):
        assert warnings_of_springs({**level, "parameters": parameters}, robot) == []
