"""Knocks and swings of base or instrument while measuring: no drift and no joint may be named for them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from armtrue import diagnose, fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate

KNOCK_M = np.array([3e-4, -2e-4, 1e-4])
HIDDEN = {"effect": "backlash", "joints": [2]}


@pytest.fixture(
    params=[pytest.param([], marks=pytest.mark.full), [HIDDEN]],
    ids=["nothing else hidden", "backlash hidden"],
)
def knocked(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Any, list[dict[str, Any]]]:
    simulate({"arm": "kr30", "seed": 71, "poses": 200, "test_poses": 0, "hidden": request.param}, tmp_path)
    path = tmp_path / "data.csv"
    header, *lines = path.read_text().splitlines()
    names = header.split(",")
    at = [names.index(axis) for axis in "xyz"]
    for number in range(120, len(lines)):
        cells = lines[number].split(",")
        for column, moved in zip(at, KNOCK_M, strict=True):
            cells[column] = str(float(cells[column]) + moved)
        lines[number] = ",".join(cells)
    path.write_text("\n".join([header, *lines]) + "\n")
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(path, robot)
    return fit(data, robot, load_model(tmp_path / "model.yaml", robot)), request.param


@pytest.mark.full
def test_knock_is_not_named_as_drift(knocked: tuple[Any, list[dict[str, Any]]]) -> None:
    before, hidden = knocked
    best, story = refine(before)
    assert [step["added"]["effect"] for step in story.steps[1:]] == [entry["effect"] for entry in hidden]
    last = diagnose(best)
    assert last["verdict"] == "unexplained_structure"
    assert last["unexplained"][0]["variables"] == ["time"]
    assert last["unexplained"][0]["shape"].startswith(f"a step of {1e6 * np.linalg.norm(KNOCK_M):.0f}"[:-1])
    assert any("the tracker or a nest was knocked" in sentence for sentence in last["advice"])
    drifts = ("time_drift", "thermal_base", "warm_up")
    assert max(c["probability"] for c in last["candidates"] if c["effect"] in drifts) < 0.1


@pytest.mark.full
def test_moved_joint_zero_is_not_reported_as_a_knock(tmp_path: Path) -> None:
    simulate({"arm": "kr30", "seed": 71, "poses": 200, "test_poses": 0, "hidden": []}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(tmp_path / "data.csv", robot)
    data.columns["q3"][120:] += 3e-4
    last = diagnose(fit(data, robot, load_model(tmp_path / "model.yaml", robot)))
    assert last["unexplained"][0]["coordinate"] == "motor3"
    assert any("a joint's zero moved" in sentence for sentence in last["advice"])
    assert not any("knocked" in sentence for sentence in last["advice"])


@pytest.mark.full
@pytest.mark.parametrize("hidden", [[], ["thermal_expansion"]])
def test_periodic_base_motion_is_not_joint_repeatability(hidden: list[Any], tmp_path: Path) -> None:
    simulate({"arm": "kr30", "seed": 101, "poses": 240, "test_poses": 0, "hidden": hidden}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(tmp_path / "data.csv", robot)
    data.columns["z"] += 40e-6 * np.sin(2.0 * np.pi * data.columns["time"] / 900.0)
    best, story = refine(fit(data, robot, load_model(tmp_path / "model.yaml", robot)))
    assert [step["added"]["effect"] for step in story.steps[1:]] == hidden
    last = diagnose(best)
    assert last["unexplained"][0]["coordinate"] == "base.tz"
    assert last["unexplained"][0]["shape"].startswith("about 7 swings")
    assert any("air conditioning" in sentence for sentence in last["advice"])
    assert max(last["noise"]["reading_um"], *last["noise"]["joints_urad"]) < 10.0
