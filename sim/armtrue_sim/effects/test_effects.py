"""Displacement of the tool by each effect, as stated in docs/model.md: sign, size, axis and frame."""

import numpy as np
import pytest

from ..arm import Arm, Term
from ..build import context_of
from ..errors import ScenarioError
from ..foreign import TRUTHS
from ..mechanics.chain import Chain
from ..mechanics.statics import gravity_loads
from ..mechanics.transforms import Pose
from ..poses import random_poses
from ..presets import PRESETS, nominal_robot
from ..scenario import Scenario
from . import EFFECTS, build_effect

IDENTITY = Pose.identity()
# Flange straight ahead of the shoulder, which on the KR30 is at x = 0.35, z = 0.815.
STRETCHED = np.radians([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])


def arm_with(entry, name="kr30", seed=0, **more):
    """An arm at the origin of the measuring frame, reflector on the flange, with one effect only."""
    entry = {"effect": entry} if isinstance(entry, str) else dict(entry)
    effect, joints = entry.pop("effect"), entry.pop("joints", None)
    truth = build_effect(effect, joints, entry, context_of(Scenario(arm=name)), seed, "test")
    return Arm(nominal_robot(name), truth.terms, IDENTITY, {"": IDENTITY}, truth.linkage, **more)


def moved(arm, q, **columns):
    columns = {key: np.asarray(value) for key, value in columns.items()}
    return arm.true_position(q, columns) - arm.nominal_position(q)


def poses(name="kr30", count=40):
    robot = nominal_robot(name)
    return random_poses(robot, Chain.from_robot(robot), count, np.random.default_rng(5))


def same_as_motor_shift(arm, shift, q, **columns):
    """True if the effect moves the tool as a shift of the motors by `shift` (N, n) does."""
    columns = {key: np.asarray(value) for key, value in columns.items()}
    return np.allclose(arm.true_position(q, columns), arm.nominal_position(q + shift), atol=1e-12)


def unit(k, n=6):
    return np.eye(n)[k - 1]


def test_compliance_lets_the_stretched_arm_sink():
    arm = arm_with({"effect": "joint_compliance", "joints": [2], "value": 1e-6})
    drop = moved(arm, STRETCHED)[0]
    torque = arm.standing_state(STRETCHED).loads.motor_torque[0, 1]
    # The tool hangs 0.99 m ahead of axis 2 and falls by angle times lever.
    assert torque > 300.0
    assert drop[2] == pytest.approx(-1e-6 * torque * (1.34 - 0.35), rel=1e-3)
    assert moved(arm, STRETCHED, payload=[16.0])[0, 2] < drop[2]


def test_compliance_of_a_parallelogram_follows_virtual_work():
    arm = arm_with({"effect": "joint_compliance", "joints": [2, 3], "value": [2e-6, 3e-6]}, "irb2400")
    q = poses("irb2400")
    torque = arm.standing_state(q).loads.motor_torque
    shift = np.zeros_like(q)
    shift[:, 1], shift[:, 2] = 2e-6 * torque[:, 1], 3e-6 * torque[:, 2]
    assert same_as_motor_shift(arm, shift, q)


def test_hardening_spring_deflects_less_than_a_linear_one():
    soft = arm_with({"effect": "joint_compliance", "joints": [2], "value": 2e-6})
    hard = arm_with({"effect": "stiffness_nonlinear", "joints": [2]})
    both = soft.with_terms([*soft.terms, *hard.terms])
    drops = [moved(arm, STRETCHED, payload=[16.0])[0, 2] for arm in (soft, both)]
    assert drops[0] < drops[1] < 0.0


def test_bending_compliance_tips_axis_1_towards_the_overhang():
    arm = arm_with({"effect": "bending_compliance", "joints": [1], "cx": 4e-7, "cy": 4e-7})
    # Axis 1 is vertical: its bearing tips towards the overhang, whichever way the arm is turned.
    for turn in (0.0, 1.0, -2.0):
        q = STRETCHED + turn * unit(1)
        shift = moved(arm, q)[0]
        ahead = np.array([np.cos(turn), np.sin(turn), 0.0])
        assert shift[2] < 0.0
        assert shift @ ahead > 0.0
        assert abs(shift @ [-ahead[1], ahead[0], 0.0]) < 0.1 * abs(shift[2])


