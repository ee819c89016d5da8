"""Drawn noise has the stated statistics."""

import numpy as np
import pytest

from .build import build_arm
from .errors import ScenarioError
from .instrument import Instrument, drive_sigma_for_tool_repeatability
from .poses import random_poses
from .scenario import Scenario

MANY = 40_000


def test_radial_and_angular_parts_grow_with_distance():
    instrument = Instrument((5e-6, 1e-6), (10e-6, 4e-6), position=(1.0, 0.0, 0.0))
    points = np.tile([1.0, 0.0, 5.0], (MANY, 1))
    noise = instrument.noise(points, np.random.default_rng(1))
    # The line of sight is z, five metres long.
    assert noise.std(axis=0) == pytest.approx([30e-6, 30e-6, 10e-6], rel=0.02)
    assert np.abs(noise.mean(axis=0)).max() < 5e-7
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 0.02
    assert instrument.sigma_per_axis(points[:1])[0] == pytest.approx(np.sqrt((10**2 + 2 * 30**2) / 3) * 1e-6)


def test_single_sigma_is_isotropic():
    noise = Instrument.from_dict({"sigma": 8e-6}, "test").noise(
        np.random.default_rng(0).normal(size=(MANY, 3)), np.random.default_rng(1)
    )
    assert noise.std(axis=0) == pytest.approx([8e-6] * 3, rel=0.02)


def test_point_at_the_instrument_has_noise():
    noise = Instrument().noise(np.zeros((MANY, 3)), np.random.default_rng(1))
    assert noise.std(axis=0) == pytest.approx([8e-6] * 3, rel=0.02)


def test_repeatability_is_the_mean_distance_from_the_clusters_centre():
    arm = build_arm(Scenario(arm="kr30", seed=4))
    q = random_poses(arm.robot, arm.chain, 120, np.random.default_rng(0))
    sigma = drive_sigma_for_tool_repeatability(arm, q, 6.26e-6)
    rng = np.random.default_rng(77)
    stops = np.repeat(q, 100, axis=0)
    tool = arm.true_position(stops, motor_error=sigma * rng.standard_normal(stops.shape)).reshape(
        len(q), 100, 3
    )
    spread = np.linalg.norm(tool - tool.mean(axis=1, keepdims=True), axis=2).mean()
    assert spread == pytest.approx(6.26e-6, rel=0.05)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sigma": "8 um"}, "sigma: s or radial"),
        ({"radial": [1e-6], "angular": [1e-6, 0]}, "sigma: s or radial"),
        ({"sigma": -1e-6}, "negative"),
        ({"range": 3}, "unknown key 'range'"),
    ],
)
def test_invalid_instrument_is_named_in_the_error(given, message):
    with pytest.raises(ScenarioError, match=message):
        Instrument.from_dict(given, "test")
