"""Predictions of a fit: the reflector of each row, and notes on poses outside the fitted ranges."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import armtrue_sim
import numpy as np
import pytest

from armtrue import Fit, fitting
from armtrue.comparing import difference
from armtrue.errors import InputError
from armtrue.io import Dataset, load_data, load_model, load_robot

TOOLS = {"C": 0.3, "A": 0.1, "10": 0.5, "B": 0.2, "9": 0.4}
LENGTH = 1.0


def fit_of(names: list[str]) -> Fit:
    """A fit of two revolute joints `LENGTH` apart, whose reflectors lie further out along the same line."""
    joint = {"type": "revolute", "a": 0.0, "alpha": 0.0, "d": 0.0, "offset": 0.0}
    end = {**joint, "a": LENGTH}
    here = {"xyz": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
    return Fit(
        {
            "robot": {"name": "bar", "kinematics": {"convention": "mdh", "joints": [joint, end]}},
            "model": {"effects": []},
            "parameters": [],
            "measuring_from_base": here,
            "flange_from_tool": {name: {**here, "xyz": [TOOLS[name], 0.0, 0.0]} for name in names},
            "data": {"targets": names},
        }
    )


def fit_within(ranges: dict[str, list[float]]) -> Fit:
    fit = fit_of(["A"])
    fit.document["data"]["ranges"] = ranges
    return fit


def poses(names: list[str] | None, count: int) -> Dataset:
    columns = {"q1": np.zeros(count), "q2": np.zeros(count)}
    labels = {}
    if names is not None:
        labels["target"] = list(dict.fromkeys(names))
        columns["target"] = np.array([labels["target"].index(name) for name in names], dtype=np.float64)
    return Dataset(Path("poses.csv"), Path("poses.csv"), columns, np.arange(count) + 2, labels)


@pytest.mark.parametrize("order", [list(TOOLS), sorted(TOOLS), sorted(TOOLS, reverse=True)])
def test_each_row_is_predicted_with_its_own_reflector(order):
    asked = ["B", "10", "C", "A", "9", "B"]
    predicted = fit_of(order).predict(poses(asked, len(asked)))
    assert predicted[:, 0] == pytest.approx([LENGTH + TOOLS[name] for name in asked])


def at(*joints: tuple[float, float]) -> Dataset:
    found = poses(None, len(joints))
    return replace(found, columns=dict(zip(("q1", "q2"), np.array(joints).T, strict=True)))


def test_poses_outside_the_fitted_ranges_are_noted():
    fit = fit_within({"q1": [-1.0, 1.0], "q2": [0.0, 0.2]})
    (note,) = fit.assumed(at((0.0, 0.1), (2.0, 0.1), (-1.0, 0.3), (1.5, -0.1)))[1]
    assert note == (
        "3 of 4 poses of poses.csv lie outside what was fitted (q1 by up to 57°, q2 by up to 6°): figures there are "
        "extrapolated"
    )


def test_poses_within_the_fitted_ranges_are_not_noted():
    inside = at((0.0, 0.1), (1.09, 0.205), (-1.0, 0.0))
    assert fit_within({"q1": [-1.0, 1.0], "q2": [0.0, 0.2]}).assumed(inside)[1] == []
    # A fit from before the ranges were stored.
    assert fit_of(["A"]).assumed(inside)[1] == []


def test_joint_at_rest_in_the_fit_is_noted_where_it_moves():
    (note,) = fit_within({"q1": [-1.0, 1.0], "q2": [0.1, 0.1]}).assumed(at((0.0, 0.1), (0.0, 0.3)))[1]
    assert "1 of 2 poses" in note
    assert "q2 by up to 11°" in note


def fit_with_terms(expressions: dict[str, str], ranges: dict[str, list[float]], exported: bool) -> Fit:
    """A fit with one term for each column in `expressions`."""
    fit = fit_within(ranges)
    fit.document["columns"] = dict.fromkeys(expressions, "")
    fit.document["parameters"] = [
        {"effect": f"effect of {name}", "exported": exported, "terms": [{"expression": expression}]}
        for name, expression in expressions.items()
    ]
    return fit


def test_columns_outside_the_fitted_ranges_are_noted_with_figures():
    ranges = {"q1": [-1.0, 1.0], "time": [0.0, 3000.0], "temp_hall": [20.0, 24.0], "payload": [5.0, 5.0]}
    expressions = {"time": "time/3600", "temp_hall": "dT_hall", "payload": "u_2_2_x"}
    fit = fit_with_terms(expressions, ranges, exported=False)
    columns = {"time": [100.0, 9000.0], "temp_hall": [24.9, 26.0], "payload": [5.0, 0.0]}
    poses_of = replace(at((0.0, 0.1), (0.0, 0.1)), columns={
        **at((0.0, 0.1), (0.0, 0.1)).columns, **{name: np.array(values) for name, values in columns.items()}
    })  # fmt: skip
    (note,) = fit.assumed(poses_of)[1]
    assert note == (
        "1 of 2 poses of poses.csv lie outside what was fitted (time by up to 6000 s, 2.0 times the span that was "
        "fitted, payload by up to 5 kg, temp_hall by up to 2 °C, 0.5 times the span that was fitted): figures there "
        "are extrapolated"
    )
    # For tables, the session's time and temperature do not count; the payload does, as it acts on the arm.
    (of_the_arm,) = fit.extrapolated(poses_of, of_the_arm=True)
    assert "payload" in of_the_arm
    assert "time" not in of_the_arm
    # A column that no term reads does not change a prediction.
    fit.document["columns"] = {}
    assert fit.assumed(poses_of)[1] == []


def test_fit_stores_its_ranges_and_a_malformed_file_is_refused(tmp_path):
    campaign = armtrue_sim.simulate({"arm": "scara", "seed": 3, "hidden": []})
    campaign.write(tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    data = load_data(tmp_path / "data.csv", robot)
    fit = fitting.fit(data, robot, load_model(tmp_path / "model.yaml", robot), folds=2)
    assert fit.document["data"]["ranges"]["q3"] == [data.columns["q3"].min(), data.columns["q3"].max()]
    test = load_data(tmp_path / "test.csv", robot)
    assert fit.assumed(test)[1] == []
    far = replace(test, columns={**test.columns, "q3": test.columns["q3"] + 0.5})
    assert "q3 by up to" in fit.assumed(far)[1][0]
    assert " mm" in fit.assumed(far)[1][0]
    # Besides joints, the range of time: it shows which poses are later.
    assert fit.document["data"]["ranges"]["time"][1] == data.columns["time"].max()
    fit.save(tmp_path / "fit.json")
    assert Fit.load(tmp_path / "fit.json").document["data"]["ranges"] == fit.document["data"]["ranges"]
    for key in ("parameters", "priors"):
        spoilt = {**fit.document, "model": {**fit.document["model"], key: 7}}
        (tmp_path / "spoilt.json").write_text(json.dumps(spoilt))
        with pytest.raises(InputError, match=f"model.{key}"):
            Fit.load(tmp_path / "spoilt.json")
    for wrong in ({"q9": [0.0, 1.0]}, {"q1": ["a", 1.0]}, {"q1": [1.0]}, 7):
        fit.document["data"]["ranges"] = wrong
        fit.save(tmp_path / "fit.json")
        with pytest.raises(InputError, match="data.ranges"):
            Fit.load(tmp_path / "fit.json")


def test_difference_of_fits_is_on_common_rows_with_the_largest_first():
    def stand_in(rows: list[int], errors_um: list[float]) -> SimpleNamespace:
        residuals = np.outer(errors_um, [0.0, 0.0, 1e-6])
        return SimpleNamespace(data=SimpleNamespace(rows=np.array(rows)), residuals=lambda: residuals)

    found = difference(stand_in([2, 3, 4], [1.0, 5.0, 7.0]), stand_in([3, 4, 5], [4.0, -2.0, 1.0]))
    assert found.rows.tolist() == [4, 3]
    assert found.apart_um == pytest.approx([9.0, 1.0])
    assert [one.tolist() for one in found.errors_um] == [pytest.approx([7.0, 5.0]), pytest.approx([2.0, 4.0])]


def test_poses_without_a_target_use_the_first_reflector():
    assert fit_of(["C", "A", "B"]).predict(poses(None, 1))[0, 0] == pytest.approx(LENGTH + TOOLS["C"])
