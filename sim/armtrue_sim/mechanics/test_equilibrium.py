"""The simulated arm stands where its springs balance its real weight, not the weight that its file states."""

import numpy as np
import pytest

from ..arm import Arm
from ..build import build_arm
from ..campaign import simulate
from ..errors import ScenarioError
from ..scenario import Scenario
from ..sensitivity import sensitivity, unit_term

SPRING = {"effect": "joint_compliance", "joints": [2], "value": 3e-4}


def energy(arm: Arm, q, payload, turn):
    """Potential energy of gravity and of the spring, with axis 2 turned by `turn` from q2."""
    shifted = q + turn * np.eye(arm.chain.n)[1]
    frames = arm.nominal_frames(shifted)
    height = -payload * (arm.payload_point(frames) @ arm.heavy.gravity)
    for k, link in enumerate(arm.heavy.links):
        height = height - link.mass * ((frames.origin[k] + frames.rotation[k] @ link.com) @ arm.heavy.gravity)
    return height + turn**2 / (2.0 * 3e-4)


def test_soft_arm_stands_at_minimum_energy():
    arm = build_arm(Scenario(arm="cobot", believed=[SPRING], unlike=["mass_parameters"]))
    q = simulate({"arm": "cobot", "poses": 30}).q
    payload = np.linspace(0.0, 4.0, len(q))
    torque = arm.standing_state(q, {"payload": payload})["tau2"]
    turn = 3e-4 * torque
    assert np.abs(turn).max() > 0.02
    for step in (1e-4, -1e-4):
        for i in range(len(q)):
            here, beside = (energy(arm, q[i : i + 1], payload[i], turn[i] + s)[0] for s in (0.0, step))
            assert beside > here


def test_tool_moves_by_the_deflection_of_the_spring():
    arm = build_arm(Scenario(arm="cobot", believed=[SPRING]))
    q = simulate({"arm": "cobot", "poses": 30}).q
    motor = np.zeros_like(q)
    motor[:, 1] = 3e-4 * arm.standing_state(q)["tau2"]
    assert np.allclose(arm.true_position(q), arm.with_terms([]).true_position(q + motor), atol=1e-11)


def test_arm_too_soft_to_stand_is_refused():
    with pytest.raises(ScenarioError, match="too soft to stand"):
        simulate({"arm": "cobot", "poses": 30, "believed": [SPRING | {"value": 0.1}]})


def test_measured_torques_are_those_of_the_standing_arm():
    plan = {
        "arm": "cobot",
        "poses": 30,
        "believed": [SPRING],
        "columns": {"add": ["tau"]},
        "torque_noise": 0.0,
    }
    campaign = simulate(plan | {"unlike": ["mass_parameters"]})
    real = campaign.arm.standing_state(campaign.q, campaign.data)["tau2"]
    # The file's torques differ only by the repeatability of the drives, some microradians.
    assert np.allclose(campaign.data["tau2"], real, atol=2e-3)
    assert not np.allclose(campaign.data["tau2"], simulate(plan).data["tau2"], atol=0.5)


def test_sensitivity_uses_the_loads_of_the_standing_arm():
    arm = build_arm(Scenario(arm="cobot", believed=[SPRING]))
    q = simulate({"arm": "cobot", "poses": 30}).q
    term = unit_term("motor2", "tau2")
    found = sensitivity(arm, q, {}, [term]).reshape(-1, 3)
    motor = sensitivity(arm, q, {}, [unit_term("motor2")]).reshape(-1, 3)
    assert np.allclose(found, arm.standing_state(q)["tau2"][:, None] * motor)
    assert not np.allclose(arm.state(q)["tau2"], arm.standing_state(q)["tau2"], atol=0.1)
