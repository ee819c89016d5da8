"""Pictures of effects: displacements compared with the chain at moved joints, sweeps, labels."""

from __future__ import annotations

import re

import numpy as np
import pytest

from armtrue.report.pictures.effect_picture import (
    WIDTH,
    corners,
    effect_picture,
    effect_sweep,
    joint_labels,
    projected,
)
from armtrue.tables.chain import chain_from_robot

GEAR = {
    "effect": "gear_harmonics",
    "joints": [3],
    "options": {},
    "parameters": [{"name": "gear_harmonics[3].sin1", "value": 1e-4, "sigma": 1e-6, "unit": "rad"}],
}


@pytest.fixture(scope="module")
def fit(fits):
    return fits[0]


def test_motor_displacement_moves_the_arm_as_the_chain_does(fit):
    chain = chain_from_robot(fit.document["robot"])
    joints = fit.data.joints[0]
    for motor in range(chain.joint_count):
        moved = joints.copy()
        moved[motor] += 0.01
        drawn = corners(chain, joints, {f"motor{motor + 1}": 0.01})
        assert np.allclose(drawn, corners(chain, moved, {}), atol=1e-12)


@pytest.mark.parametrize("coordinate", ["base.tx", "base.rz", "link2.ty", "link3.rx", "tool.tz"])
def test_coordinate_moves_only_the_frames_after_it(fit, coordinate):
    chain = chain_from_robot(fit.document["robot"])
    joints = fit.data.joints[0]
    change = corners(chain, joints, {coordinate: 1e-3}) - corners(chain, joints, {})
    first = {"base": 0, "link2": 3, "link3": 4, "tool": 7}[coordinate.split(".")[0]]
    assert np.all(change[:first] == 0.0)
    if ".t" in coordinate:
        assert np.allclose(np.linalg.norm(change[first:], axis=1), 1e-3)


def test_sweep_varies_the_variable_that_drives_the_effect_most(fit):
    sweep = effect_sweep(fit, GEAR)
    assert sweep.variable.name == "q3"
    assert np.allclose(sweep.moves["motor3"], 1e-4 * np.sin(np.radians(sweep.values)), atol=1e-9)
    _, words = effect_picture(fit, GEAR, sweep)
    assert "joint 3 changes" in words


def test_sweep_of_a_short_wave_covers_two_periods(fit):
    mesh = {
        "effect": "gear_mesh",
        "joints": [2],
        "options": {"cycles": [90.0]},
        "parameters": [{"name": "gear_mesh[2].sin90c", "value": 1e-5, "sigma": 1e-6, "unit": "rad"}],
    }
    sweep = effect_sweep(fit, mesh)
    assert np.ptp(sweep.values) == pytest.approx(2 * 360 / 90, rel=1e-6)


@pytest.mark.parametrize("value", [1e-3, -1e-3])
def test_constant_effect_is_swept_from_zero_to_its_value(fit, value):
    offset = {
        "effect": "joint_offset",
        "joints": [2],
        "options": {},
        "parameters": [{"name": "joint_offset[2]", "value": value, "sigma": 1e-6, "unit": "rad"}],
    }
    sweep = effect_sweep(fit, offset)
    assert sweep.variable is None
    assert np.allclose(sweep.moves["motor2"], np.linspace(0.0, value, len(sweep.values)))
    # Without animation the picture stands where the effect is largest, half way there and back.
    picture, _ = effect_picture(fit, offset, sweep)
    lasts, still = re.search(r'dur="([\d.]+)s', picture), re.search(r'data-still="([\d.]+)"', picture)
    assert float(still[1]) == pytest.approx(float(lasts[1]) / 2.0)


def test_joint_labels_do_not_overlap_and_stay_in_the_picture(fit):
    chain = chain_from_robot(fit.document["robot"])
    high, letter = 14.0, 7.0
    for joints in fit.data.joints[:40]:
        places = projected([corners(chain, joints, {})])[0]
        marked = list(range(1, chain.joint_count + 1))
        labels = joint_labels(places, marked)
        boxes = [(x, x + letter * len(text), y - high, y) for text, x, y in labels]
        assert all(left >= 0.0 and right <= WIDTH for left, right, _, _ in boxes)
        for k, (left, right, top, bottom) in enumerate(boxes):
            for other in boxes[:k]:
                assert left >= other[1] or right <= other[0] or top >= other[3] or bottom <= other[2], boxes


def test_joints_at_one_place_share_a_label():
    places = np.array([[0.0, 0.0], [20.0, 200.0], [60.0, 100.0], [200.0, 50.0], [203.0, 55.0], [201.0, 48.0]])
    labels = joint_labels(places, [1, 2, 3, 4, 5])
    assert sorted(text for text, *_ in labels) == ["joint 1", "joint 2", "joints 3–5"]
