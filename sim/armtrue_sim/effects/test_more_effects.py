"""Displacement of the tool by the catalogue's later effects, as stated in the contract's table."""

import numpy as np
import pytest

from ..build import build_arm, context_of
from ..campaign import simulate
from ..errors import ScenarioError
from ..scenario import Scenario
from .base import build_effect
from .test_effects import arm_with, poses, same_as_motor_shift, unit

Q = poses()
GEOMETRY = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]


def test_cross_compliance_turns_each_axis_by_the_others_torque():
    arm = arm_with({"effect": "cross_compliance", "joints": [2, 3], "value": 1e-6})
    torque = arm.standing_state(Q).loads.motor_torque
    shift = 1e-6 * (torque[:, 2, None] * unit(2) + torque[:, 1, None] * unit(3))
    assert same_as_motor_shift(arm, shift, Q)


def test_wrong_masses_change_positions_and_not_robot_file():
    scenario = {
        "arm": "kr30",
        "seed": 3,
        "hidden": [{"effect": "mass_parameters", "mass": 0.2, "centre": 0.015}],
    }
    campaign = simulate(scenario)
    stated, real = campaign.robot["links"], campaign.truth["links"]
    for a, b in zip(stated, real, strict=True):
        assert abs(b["mass"] / a["mass"] - 1.0) == pytest.approx(0.2)
        assert np.linalg.norm(np.subtract(b["com"], a["com"])) == pytest.approx(0.015)
    assert np.linalg.norm(campaign.truth["payload_centre"]) == pytest.approx(0.015)
    assert not np.allclose(campaign.exact, simulate(scenario | {"hidden": []}).exact, atol=1e-5)


def test_wrong_masses_move_nothing_on_an_arm_without_springs():
    scenario = {"arm": "kr30", "seed": 3, "believed": GEOMETRY}
    weighed = simulate(scenario | {"unlike": ["mass_parameters", "gravity_direction"]})
    assert np.allclose(weighed.exact, simulate(scenario).exact, atol=1e-13)
    assert weighed.hidden == [{"effect": "none", "joints": []}]
    assert weighed.model["effects"] == GEOMETRY


def test_tilted_gravity_loads_axis_1():
    entry = {"effect": "gravity_direction", "tilt": 3e-3}
    arm, level = (build_arm(Scenario(arm="kr30", believed=[], hidden=h)) for h in ([entry], []))
    assert np.linalg.norm(arm.heavy.gravity) == pytest.approx(9.81)
    assert np.arccos(-arm.heavy.gravity[2] / 9.81) == pytest.approx(3e-3, rel=1e-6)
    # On a level floor axis 1 is vertical and carries no gravity torque; on a tilted one it does.
    assert np.abs(level.standing_state(Q).loads.motor_torque[:, 0]).max() < 1e-9
    assert np.abs(arm.standing_state(Q).loads.motor_torque[:, 0]).max() > 1.0


def test_axis_wobble_repeats_after_a_full_turn():
    arm = arm_with({"effect": "axis_wobble", "joints": [1]})
    start, half = (arm.true_position(Q + turn * unit(1)) for turn in (0.0, np.pi))
    assert np.allclose(arm.true_position(Q + 2 * np.pi * unit(1)), start, atol=1e-12)
    nominal = arm.nominal_position(Q + np.pi * unit(1))
    assert not np.allclose(half - nominal, (start - arm.nominal_position(Q)) * [-1, -1, 1], atol=1e-6)


def test_hysteresis_changes_sides_over_its_travel():
    sizes = {"travel": -1e-4, "load": 0.0, "theta0": 0.02}
    arm = arm_with({"effect": "hysteresis", "joints": [2], **sizes})
    count = len(Q)
    for travel, side, lag in ((5.0, 1, -1e-4), (5.0, -1, 1e-4), (0.0, 1, 1e-4), (0.02 * np.log(2.0), 1, 0.0)):
        columns = {"travel2": np.full(count, travel), "dir2": np.full(count, side)}
        assert same_as_motor_shift(arm, np.full((count, 1), lag) * unit(2), Q, **columns)


def test_coupling_harmonics_turn_driven_joint_by_driving_angle():
    waves = {"sin1": 1e-4, "cos1": 0.0, "sin2": 0.0, "cos2": 5e-5}
    arm = arm_with({"effect": "coupling_harmonics", "joints": [5, 4], **waves})
    shift = 1e-4 * np.sin(Q[:, 3]) + 5e-5 * np.cos(2 * Q[:, 3])
    assert same_as_motor_shift(arm, shift[:, None] * unit(5), Q)


