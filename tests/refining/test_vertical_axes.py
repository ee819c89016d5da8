"""If all axes are vertical, the data show only the sum of two heights, the base's and the tool's.

Where a link bends, the tool moves in proportion to its height above the bend: with a wrong split of that sum bending
cannot be recognised.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from armtrue import Fit, fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate


def scara(folder: Path, seed: int, stated: bool = False) -> Fit:
    """Geometry fitted to a scara whose first link bends; `stated`: robot.yaml says where tool and base are."""
    simulate(
        {
            "arm": "scara",
            "seed": seed,
            "poses": 120,
            "test_poses": 0,
            "payloads": [0.0, 2.0, 5.0],
            "believed": ["base_frame", "tool_offset", "joint_offset", "link_geometry"],
            "hidden": [{"effect": "bending_compliance", "joints": [1]}],
            "robot_file": {"omit": [] if stated else ["tool", "base"]},
        },
        folder,
    )
    robot = load_robot(folder / "robot.yaml")
    return fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))


def tool_height(fitted: Fit) -> float:
    (tool,) = fitted.document["flange_from_tool"].values()
    return float(tool["xyz"][2])


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
def test_bending_is_the_only_effect_added(seed: int, tmp_path: Path) -> None:
    # Half of the sum was given to the tool: bending was called unexplained, or base_compliance stayed in the model.
    fitted = scara(tmp_path, seed)
    assert abs(tool_height(fitted)) < 1e-5
    best, story = refine(fitted)
    found = [
        (e["effect"], e.get("joints"))
        for e in story["steps"][-1]["effects"]
        if e.get("probability") is not None
    ]
    assert found == [("bending_compliance", [1])], story["steps"][-1]["effects"]
    assert story["steps"][-1]["verdict"] == "nothing_missing"


def test_stated_tool_height_is_kept(tmp_path: Path) -> None:
    fitted = scara(tmp_path, 1, stated=True)
    stated = load_robot(tmp_path / "robot.yaml").spec["tool"]["xyz"][2]
    assert tool_height(fitted) == pytest.approx(stated, abs=1e-5)


def test_effect_equal_to_a_fitted_one_is_not_missing(tmp_path: Path) -> None:
    # A base that grows and a vertical slide whose zero drifts move the tool alike. With the base's growth in the model,
    # the slide's drift was still recommended and added, although no error was left for it to explain.
    simulate(
        {
            "arm": "scara",
            "seed": 2,
            "poses": 200,
            "test_poses": 0,
            "payloads": [0.0, 2.0, 5.0],
            "believed": ["base_frame", "tool_offset", "joint_offset", "link_geometry"],
            "hidden": [{"effect": "thermal_base"}],
        },
        tmp_path,
    )
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(tmp_path / "data.csv", robot)
    _, story = refine(fit(data, robot, load_model(tmp_path / "model.yaml", robot)))
    last = story["steps"][-1]
    assert [step["added"]["effect"] for step in story["steps"][1:]] == ["thermal_base"]
    assert last["probability_nothing"] > 0.85
    (slide,) = [c for c in last["candidates"] if c["effect"] == "thermal_joint_drift" and c["joints"] == [3]]
    assert slide["why"] == "the data cannot tell it from what is fitted already"
    assert not slide["recommend"]
