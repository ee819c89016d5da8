"""Stated uncertainty of predictions and readings, compared with the same simulated arm's exact values."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import armtrue
import numpy as np
import pytest
from armtrue.io import Dataset
from armtrue.uncertainty import position_covariance
from armtrue_sim import simulate
from numpy.typing import NDArray

CHI2_3_95 = 7.815


def squares(fit: armtrue.Fit, exact: Dataset) -> NDArray[np.float64]:
    """Squared Mahalanobis distance of each prediction from the exact pose, by its stated covariance."""
    off = fit.predict(exact) - exact.positions_m
    return np.einsum(
        "ni,ni->n", off, np.linalg.solve(position_covariance(fit, exact), off[:, :, None])[:, :, 0]
    )


@pytest.mark.parametrize("joint", [1, 4])
def test_covariance_covers_poses_that_move_a_joint_held_still(joint: int, tmp_path: Path) -> None:
    # The fit holds parameters at nominal that these poses do not determine. They were once left out of the covariance:
    # predictions that were wrong by millimetres had stated uncertainties of micrometres.
    scenario = {"arm": "kr30", "seed": 5, "poses": 100, "columns": {"add": []}}
    simulate(scenario, tmp_path / "free")
    robot = armtrue.load_robot(tmp_path / "free" / "robot.yaml")
    whole = armtrue.load_data(tmp_path / "free" / "test.csv", robot)
    everywhere = [[float(q.min()), float(q.max())] for q in whole.joints.T]
    everywhere[joint - 1] = [0.3, 0.3 + 1e-6]
    simulate({**scenario, "joint_range": everywhere}, tmp_path / "still")
    fit = armtrue.fit(
        armtrue.load_data(tmp_path / "still" / "data.csv", robot),
        robot,
        armtrue.load_model(tmp_path / "still" / "model.yaml", robot),
    )
    assert np.mean(squares(fit, whole) < CHI2_3_95) > 0.9
    seen = armtrue.load_data(tmp_path / "still" / "test.csv", robot)
    assert np.mean(squares(fit, seen) < CHI2_3_95) > 0.8, "as sure as before where it stood"


def test_covariance_beyond_a_joint_table_includes_the_error_that_it_stands_for(tmp_path: Path) -> None:
    # The table's hats are zero there, which counted as known: the stated uncertainty fell where the table ended.
    table = {"effect": "transmission_pwl", "joints": [1], "shape": "table"}
    scenario = {"arm": "kr30", "seed": 5, "poses": 150, "columns": {"add": []}, "hidden": [table]}
    simulate(scenario, tmp_path / "free")
    robot = armtrue.load_robot(tmp_path / "free" / "robot.yaml")
    whole = armtrue.load_data(tmp_path / "free" / "test.csv", robot)
    ranges = [[float(q.min()), float(q.max())] for q in whole.joints.T]
    ranges[0] = [-1.0, 1.0]
    simulate({**scenario, "joint_range": ranges}, tmp_path / "half")
    model = armtrue.load_model(tmp_path / "half" / "model.yaml", robot)
    model = armtrue.Model([*model.effects, {"effect": "transmission_pwl", "joints": [1]}])
    fit = armtrue.fit(armtrue.load_data(tmp_path / "half" / "data.csv", robot), robot, model)
    beyond = whole.take(np.abs(whole.joints[:, 0]) > 1.3)
    assert beyond.count > 30
    assert np.mean(squares(fit, beyond) < CHI2_3_95) > 0.85
    sigma = np.sqrt(np.trace(position_covariance(fit, whole), axis1=1, axis2=2))
    inside = np.abs(whole.joints[:, 0]) < 0.9
    assert np.median(sigma[~inside]) > 3.0 * np.median(sigma[inside])


def test_noisy_orientations_do_not_shrink_position_covariance(tmp_path: Path) -> None:
    # Orientations had a small weight but counted in full among the residuals that estimate the noise.
    found = []
    for seed in range(1, 5):
        folder = tmp_path / str(seed)
        simulate({"arm": "kr30", "seed": seed, "poses": 60, "columns": {"add": ["orientation"]}}, folder)
        robot = armtrue.load_robot(folder / "robot.yaml")
        data = armtrue.load_data(folder / "data.csv", robot)
        half = np.random.default_rng(seed).normal(0.0, 1e-3, (data.count, 3))
        names = ("qw", "qx", "qy", "qz")
        w, v = data.columns["qw"], np.stack([data.columns[name] for name in names[1:]], axis=1)
        read = [w - np.sum(half * v, axis=1), *(v + w[:, None] * half + np.cross(half, v)).T]
        read = read / np.linalg.norm(read, axis=0)
        data = dataclasses.replace(data, columns={**data.columns, **dict(zip(names, read, strict=True))})
        fit = armtrue.fit(data, robot, armtrue.load_model(folder / "model.yaml", robot))
        found.append(squares(fit, armtrue.load_data(folder / "test.csv", robot)).mean() / 3.0)
    assert np.mean(found) < 1.5


@pytest.mark.parametrize("orientation", [2e-5, 2e-3])
def test_noise_of_positions_and_orientations_is_told_apart(orientation: float, tmp_path: Path) -> None:
    # Beside noisy orientations the position noise came out as 4 um: residuals of small weight were counted in full.
    read = []
    for seed in range(1, 4):
        folder = tmp_path / str(seed)
        instrument = {"sigma": 1.5e-5, "orientation": orientation}
        columns = {"add": ["orientation"]}
        simulate(
            {"arm": "kr30", "seed": seed, "poses": 80, "instrument": instrument, "columns": columns}, folder
        )
        robot = armtrue.load_robot(folder / "robot.yaml")
        data = armtrue.load_data(folder / "data.csv", robot)
        said = armtrue.diagnose(armtrue.fit(data, robot, armtrue.load_model(folder / "model.yaml", robot)))
        noise = said["noise"]
        assert any(f"orientations by {noise['orientation_urad']:.3g} urad" in line for line in said["advice"])
        read.append((noise["reading_um"], noise["orientation_urad"]))
    positions, orientations = np.mean(read, axis=0)
    assert positions == pytest.approx(15.0, rel=0.15)
    assert orientations == pytest.approx(orientation * 1e6, rel=0.1)


def test_few_poses_report_no_joint_with_poor_repeatability(tmp_path: Path) -> None:
    # The scatter of one joint explained all residuals of fifteen poses, and the reading noise came out as zero.
    scenario = {
        "arm": "kr30",
        "seed": 6,
        "poses": 15,
        "repeats": {"poses": 0, "times": 0},
        "believed": ["base_frame", "tool_offset", "joint_offset", "link_geometry"],
        "hidden": [{"effect": "gear_harmonics", "joints": [3]}],
    }
    simulate(scenario, tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data = armtrue.load_data(tmp_path / "data.csv", robot)
    fit = armtrue.fit(data, robot, armtrue.load_model(tmp_path / "model.yaml", robot))
    assert max(armtrue.diagnose(fit)["noise"]["joints_urad"]) < 10.0


def test_fixed_parameter_keeps_the_prediction_covariance(tmp_path: Path) -> None:
    # A fixed parameter shifted the covariance entries of all others: metres, negative variances, nan.
    scenario = {"arm": "kr30", "seed": 4, "poses": 150}
    simulate(scenario, tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data = armtrue.load_data(tmp_path / "data.csv", robot)
    exact = armtrue.load_data(tmp_path / "test.csv", robot)
    model = armtrue.load_model(tmp_path / "model.yaml", robot)
    free = armtrue.fit(data, robot, model)
    value = next(p["value"] for p in free.document["parameters"] if p["name"] == "joint_offset[2]")
    fixed = dataclasses.replace(model, parameters={"joint_offset[2]": {"fixed": value}})
    held = armtrue.fit(data, robot, fixed)
    size = [
        np.median(np.trace(position_covariance(given, exact), axis1=1, axis2=2)) for given in (free, held)
    ]
    assert 0.5 < size[1] / size[0] < 1.2
    assert np.linalg.eigvalsh(position_covariance(held, exact)).min() >= 0.0