def test_thermal_gradient_depends_on_difference_of_sides_only():
    scenario = Scenario(arm="kr30", sensors=["arm", "top", "bottom"], hidden=["thermal_gradient"])
    arm = build_arm(scenario)
    alike = arm.true_position(Q, {"temp_top": np.full(len(Q), 31.0), "temp_bottom": np.full(len(Q), 31.0)})
    apart = arm.true_position(Q, {"temp_top": np.full(len(Q), 31.0), "temp_bottom": np.full(len(Q), 29.0)})
    assert np.allclose(alike, arm.true_position(Q), atol=1e-12)
    assert np.linalg.norm(apart - alike, axis=1).max() > 2e-5


def test_top_and_bottom_sensors_differ_by_their_wave():
    campaign = simulate({"arm": "kr30", "sensors": ["arm", "top", "bottom"], "temperature": {"wave": 2.0}})
    assert np.std(campaign.data["temp_top"] - campaign.data["temp_bottom"]) > 0.5
    assert campaign.robot["temperature"]["sensors"] == ["arm", "top", "bottom"]


def test_balancer_state_adds_gas_pressure_and_friction():
    beside = {"compliance": 1e-6}
    entry = {"effect": "balancer_state", "pressure": 1 / 293, "friction": -0.05, **beside}
    arm = build_arm(Scenario(arm="kr30", believed=[{"effect": "gravity_balancer", **beside}], hidden=[entry]))
    torque = arm.standing_state(Q)["balancer2"]
    twist = 1e-6 * (torque * 10 / 293 - 0.05 * np.abs(torque))
    count = len(Q)
    there = arm.true_position(Q, {"temp_arm": np.full(count, 30.0), "dir2": np.ones(count)})
    # The balancer's torque is that at the commanded angle: a motor error must not change it.
    motor = np.zeros_like(Q)
    motor[:, 1] = twist
    assert np.allclose(there, arm.true_position(Q, motor_error=motor), atol=1e-12)


def test_balancer_state_without_a_balancer_is_refused():
    with pytest.raises(ScenarioError, match="joint 2 has no gravity_balancer"):
        build_arm(Scenario(arm="kr30", hidden=["balancer_state"]))


def test_gear_load_is_gravity_torque_plus_balancer_torque():
    balancer = {"effect": "gravity_balancer", "compliance": 0.0}
    hardening = {"effect": "stiffness_nonlinear", "joints": [2], "square": -1e-8, "cube": 0.0}
    arm = build_arm(Scenario(arm="kr30", believed=[balancer], hidden=[hardening]))
    state = arm.standing_state(Q)
    assert np.allclose(state["load2"], state["tau2"] + state["balancer2"])
    assert np.abs(state["load2"]).mean() < 0.9 * np.abs(state["tau2"]).mean()


def test_soft_zone_deflection_saturates_with_torque():
    zone = {"square": 0.0, "cube": 0.0, "soft": 1e-4, "soft_torque": 10.0}
    arm = arm_with({"effect": "stiffness_nonlinear", "joints": [2], **zone})
    torque = arm.standing_state(Q).loads.motor_torque[:, 1]
    assert same_as_motor_shift(arm, 1e-4 * np.tanh(torque / 10.0)[:, None] * unit(2), Q)


def test_axis_straightness_has_no_term_along_the_rail():
    arm = build_arm(Scenario(arm="stanford", believed=[], hidden=["axis_straightness"]))
    assert {t.coordinate for t in arm.terms} == {f"link3.{c}" for c in ("tx", "ty", "rx", "ry", "rz")}
    with pytest.raises(ScenarioError, match="joint 2 turns"):
        build_arm(Scenario(arm="stanford", hidden=[{"effect": "axis_straightness", "joints": [2]}]))


def test_pair_effect_with_a_single_joint_is_refused():
    context = context_of(Scenario(arm="kr30"))
    for effect in ("coupling_harmonics", "cross_compliance"):
        with pytest.raises(ScenarioError, match="expected pairs of different joints"):
            build_effect(effect, [2], {}, context, 0, "test")
    assert context.parallel_pairs() == [[2, 3]]


def test_scale_multiplies_effects_that_are_not_terms():
    for entry in (
        "mass_parameters",
        "gravity_direction",
        "tracker_scale",
        "tracker_angles",
        "station",
        "nest",
    ):
        context = context_of(Scenario(arm="kr30"))
        once, thrice = (build_effect(entry, None, {"scale": s}, context, 5, "test") for s in (1.0, 3.0))
        single, triple = (np.array(_numbers(truth)) for truth in (once, thrice))
        assert np.any(single != 0.0)
        assert np.allclose(triple, 3.0 * single, rtol=1e-6)


def _numbers(truth):
    body, tracker = truth.body, truth.tracker
    found = [*body.mass.values(), *np.ravel(list(body.centre.values())), *body.payload_centre, *body.tilt]
    found += [tracker.scale, *tracker.circles.values(), *np.ravel(list(tracker.nests.values()))]
    return found + [float(v) for pose in tracker.stations.values() for v in pose.translation]