def test_base_tilts_towards_the_overhang():
    arm = arm_with({"effect": "base_compliance", "cx": 1e-7, "cy": 1e-7})
    moment = arm.standing_state(STRETCHED).loads.base_moment[0]
    shift = moved(arm, STRETCHED)[0]
    assert shift == pytest.approx(
        np.cross([1e-7 * moment[0], 1e-7 * moment[1], 0.0], [1.34, 0.0, 1.81]), abs=1e-7
    )
    assert shift[2] < 0.0


def test_balancer_torque_is_minus_the_slope_of_spring_energy():
    spring = {
        "anchor": 0.15,
        "hook": 0.5,
        "upright": 0.1,
        "free_length": 0.25,
        "stiffness": 4e4,
        "compliance": 1e-6,
    }
    arm = arm_with({"effect": "gravity_balancer", **spring})
    q = np.linspace(-1.2, 0.6, 7)[:, None] * unit(2)

    def energy(angle):
        length = np.sqrt(0.15**2 + 0.5**2 - 2 * 0.15 * 0.5 * np.cos(angle - 0.1))
        return 0.5 * 4e4 * (length - 0.25) ** 2

    step = 1e-5
    torque = -(energy(q[:, 1] + step) - energy(q[:, 1] - step)) / (2 * step)
    assert same_as_motor_shift(arm, 1e-6 * torque[:, None] * unit(2), q)
    # The balancer acts against gravity on both sides of upright.
    gravity = arm.state(q).loads.motor_torque[:, 1]
    assert torque[0] * gravity[0] < 0.0
    assert torque[-1] * gravity[-1] < 0.0


@pytest.mark.parametrize(
    ("entry", "shift"),
    [
        ({"effect": "joint_offset", "joints": [4], "value": 1e-3}, lambda q: 1e-3 + 0 * q[:, 0]),
        ({"effect": "joint_scale", "joints": [4], "value": 1e-4}, lambda q: 1e-4 * q[:, 3]),
        (
            {
                "effect": "gear_harmonics",
                "joints": [4],
                "sin1": 1e-4,
                "cos1": 2e-4,
                "sin2": 3e-5,
                "cos2": 0.0,
            },
            lambda q: 1e-4 * np.sin(q[:, 3]) + 2e-4 * np.cos(q[:, 3]) + 3e-5 * np.sin(2 * q[:, 3]),
        ),
        (
            {"effect": "gear_mesh", "joints": [4], "orders": [2], "sin_2": 1e-4, "cos_2": 0.0},
            lambda q: 1e-4 * np.sin(2 * 97.3 * q[:, 3]),
        ),
        (
            {"effect": "gear_mesh", "joints": [4], "orders": [1], "ratio": 13.0, "sin_1": 0.0, "cos_1": 1e-4},
            lambda q: 1e-4 * np.cos(13.0 * q[:, 3]),
        ),
        (
            {"effect": "transmission_pwl", "joints": [4], "shape": "bump", "size": 5e-5, "centre": 0.5}
            | {"half_width": 0.4},
            lambda q: 1e-4 * np.clip(1 - np.abs(q[:, 3] - 0.5) / 0.4, 0, 1),
        ),
        ({"effect": "joint_coupling", "joints": [4, 2], "value": 1e-4}, lambda q: 1e-4 * q[:, 1]),
        (
            {"effect": "custom", "name": "x", "coordinate": "motor4", "expression": "q1*q2", "value": 1e-4},
            lambda q: 1e-4 * q[:, 0] * q[:, 1],
        ),
    ],
)
def test_motor_side_effect_equals_a_motor_shift(entry, shift):
    q = poses()
    assert same_as_motor_shift(arm_with(entry), shift(q)[:, None] * unit(4), q)


