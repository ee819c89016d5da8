"""Foreign truths, physics in no form of the catalogue: each is compared with formulas of its own field."""

import numpy as np
import pytest

from ..build import build_arm, context_of
from ..campaign import simulate
from ..effects.base import ARCSEC, EFFECTS
from ..mechanics.statics import distal_load
from ..scenario import Scenario
from . import TRUTHS, beam, dahl, teeth
from .beam import Beam
from .levelling import Bars

STIFFNESS = 2e5


def test_dahl_friction_saturates_in_the_direction_of_motion():
    friction = dahl.friction(1, x0=0.01)
    for side in (1.0, -1.0):
        assert friction.advance(0.3, side * 10.0, 1.0) == pytest.approx(side, abs=2e-3)
    assert friction.advance(0.0, 0.01, 1.0) == pytest.approx(0.5)
    assert friction.advance(0.4, 0.0, 5.0) == 0.4


def test_dahl_friction_depends_on_path_and_not_on_step_size():
    """One step equals a hundred small ones; there and back is a loop, which is nearly elastic for small motions."""
    friction = dahl.friction(1, x0=0.01)
    parts = 0.2
    for _ in range(100):
        parts = friction.advance(parts, 1e-4, 1.0)
    assert parts == pytest.approx(friction.advance(0.2, 1e-2, 1.0), rel=1e-9)
    small = friction.advance(friction.advance(0.0, 1e-5, 1.0), -1e-5, 1.0)
    large = friction.advance(friction.advance(0.0, 1e-1, 1.0), -1e-1, 1.0)
    assert abs(small) < 1e-5
    assert large < -0.9


def test_dahl_friction_slope_matches_the_equation():
    friction = dahl.friction(1, x0=0.02)
    for f, side in ((0.5, 1.0), (-0.7, 1.0), (0.5, -1.0)):
        slope = (friction.advance(f, side * 1e-7, 1.0) - f) / (side * 1e-7)
        assert slope == pytest.approx((1.0 - f * side) ** 2 / 0.02, rel=1e-4)


def test_beam_matches_the_integral_of_its_curvature():
    """Slope and deflection of the outstretched upper arm, from moments at 4000 sections, without the formulas."""
    arm = build_arm(Scenario(arm="kr30", believed=[]))
    q = np.zeros((1, 6))
    frames = arm.nominal_frames(q)
    load = distal_load(arm.heavy, frames, np.array([16.0]), arm.payload_point(frames), 1)
    span = arm.chain.link_lengths[1]
    length = float(np.linalg.norm(span))
    axis = span / length
    force, moment, weight = (part[0] for part in load)
    x = (np.arange(4000) + 0.5) * length / 4000
    rest = (length - x)[:, None]
    # Beyond section x: force and moment at the end, and the weight of the rest of the link, acting at its middle.
    sections = moment + np.cross(rest * axis, force) + np.cross(rest / 2.0 * axis, weight * rest / length)
    curvature = (sections - np.outer(sections @ axis, axis)) / STIFFNESS
    slope = curvature.sum(axis=0) * length / 4000
    sag = np.cross((curvature * rest).sum(axis=0) * length / 4000, axis)
    state = arm.state(q, {"payload": np.array([16.0])})
    found = Beam(1, STIFFNESS).coordinates(arm, state, frames)[1][0]
    assert np.allclose(found[3:], slope, rtol=1e-5, atol=1e-12)
    assert np.allclose(found[:3] + np.cross(found[3:], span), sag, rtol=1e-5, atol=1e-12)
    assert np.linalg.norm(sag) > 1e-5


def test_beam_sag_grows_with_payload_and_scale():
    scenario = Scenario(arm="kr30", believed=[], hidden=["beam_bending"])
    arm = build_arm(scenario)
    q = np.zeros((1, 6))
    sinks = [
        arm.true_position(q, {"payload": np.array([m])})[0] @ arm.measuring_from_base.rotation[:, 2]
        for m in (0.0, 16.0)
    ]
    assert sinks[1] < sinks[0] - 2e-5
    twice = arm.physics[0].scaled(2.0)
    state, frames = arm.state(q), arm.nominal_frames(q)
    once = arm.physics[0].coordinates(arm, state, frames)[1]
    assert np.allclose(twice.coordinates(arm, state, frames)[1], 2.0 * once)


def test_beam_choices_are_links_longer_than_200_mm():
    assert beam.choices("kr30") == [[1], [2], [3]]
    for arm in ("kr30", "irb2400", "cobot", "lbr"):
        context = context_of(Scenario(arm=arm))
        for (joint,) in beam.choices(arm):
            assert np.linalg.norm(context.chain.link_lengths[joint - 1]) > 0.2


def test_tooth_waves_have_the_stated_count_and_rms():
    arm = build_arm(
        Scenario(arm="kr30", believed=[], hidden=[{"effect": "tooth_waves", "joints": [4], "size": 1e-4}])
    )
    assert len(arm.terms) == teeth.WAVES
    assert all(t.coordinate == "motor4" for t in arm.terms)
    q = np.zeros((20000, 6))
    q[:, 3] = np.linspace(-np.pi, np.pi, 20000, endpoint=False)
    state = arm.state(q)
    moved = arm._stand(q, {}, True, None)[2].motor[:, 3]
    assert np.sqrt(np.mean(moved**2)) == pytest.approx(1e-4, rel=1e-6)
    orders = np.abs(np.fft.rfft(moved)) > 1e-3 * len(q) * 1e-4
    assert orders.sum() > 12
    assert len(state.q) == 20000


