"""Set-ups of the tracker that stand metres apart, and points that lie in a plane."""

from __future__ import annotations

from pathlib import Path

import armtrue
import numpy as np
import pytest
from armtrue.checking import check
from armtrue.io.model import Model
from armtrue.uncertainty import position_covariance
from armtrue_sim import simulate
from fitting_given import GEOMETRY


def test_station_aligns_set_ups_metres_apart(campaign) -> None:
    given = campaign(poses=120)
    alone = given.fit(GEOMETRY)
    station = np.where(np.arange(given.data.count) % 3 == 2, 2.0, 1.0)
    turn = np.deg2rad(57.0)
    second_from_first = np.array(
        [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
    )
    moved = given.data.positions_m @ second_from_first.T + [2.0, -0.9, 0.1]
    seen = np.where(station[:, None] == 2.0, moved, given.data.positions_m)
    two = given.with_columns(station=station, **dict(zip("xyz", seen.T, strict=True)))
    fit = two.fit([*GEOMETRY, "station"])
    assert fit.document["error"]["held_out"]["mean_um"] < 1.2 * alone.document["error"]["held_out"]["mean_um"]
    # A prediction is in the frame of the row's own set-up.
    assert np.linalg.norm(fit.predict(two.data) - seen, axis=1).mean() < 30e-6
    assert position_covariance(fit, two.data).shape == (two.data.count, 3, 3)
    assert any(
        "station 2 stands" in warning and "57 degrees" in warning for warning in fit.document["warnings"]
    )
    assert not [f for f in check(two.data, two.robot).findings if f.severity == "error"]


def test_coplanar_points_are_aligned(tmp_path: Path) -> None:
    # Only joints 2 and 3 moved; the direction across the plane was mistaken for a unit of length.
    still = [[v, v + 1e-7] for v in (0.2, 0.0, 0.0, 0.3, 0.5, -0.4)]
    simulate(
        {
            "arm": "kr30",
            "seed": 3,
            "poses": 60,
            "joint_range": [still[0], [-0.9, 0.4], [-1.2, 0.8], *still[3:]],
        },
        tmp_path,
    )
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data = armtrue.load_data(tmp_path / "data.csv", robot)
    assert not [f for f in check(data, robot).findings if f.severity == "error"]
    fit = armtrue.fit(data, robot, Model([{"effect": e} for e in [*GEOMETRY, "joint_compliance"]]))
    assert fit.document["error"]["train"]["mean_um"] < 20.0


@pytest.mark.full
def test_noise_of_many_points_gives_no_tracker_scale(tmp_path: Path) -> None:
    # The noise of a measured point is in its residual too. A column computed from measured points correlates with
    # it: the more rows, the more certainly a scale was found on an instrument that has none.
    believed = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]
    simulate({"arm": "kr30", "seed": 1, "poses": 2000, "believed": believed}).write(tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data = armtrue.load_data(tmp_path / "data.csv", robot)
    candidates = armtrue.diagnose(
        armtrue.fit(data, robot, armtrue.load_model(tmp_path / "model.yaml", robot))
    )["candidates"]
    scale = next(c for c in candidates if c["effect"] == "tracker_scale")
    assert abs(scale["parameters"][0]["value"]) < 1e-6