@pytest.mark.parametrize("shape", ["waves", "table"])
def test_transmission_depends_on_its_own_joint_only(shape):
    arm = arm_with({"effect": "transmission_pwl", "joints": [3], "shape": shape})
    q = poses()
    other = q.copy()
    other[:, 0] += 0.1
    errors = [np.linalg.norm(moved(arm, joints), axis=1) for joints in (q, other)]
    assert np.allclose(*errors, atol=1e-12)
    assert errors[0].max() > 2e-5


def test_backlash_follows_approach_direction_and_gravity():
    q = poses()
    side = np.where(np.arange(len(q)) % 2, 1, -1)
    arm = arm_with({"effect": "backlash", "joints": [2], "value": 7e-5, "load": 2e-5})
    gravity = np.sign(arm.state(q).loads.motor_torque[:, 1])
    assert same_as_motor_shift(arm, (7e-5 * side + 2e-5 * gravity)[:, None] * unit(2), q, dir2=side)
    assert same_as_motor_shift(arm, (2e-5 * gravity)[:, None] * unit(2), q)


def test_readback_is_an_effect_of_the_measurement_only():
    q = poses()
    behind = np.random.default_rng(3).normal(0.0, 2e-4, len(q))
    columns = {"qr2": q[:, 1] - behind}
    arm = arm_with({"effect": "command_readback", "joints": [2]})
    assert same_as_motor_shift(arm, -behind[:, None] * unit(2), q, **columns)
    assert np.array_equal(arm.true_position(q, columns, measurement_effects=False), arm.true_position(q, {}))


def test_thermal_expansion_scales_each_length_once():
    arm = arm_with({"effect": "thermal_expansion", "value": 2e-5}, "lbr")
    upright = np.zeros((1, 7))
    total = 0.36 + 0.42 + 0.4 + 0.152
    assert moved(arm, upright, temp_arm=[30.0])[0] == pytest.approx(
        [0.0, 0.0, 2e-5 * 10.0 * total], abs=1e-12
    )
    assert np.allclose(moved(arm, upright), 0.0)


@pytest.mark.parametrize("convention", ["mdh", "dh"])
def test_expansion_scales_the_whole_arm_about_its_base(convention):
    scenario = Scenario(arm="kr30", convention=convention)
    truth = build_effect("thermal_expansion", None, {"value": 1e-5}, context_of(scenario), 0, "test")
    arm = Arm(nominal_robot("kr30", convention), truth.terms, IDENTITY, {"": IDENTITY})
    q = poses()
    grown = arm.true_position(q, {"temp_arm": np.full(len(q), 20.0 + 12.0)})
    assert np.allclose(grown, arm.nominal_position(q) * (1.0 + 12e-5), atol=1e-12)


def test_warm_up_reaches_63_percent_after_its_time_constant():
    arm = arm_with(
        {"effect": "warm_up", "tau": 1800.0, "growth": 2e-4, **{f"motor{k}": 0.0 for k in range(1, 7)}}
    )
    q = np.repeat(poses(count=1), 3, axis=0)
    shift = np.linalg.norm(moved(arm, q, time=[0.0, 1800.0, 1e6]), axis=1)
    assert shift[0] == 0.0
    assert shift[1] / shift[2] == pytest.approx(1.0 - np.exp(-1.0))
    assert shift[2] == pytest.approx(2e-4 * np.linalg.norm(arm.nominal_position(q[:1])), rel=1e-9)


def test_joint_zero_drifts_with_temperature():
    arm = arm_with({"effect": "thermal_joint_drift", "joints": [3], "value": 5e-6})
    q = poses()
    assert same_as_motor_shift(arm, 5e-6 * 8.0 * unit(3) + 0 * q, q, temp_arm=np.full(len(q), 28.0))


@pytest.mark.parametrize(("effect", "column"), [("thermal_base", "temp_arm"), ("time_drift", "time")])
def test_base_shift_moves_the_arm_as_a_whole(effect, column):
    arm = arm_with({"effect": effect, "tx": 1e-6, "ty": 0.0, "tz": 2e-6, "rx": 0.0, "ry": 0.0, "rz": 3e-6})
    q = poses()
    amount = 10.0
    value = amount + (20.0 if effect == "thermal_base" else 0.0)
    turn = Pose.from_vector(amount * np.array([1e-6, 0.0, 2e-6, 0.0, 0.0, 3e-6]))
    expected = arm.nominal_position(q) @ turn.rotation.T + turn.translation
    assert np.allclose(arm.true_position(q, {column: np.full(len(q), value)}), expected, atol=1e-12)