def test_each_gear_warms_and_cools_with_its_own_lag():
    campaign = simulate({"arm": "kr30", "hidden": ["duty_heat"], "rests": {"count": 2, "seconds": 3000.0}})
    warm = {
        name: values for name, values in campaign.unrecorded.items() if name.startswith(("_gear", "_housing"))
    }
    assert len(warm) == 12
    for k in range(1, 7):
        # In a rest both cool, the gear faster than its housing.
        left = [warm[name][80] / warm[name][79] for name in (f"_gear{k}", f"_housing{k}")]
        assert left[0] < left[1] < 1.0
    assert len({round(float(values[200]), 6) for values in warm.values()}) == 12
    assert campaign.hidden == [{"effect": "duty_heat", "joints": [1, 2, 3, 4, 5, 6]}]


def test_tracker_circles_have_three_harmonics():
    truth = EFFECTS["tracker_circles"]
    arm = build_arm(Scenario(arm="kr30", hidden=["tracker_circles"]))
    assert truth.joints(context_of(Scenario(arm="kr30"))) == []
    assert {harmonic for harmonic, _ in arm.tracker.circles} == {1, 2, 3}
    assert max(abs(v) for v in arm.tracker.circles.values()) < 12.0 * ARCSEC


@pytest.mark.quick("dahl_friction", "tracker_circles")
@pytest.mark.parametrize("name", TRUTHS)
def test_every_truth_states_its_causes_and_moves_the_arm(name):
    truth = TRUTHS[name]
    for arm in ("kr30", "irb2400", "cobot", "lbr"):
        for joints in truth.choices(arm):
            joint = joints[0] if joints else 0
            assert truth.causes(joint)
            assert truth.variables(joint)
            plan = {
                "arm": arm,
                "poses": 40,
                **truth.plan,
                "hidden": [{"effect": name, **({"joints": joints} if joints else {})}],
            }
            without = simulate(plan | {"hidden": []})
            shift = np.linalg.norm(simulate(plan).positions - without.positions, axis=1)
            assert 1e-6 < np.sqrt(np.mean(shift**2)) < 5e-3


def test_perfect_bars_keep_level_and_wrong_bars_close():
    attitude = np.radians(np.linspace(-50.0, 50.0, 41))
    perfect = Bars(1.4, 0.35, -0.5 * np.pi)
    assert np.abs(perfect.tilt(attitude, np.zeros(41))).max() < 1e-12
    before = np.full(41, 3e-4)
    assert perfect.tilt(attitude, before) == pytest.approx(before, abs=1e-12)

    wrong = Bars(1.4, 0.35, -0.5 * np.pi, bar_error=3e-4, arm_error=-2e-4, stands_error=1e-4)
    second = before * 0.0 + wrong.stands + wrong.tilt(attitude, before) + wrong.stands_error
    first = wrong.stands + before
    ends = 1.4 * np.exp(1j * attitude) + (0.35 - 2e-4) * np.exp(1j * second) - 0.35 * np.exp(1j * first)
    assert np.abs(ends) == pytest.approx(1.4 + 3e-4, abs=1e-12)


def test_wrong_bars_tilt_matches_first_order_formula():
    """d = (bar - arm cos b) / (r sin b) - stands, b from the link to the short arm: 1/sin, cot and a constant."""
    attitude = np.radians(np.linspace(-40.0, 40.0, 31))
    size = 1e-3
    wrong = Bars(1.4, 0.35, -0.5 * np.pi, 3e-4, 2e-4, 1e-4).scaled(size)
    between = attitude - wrong.stands
    first_order = size * ((3e-4 - 2e-4 * np.cos(between)) / (0.35 * np.sin(between)) - 1e-4)
    assert wrong.tilt(attitude, np.zeros(31)) == pytest.approx(first_order, abs=1e-10)


def test_levelling_bars_turn_the_level_link_alone():
    arm = build_arm(Scenario(arm="palletiser", believed=[], hidden=["levelling_bars"]))
    state = arm.state(np.array([[0.3, 0.2, -0.4, 0.0, 1.0], [-1.0, -0.3, 0.5, 0.0, 0.2]]))
    (bars,) = arm.physics
    turned = bars.coordinates(arm, state, arm.nominal_frames(state.q))
    assert list(turned) == [3]
    assert np.count_nonzero(turned[3][:, :5]) == 0
    assert np.all(np.abs(turned[3][:, 5]) < 3e-3)


def test_waves_and_offset_fit_wrong_bars_within_2_percent():
    """Wrong bars need no effect of their own (docs/effects.md): 40 to 140 degrees between link and short arms."""
    attitude = np.radians(np.linspace(-50.0, 50.0, 101))
    waves = np.stack(
        [np.ones(101), *(wave(n * attitude) for n in (1, 2) for wave in (np.sin, np.cos))], axis=1
    )
    for errors in ((3e-4, 0.0, 0.0), (0.0, 2e-4, 0.0), (3e-4, 2e-4, 1e-4)):
        tilt = Bars(1.4, 0.35, -0.5 * np.pi, *errors).tilt(attitude, np.zeros(101))
        left = tilt - waves @ np.linalg.lstsq(waves, tilt, rcond=None)[0]
        assert np.linalg.norm(left) < 0.02 * np.linalg.norm(tilt)
