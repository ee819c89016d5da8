"""Sudden changes and reversing drifts while measuring are named as such, and no effect is added for them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from armtrue import Fit, diagnose, fit, load_data, load_model, load_robot, refine
from armtrue.verdicts import verdict_words
from armtrue_sim import Campaign, simulate

Columns = dict[str, Any]
SHIFT_M = np.array([8e-5, -5e-5, 4e-5])
LOAD_KG = 8.0


def fitted(
    plan: dict[str, Any], tmp_path: Path, change: Callable[[Columns, Campaign], None], without: str = ""
) -> Fit:
    """A fit to a simulated campaign whose columns `change` has altered, without the column `without`."""
    campaign = simulate(plan | {"test_poses": 5}, tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(tmp_path / "data.csv", robot)
    change(data.columns, campaign)
    data.columns.pop(without, None)
    return fit(data, robot, load_model(tmp_path / "model.yaml", robot))


def moved_reflectors(names: list[str]) -> Callable[[Columns, Campaign], None]:
    """Shift the reflectors of these names by SHIFT_M in the second half; without names, the only one."""

    def change(columns: Columns, campaign: Campaign) -> None:
        alone = {name: values for name, values in campaign.data.items() if name != "target"}
        rotation, _ = campaign.arm.true_pose(campaign.q, alone)  # reflectors are not turned in the flange
        late = columns["time"] > np.median(columns["time"])
        if names:
            late &= np.isin(campaign.data["target"], names)
        for axis, by in zip("xyz", (rotation @ SHIFT_M).T, strict=True):
            columns[axis] = columns[axis] + np.where(late, by, 0.0)

    return change


@pytest.mark.full
def test_moved_reflector_is_not_named_as_an_arm_effect(tmp_path: Path) -> None:
    before = fitted({"arm": "kr30", "seed": 82, "poses": 160, "hidden": []}, tmp_path, moved_reflectors([]))
    best, story = refine(before)
    assert [step["added"]["effect"] for step in story.steps[1:]] == []
    last = diagnose(best)
    assert last["unexplained"][0]["coordinate"].startswith("tool.t")
    assert last["unexplained"][0]["shape"].startswith("a step of 10")
    assert any("loose" in sentence and "column nest" in sentence for sentence in last["advice"])
    assert not any("zero moved" in s or "can be compensated" in s for s in last["advice"])


@pytest.mark.quick("names0-tool.t-nest")
@pytest.mark.parametrize(
    ("names", "coordinate", "column"), [(["A", "B", "C"], "tool.t", "nest"), (["B"], "tool[1].t", "target")]
)
def test_moved_reflectors_among_several_are_named(
    names: list[str], coordinate: str, column: str, tmp_path: Path
) -> None:
    plan = {"arm": "kr30", "seed": 83, "poses": 70, "hidden": [], "targets": {"names": ["A", "B", "C"]}}
    last = diagnose(fitted(plan, tmp_path, moved_reflectors(names)))
    assert last["unexplained"][0]["coordinate"].startswith(coordinate)
    assert any("reflector" in sentence and f"column {column}" in sentence for sentence in last["advice"])


@pytest.mark.full
def test_reversing_drift_is_not_reported_as_a_knock(tmp_path: Path) -> None:
    def drift(columns: Columns, campaign: Campaign) -> None:
        time = columns["time"]
        for axis, by in zip("xyz", (1e-4, -6e-5, 8e-5), strict=True):
            columns[axis] = columns[axis] + 2.0 * by * np.abs(time / time.max() - 0.4)

    plan = {"arm": "kr30", "seed": 60, "poses": 200, "hidden": []}
    best, story = refine(fitted(plan, tmp_path, drift, "temp_arm"))
    assert {step["added"]["effect"] for step in story.steps[1:]} <= {"time_drift", "warm_up"}
    last = diagnose(best)
    assert last["unexplained"][0]["variables"] == ["time"]
    assert not any(entry["shape"].startswith("a step") for entry in last["unexplained"])
    assert not any("knocked" in sentence for sentence in last["advice"])
    assert any("instrument creep" in sentence for sentence in last["advice"])


def loaded_half_way(columns: Columns, campaign: Campaign) -> None:
    """The tool carries LOAD_KG in the second half, which the column payload does not record."""
    table = {name: values for name, values in campaign.data.items() if name not in ("x", "y", "z")}
    loads = [table | {"payload": np.full(len(columns["x"]), mass)} for mass in (0.0, LOAD_KG)]
    empty, loaded = (campaign.arm.true_pose(campaign.q, load)[1] for load in loads)
    late = columns["time"] > np.median(columns["time"])
    for axis, by in zip("xyz", (loaded - empty).T, strict=True):
        columns[axis] = columns[axis] + np.where(late, by, 0.0)


@pytest.mark.quick("no column payload")
@pytest.mark.parametrize("without", ["payload", ""], ids=["no column payload", "payload said to be none"])
def test_unrecorded_load_is_not_reported_as_a_knock(without: str, tmp_path: Path) -> None:
    plan = {"arm": "kr30", "seed": 110, "poses": 160, "hidden": [], "payloads": [0.0]}
    last = diagnose(fitted(plan, tmp_path, loaded_half_way, without))
    assert last["unexplained"][0]["shape"].startswith("a step under load")
    assert last["unexplained"][0]["coordinate"] in ("motor2", "motor3")
    assert any("column payload" in sentence for sentence in last["advice"])
    assert not any("knocked" in sentence for sentence in last["advice"])


@pytest.mark.parametrize("payloads", [[0.0], [0.0, LOAD_KG]])
def test_knock_may_be_a_load_only_if_none_is_recorded(payloads: list[float], tmp_path: Path) -> None:
    def knock(columns: Columns, campaign: Campaign) -> None:
        columns["z"] = columns["z"] + np.where(columns["time"] > np.median(columns["time"]), 3e-4, 0.0)

    plan = {"arm": "kr30", "seed": 71, "poses": 120, "hidden": [], "payloads": payloads}
    advice = diagnose(fitted(plan, tmp_path, knock))["advice"]
    assert any("the tracker or a nest was knocked" in sentence for sentence in advice)
    assert any("the tool's load changed" in sentence for sentence in advice) == (payloads == [0.0])


@pytest.mark.full
def test_stated_size_of_a_product_of_angles_is_its_full_range(tmp_path: Path) -> None:
    product = {
        **{"effect": "custom", "name": "odd", "coordinate": "motor1", "joints": [1, 2]},
        **{"expression": "sin(q1)*q2", "value": 1e-4},
    }
    found = diagnose(
        fitted({"arm": "kr30", "seed": 131, "poses": 200, "hidden": [product]}, tmp_path, lambda *_: None)
    )["unexplained"][0]
    assert found["variables"] == ["q1", "q2"]
    words = found["shape"].split()
    q1, q2 = (
        load_data(tmp_path / "data.csv", load_robot(tmp_path / "robot.yaml")).columns[f"q{k}"] for k in (1, 2)
    )
    truly_arcsec = 2.0 * 1e-4 * np.abs(np.sin(q1)).max() * np.abs(q2).max() * 206264.8
    assert float(words[words.index("about") + 1]) == pytest.approx(truly_arcsec, rel=0.35)
    assert np.ptp(found["curve"]["y"]) == pytest.approx(truly_arcsec / 206264.8, rel=0.35)


@pytest.mark.full
def test_headline_and_advice_agree_on_rounded_angles(tmp_path: Path) -> None:
    def rounded(columns: Columns, campaign: Campaign) -> None:
        for joint in range(1, 7):
            columns[f"q{joint}"] = np.deg2rad(np.round(np.rad2deg(columns[f"q{joint}"]), 2))

    plan = {"arm": "kr30", "seed": 9, "poses": 160, "hidden": []}
    last = diagnose(fitted(plan, tmp_path, rounded))
    assert "more than noise" in verdict_words(last)
    assert "joint angles to steps of 0.01 deg cause" in last["advice"][0]
    assert not any("what is left is noise" in sentence for sentence in last["advice"])


def test_headline_and_advice_agree_without_repeats(tmp_path: Path) -> None:
    plan = {"arm": "kr30", "seed": 84, "poses": 70, "hidden": [], "targets": {"names": ["A", "B", "C"]}}
    last = diagnose(fitted(plan | {"repeats": {"poses": 0, "times": 0}}, tmp_path, lambda *_: None))
    assert last["noise_floor_source"] == "none"
    assert last["instrument_floor_um"] is not None
    assert "not known" in verdict_words(last)
    assert "not known" in last["advice"][0]
