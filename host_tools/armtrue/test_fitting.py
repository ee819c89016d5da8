"""A fit predicts: which reflector a row is of, whatever the reflectors are called and in which order they came."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armtrue import Fit
from armtrue.io import Dataset

TOOLS = {"C": 0.3, "A": 0.1, "10": 0.5, "B": 0.2, "9": 0.4}
LENGTH = 1.0


def fit_of(names: list[str]) -> Fit:
    """A fit of one turning joint with an arm of `LENGTH`, whose reflectors stand further out along it."""
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


def test_poses_without_a_target_are_of_the_first_reflector_as_in_the_tables():
    assert fit_of(["C", "A", "B"]).predict(poses(None, 1))[0, 0] == pytest.approx(LENGTH + TOOLS["C"])
