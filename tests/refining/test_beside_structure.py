"""A drift is named although an error that depends on the arm's posture remains that no effect explains."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from armtrue import diagnose, fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate

PRODUCT = {
    "effect": "custom", "name": "joint_product", "coordinate": "motor2", "expression": "sin(q1)*cos(q3)",
    "joints": [1, 3], "value": 3e-4,
}  # fmt: skip


def found_of(folder: Path, seed: int, drift: float, known: list[Any]) -> dict[str, Any]:
    """Diagnosis of an arm with PRODUCT and a drift, for the believed model and the effects `known`."""
    hidden = [PRODUCT, {"effect": "time_drift", "scale": drift}]
    simulate({"arm": "kr30", "seed": seed, "poses": 240, "test_poses": 0, "hidden": hidden}, folder)
    robot = load_robot(folder / "robot.yaml")
    model = yaml.safe_load((folder / "model.yaml").read_text())
    (folder / "model.yaml").write_text(yaml.safe_dump({"effects": model["effects"] + known}))
    return diagnose(
        fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))
    )


def named(found: dict[str, Any]) -> set[str]:
    return {c["effect"] for c in found["candidates"] if c["probability"] > 0.5}


@pytest.mark.full
@pytest.mark.parametrize("seed", [3, 4])
def test_large_drift_is_named_beside_a_function_of_two_angles(tmp_path: Path, seed: int) -> None:
    found = found_of(tmp_path, seed, 20.0, [])
    assert named(found) == {"time_drift"}
    assert found["verdict"] == "missing_effect"


@pytest.mark.full
@pytest.mark.parametrize("seed", [3, 4])
def test_small_drift_is_named_once_the_function_is_modelled(tmp_path: Path, seed: int) -> None:
    # Such a drift shows only after the function has been removed, as the remainder of a wrong function would.
    found = found_of(tmp_path / "before", seed, 4.0, [])
    assert not named(found)
    assert found["verdict"] == "unexplained_structure"
    described = {key: value for key, value in PRODUCT.items() if key not in ("value", "joints")}
    assert named(found_of(tmp_path / "after", seed, 4.0, [described])) == {"time_drift"}


@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.full)])
def test_refine_adds_the_nearest_effect_to_unnamed_structure(tmp_path: Path, seed: int) -> None:
    # Beside the first fit a smooth function of q1 was likelier than the wobble of axis 1, and nothing was added.
    hidden = [{"effect": "axis_wobble", "joints": [1], "scale": 0.3}]
    simulate(
        {
            "arm": "cobot",
            "seed": seed,
            "poses": 100,
            "test_poses": 0,
            "payloads": [0.0, 2.0, 5.0],
            "believed": ["base_frame", "tool_offset", "joint_offset", "link_geometry"],
            "hidden": hidden,
            "robot_file": {"omit": ["tool", "base"]},
        },
        tmp_path,
    )
    robot = load_robot(tmp_path / "robot.yaml")
    first = fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot))
    _best, story = refine(first)
    assert story["steps"][0]["verdict"] == "unexplained_structure"
    last = story["steps"][-1]
    assert last["verdict"] == "nothing_missing"
    found = [entry for entry in last["effects"] if entry.get("probability") is not None]
    assert [(entry["effect"], entry["joints"]) for entry in found] == [("axis_wobble", [1])]
