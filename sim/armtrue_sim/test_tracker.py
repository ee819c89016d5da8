"""Systematic errors of the instrument."""

import numpy as np
import pytest

from .campaign import simulate
from .mechanics.transforms import Pose, exp_so3
from .tracker import TrackerError

POINTS = np.array([[3.0, 0.0, 0.0], [0.0, 2.0, 1.0], [-1.0, 1.0, -0.5], [2.0, -2.0, 0.3]])
LEVEL = np.tile(np.eye(3), (4, 1, 1))


def seen(error, origin=(0.0, 0.0, 0.0), **columns):
    return error.as_seen(POINTS, LEVEL, columns, np.array(origin))


def test_scale_stretches_distances_from_the_tracker():
    origin = np.array([0.5, -0.2, 0.1])
    stretched = seen(TrackerError(scale=1e-4), origin)
    assert np.allclose(stretched - origin, (POINTS - origin) * 1.0001, atol=1e-12)


def test_circle_error_turns_the_sight_and_keeps_distance():
    turned = seen(TrackerError(circles={(1, "azimuth_sin"): 1e-4}))
    azimuth = np.arctan2(POINTS[:, 1], POINTS[:, 0])
    for point, result, angle in zip(POINTS, turned, azimuth, strict=True):
        assert np.allclose(result, exp_so3(np.array([[0, 0, 1e-4 * np.sin(angle)]]))[0] @ point, atol=1e-12)
    raised = seen(TrackerError(circles={(2, "elevation_cos"): 1e-4}))
    assert np.allclose(np.linalg.norm(raised, axis=1), np.linalg.norm(POINTS, axis=1), atol=1e-12)
    assert raised[0, 2] == pytest.approx(3.0 * np.sin(1e-4))


def test_station_error_moves_only_rows_of_its_set_up():
    pose = Pose.from_vector([1e-3, 0.0, 0.0, 0.0, 0.0, 2e-3])
    result = seen(TrackerError(stations={2: pose}), station=np.array([1, 1, 2, 2]))
    assert np.allclose(result[:2], POINTS[:2], atol=1e-14)
    assert np.allclose(result[2:] @ pose.rotation.T + pose.translation, POINTS[2:], atol=1e-12)


def test_nest_error_shifts_the_reflector_in_the_tools_frame():
    result = seen(TrackerError(nests={2: np.array([0.0, 3e-5, 0.0])}), nest=np.array([1, 2, 1, 2]))
    assert np.allclose((result - POINTS)[:, 1], [0.0, 3e-5, 0.0, 3e-5], atol=1e-15)


def test_test_poses_have_no_error_of_the_instrument():
    plain = simulate({"arm": "kr30", "poses": 40, "seed": 4})
    for effect in ("tracker_scale", "tracker_angles", "station", "nest"):
        more = {"setups": {"stations": 2, "nests": 2}, "hidden": [effect]}
        campaign = simulate({"arm": "kr30", "poses": 40, "seed": 4, **more})
        assert np.array_equal(campaign.test["x"], plain.test["x"])
        assert np.linalg.norm(campaign.positions - plain.positions, axis=1).max() > 1e-5
        assert set(campaign.data["station"]) == {1, 2}


def test_orientations_are_in_the_set_ups_frame():
    turn = {"orientation": 0.0, "sigma": 0.0}
    plan = {
        "arm": "kr30",
        "poses": 40,
        "setups": {"stations": 2},
        "columns": {"add": ["orientation"]},
        "instrument": turn,
    }
    plain, moved = simulate(plan), simulate(plan | {"hidden": [{"effect": "station", "scale": 100.0}]})
    differs = np.abs(plain.data["qx"] - moved.data["qx"]) > 1e-5
    assert not differs[plain.data["station"] == 1].any()
    assert differs[plain.data["station"] == 2].mean() > 0.9
