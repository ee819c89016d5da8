"""The advice of a diagnosis can be followed as printed, and its promises hold."""

from __future__ import annotations

import json
import shlex
from typing import Any

import numpy as np
import pytest
from armtrue import _core
from armtrue_sim import simulate
from armtrue_sim.cases import hidden_cases
from armtrue_sim.kinds import ARMS

Fit = Any


def fit_of(plan: dict[str, Any], without: str = "", robot: dict[str, Any] | None = None) -> Fit:
    """Fit the believed model to a simulated campaign, without the columns whose names begin with `without`."""
    campaign = simulate(plan)
    columns = {
        name: np.ascontiguousarray(values, dtype=float)
        for name, values in campaign.data.items()
        if not (without and name.startswith(without))
    }
    model = {"effects": campaign.model["effects"]}
    return _core.fit(json.dumps(robot or campaign.robot), columns, json.dumps(model)), campaign, columns


def advised(diagnosis: dict[str, Any]) -> dict[str, Any]:
    """The entry of model.yaml that the advised command adds."""
    line = next(text for text in diagnosis["advice"] if "armtrue add" in text)
    words = shlex.split(line[line.index("armtrue add") :])
    assert words[:3] == ["armtrue", "add", "FIT"]
    assert words[-2:] == ["--out", "FIT2"]
    entry: dict[str, Any] = {"effect": words[3]}
    rest = words[4:-2]
    for flag, value in zip(rest[::2], rest[1::2], strict=True):
        if flag == "--joints":
            entry["joints"] = [int(joint) for joint in value.split(",")]
        else:
            assert flag == "--option"
            name, text = value.split("=", 1)
            entry[name] = json.loads(text) if text[0] in "[0123456789-" else text
    return entry


def custom(coordinate: str, expression: str, joints: list[int], value: float) -> dict[str, Any]:
    return {
        "effect": "custom",
        "name": "odd",
        "coordinate": coordinate,
        "expression": expression,
        "joints": joints,
        "value": value,
    }


@pytest.mark.quick("hidden0-0.5")
@pytest.mark.parametrize(
    ("hidden", "falls_to"),
    [
        (custom("motor5", "sin(13*q5 + 0.7)", [5], 1.5e-4), 0.5),
        (custom("motor2", "sin(q1)*cos(q3)", [1, 3], 1.5e-4), 0.8),
        ({"effect": "backlash", "joints": [3]}, 0.5),
    ],
)
def test_advised_command_lowers_the_held_out_error(hidden: dict[str, Any], falls_to: float) -> None:
    fit, campaign, columns = fit_of({"arm": "kr30", "seed": 3, "hidden": [hidden]})
    diagnosis = json.loads(_core.diagnose(fit))
    before = diagnosis["error"]["held_out"]["mean_um"]
    model = {"effects": [*campaign.model["effects"], advised(diagnosis)]}
    after = json.loads(_core.fit(json.dumps(campaign.robot), columns, json.dumps(model)).document())
    assert after["error"]["held_out"]["mean_um"] < falls_to * before


@pytest.mark.full
@pytest.mark.parametrize("gear_ratio", [None, 40.0])
def test_gear_mesh_is_found_with_unknown_or_wrong_gear_ratio(gear_ratio: float | None) -> None:
    plan = {"arm": "kr30", "seed": 5, "hidden": [custom("motor2", "cos(421*q2)", [2], 1.5e-4)]}
    robot = json.loads(json.dumps(simulate(plan).robot))
    for joint in robot["kinematics"]["joints"]:
        joint.pop("gear_ratio", None)
        if gear_ratio is not None:
            joint["gear_ratio"] = gear_ratio
    fit, _, _ = fit_of(plan, robot=robot)
    diagnosis = json.loads(_core.diagnose(fit))
    assert diagnosis["verdict"] == "missing_effect"
    first = diagnosis["candidates"][0]
    assert (first["effect"], first["joints"]) == ("gear_mesh", [2])
    assert first["options"]["cycles"][0] == pytest.approx(421.0, abs=0.5)
    assert any("421 cycles a turn on joint 2" in line for line in diagnosis["advice"])


@pytest.mark.full
@pytest.mark.parametrize("joint", [2, 3])
def test_advice_names_the_direction_column_to_record(joint: int) -> None:
    hidden = [{"effect": "backlash", "joints": [joint], "scale": 3.0}]
    fit, _, _ = fit_of({"arm": "kr30", "seed": 7, "hidden": hidden}, without="dir")
    advice = json.loads(_core.diagnose(fit))["advice"]
    assert any(f"record dir{joint}" in line for line in advice), advice


@pytest.mark.quick("lbr")
@pytest.mark.parametrize("arm", ARMS)
def test_complete_model_gets_no_advice_to_record_directions(arm: str) -> None:
    case = hidden_cases("nothing_hidden", arm, 11)
    columns = {
        name: np.ascontiguousarray(values, dtype=float)
        for name, values in case.campaign.data.items()
        if not name.startswith("dir")
    }
    fit = _core.fit(json.dumps(case.campaign.robot), columns, json.dumps({"effects": case.believed}))
    diagnosis = json.loads(_core.diagnose(fit))
    assert diagnosis["verdict"] == "nothing_missing"
    assert not any("as backlash does" in line for line in diagnosis["advice"]), diagnosis["advice"]


@pytest.mark.full
def test_two_present_effects_are_not_listed_as_confounded() -> None:
    hidden = [
        {"effect": "backlash", "joints": [2], "scale": 2.0},
        {"effect": "joint_scale", "joints": [4], "scale": 2.0},
    ]
    fit, _, _ = fit_of({"arm": "kr30", "seed": 2, "hidden": hidden})
    candidates = json.loads(_core.diagnose(fit))["candidates"]
    for candidate in candidates:
        name = (candidate["effect"], candidate["joints"])
        if name == ("backlash", [2]):
            assert "joint_scale 4" not in candidate["confounded_with"]
        if name == ("joint_scale", [4]):
            assert "backlash 2" not in candidate["confounded_with"]


def test_indistinguishable_effects_are_listed_as_confounded() -> None:
    # Gear harmonics follow this balancer's effect to a micrometre.
    case = hidden_cases("one_hidden", "kr30", 124)
    columns = {name: np.ascontiguousarray(v, dtype=float) for name, v in case.campaign.data.items()}
    fit = _core.fit(json.dumps(case.campaign.robot), columns, json.dumps({"effects": case.believed}))
    first = json.loads(_core.diagnose(fit))["candidates"][0]
    names = {first["effect"], *(label.split(" ")[0] for label in first["confounded_with"])}
    assert {"gravity_balancer", "gear_harmonics"} <= names