def test_link_geometry_acts_in_the_frame_after_its_joint():
    arm = arm_with({"effect": "link_geometry", "joints": [2], "tx": 1e-3, "ty": 0, "tz": 0, "rx": 0, "ry": 0})
    # x of frame 2 points along the lower arm, which stands upright at zero and lies forward at a quarter turn.
    assert moved(arm, STRETCHED)[0] == pytest.approx([0.0, 0.0, 1e-3], abs=1e-12)
    assert moved(arm, STRETCHED + np.pi / 2 * unit(2))[0] == pytest.approx([1e-3, 0.0, 0.0], abs=1e-12)


def test_linkage_turns_the_forearm_by_the_closed_loop():
    errors = {
        "crank_error": 0,
        "rod_error": 0,
        "rocker_error": 0,
        "arm_error": 1e-4,
        "pivot_x": 0,
        "pivot_y": 0,
    }
    arm = arm_with({"effect": "parallelogram", **errors}, "irb2400")
    q = poses("irb2400")
    beta = 1.6707963267948966 + q[:, 2] - q[:, 1]
    turn = 1e-4 / 0.32 / np.sin(beta)
    # To first order this is a turn of axis 3 by that angle; the coupling passes on motor 3's angle unchanged.
    assert np.allclose(arm.true_position(q), arm.nominal_position(q + turn[:, None] * unit(3)), atol=1e-6)


def test_grid_shifts_in_frame_1_by_its_nodes():
    arm = arm_with({"effect": "residual_grid", "nodes": [2, 2, 2], "size": 5e-5})
    limits = arm.chain.limits
    corner = STRETCHED.copy()
    corner[0, :3] = limits[:3, 0]
    first = np.array([t.value for t in arm.terms[:3]])
    turn = np.array(
        [[np.cos(corner[0, 0]), -np.sin(corner[0, 0])], [np.sin(corner[0, 0]), np.cos(corner[0, 0])]]
    )
    assert moved(arm, corner)[0] == pytest.approx([*(turn @ first[:2]), first[2]], abs=1e-12)
    # Multilinear: the middle of the box is the mean of its eight corners, seen in frame 1.
    middle = STRETCHED.copy()
    middle[0, 1:3] = limits[1:3].mean(axis=1)
    mean = np.array([t.value for t in arm.terms]).reshape(8, 3).mean(axis=0)
    assert moved(arm, middle)[0] == pytest.approx(mean, abs=1e-12)


def test_deflected_statics_differ_at_second_order():
    entry = {"effect": "joint_compliance", "joints": [2], "value": 1e-6}
    q = poses()
    nominal, deflected = (arm_with(entry, statics=s).true_position(q) for s in ("nominal", "deflected"))
    difference = np.linalg.norm(nominal - deflected, axis=1).max()
    assert (
        1e-8 < difference < 1e-2 * np.linalg.norm(nominal - arm_with(entry).nominal_position(q), axis=1).max()
    )


def test_every_effect_of_the_contract_exists_and_moves_an_arm():
    # Only arms with a passive joint have these (foreign/test_foreign.py).
    assert set(EFFECTS) - set(TRUTHS) - {"levelling_bars"} == {
        "base_frame",
        "tool_offset",
        "joint_offset",
        "link_geometry",
        "joint_scale",
        "joint_compliance",
        "stiffness_nonlinear",
        "bending_compliance",
        "base_compliance",
        "gravity_balancer",
        "gear_harmonics",
        "gear_mesh",
        "transmission_pwl",
        "backlash",
        "joint_coupling",
        "parallelogram",
        "thermal_expansion",
        "thermal_joint_drift",
        "thermal_base",
        "warm_up",
        "time_drift",
        "command_readback",
        "residual_grid",
        "custom",
        *("mass_parameters", "gravity_direction", "axis_wobble", "cross_compliance", "hysteresis"),
        *("coupling_harmonics", "thermal_gradient", "self_heating", "balancer_state", "axis_straightness"),
        *("tracker_scale", "tracker_angles", "station", "nest"),
    }
    q = poses("irb2400")
    count = len(q)
    state = {f"dir{k}": np.ones(count) for k in range(1, 7)} | {
        f"qr{k}": q[:, k - 1] + 1e-4 for k in range(1, 7)
    }
    state |= {
        "temp_arm": np.full(count, 30.0),
        "time": np.full(count, 4000.0),
        "payload": np.full(count, 8.0),
    }
    # test_more_effects.py tests effects that are not terms, or need more columns or another arm.
    elsewhere = {"mass_parameters", "gravity_direction", "thermal_gradient", "self_heating", "balancer_state"}
    elsewhere |= {
        "axis_straightness",
        "tracker_scale",
        "tracker_angles",
        "station",
        "nest",
        "levelling_bars",
        *TRUTHS,
    }
    for effect in set(EFFECTS) - elsewhere - {"base_frame", "tool_offset", "custom"}:
        arm = arm_with(effect, "irb2400")
        shift = np.linalg.norm(arm.true_position(q, state) - arm.nominal_position(q), axis=1)
        assert 1e-7 < np.sqrt(np.mean(shift**2)) < 2e-2, effect


@pytest.mark.parametrize("name", PRESETS)
def test_drawn_joint_compliance_is_within_realistic_limits(name):
    robot = nominal_robot(name)
    chain = Chain.from_robot(robot)
    q = poses(name)
    loads = gravity_loads(
        chain, chain.frames(chain.link_variables(q)), np.zeros(len(q)), np.zeros((len(q), 3))
    )
    for seed in range(5):
        for term in arm_with("joint_compliance", name, seed).terms:
            assert 0.0 < term.value <= 9e-5
            k = term.joints[0]
            assert np.abs(loads.motor_torque[:, k - 1] * term.value).max() < 2e-2


def test_given_size_keeps_other_draws_and_scale_multiplies():
    drawn = {t.coordinate: t.value for t in arm_with({"effect": "link_geometry", "joints": [2]}).terms}
    given = {
        t.coordinate: t.value for t in arm_with({"effect": "link_geometry", "joints": [2], "tx": 1e-3}).terms
    }
    assert given.pop("link2.tx") == 1e-3
    drawn.pop("link2.tx")
    assert given == drawn
    doubled = arm_with({"effect": "link_geometry", "joints": [2], "scale": 2.0})
    assert {t.coordinate: t.value / 2.0 for t in doubled.terms if t.coordinate != "link2.tx"} == drawn


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("eccentricity", "unknown effect 'eccentricity'"),
        ({"effect": "backlash", "joints": [7]}, "joint 7 of 'backlash'"),
        ({"effect": "backlash", "joints": [2], "amplitude": 1}, "unknown key 'amplitude'"),
        ({"effect": "backlash", "joints": [2], "value": "big"}, "'value' is 'big'"),
        ({"effect": "joint_coupling", "joints": [5, 5]}, r"\[5, 5\]"),
        ({"effect": "gravity_balancer", "joints": [3]}, r"expected \[2\]"),
        ({"effect": "transmission_pwl", "joints": [1], "shape": "spline"}, "spline"),
        ({"effect": "thermal_expansion", "sensor": "cellar"}, "cellar"),
        ({"effect": "custom", "name": "x"}, "needs name, coordinate"),
        ("parallelogram", "no `linkage`"),
        ({"effect": "residual_grid", "nodes": [4, 1, 4]}, "residual_grid: nodes"),
    ],
)
def test_invalid_entry_is_named_in_the_error(entry, message):
    with pytest.raises(ScenarioError, match=message):
        arm_with(entry)


def test_unknown_coordinates_are_named():
    for coordinate in ("motor9", "link2.sx", "wrist.tx", "link0.tx"):
        with pytest.raises(ScenarioError, match=coordinate):
            Arm(
                nominal_robot("kr30"),
                [Term("custom", (), coordinate, "1", 1.0, "m")],
                IDENTITY,
                {"": IDENTITY},
            )
