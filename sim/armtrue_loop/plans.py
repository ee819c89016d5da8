"""Where to measure: a scenario's campaign for the fit, and poses for the judgement that nobody fits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from armtrue_sim.arm import Arm
from armtrue_sim.poses import random_poses
from armtrue_sim.presets import PRESETS
from armtrue_sim.scenario import Scenario

Array = np.ndarray[Any, np.dtype[np.float64]]
Index = np.ndarray[Any, np.dtype[np.int64]]

# Poses of the test keep this smallest singular value of the tool's Jacobian, of the reach. Closer to a singularity the
# compensator's damped step leaves part of the error on purpose (docs/decisions/0041).
AWAY_FROM_SINGULAR = 0.1
_STEP_RAD = 1e-5


@dataclass
class Plan:
    """Where to measure and with what."""

    joints: Array  # (N, 6), rad
    payloads: Array  # (N,), kg
    repeat: Array  # (N,), the same number is the same pose
    pause_s: float = 25.0  # simulated time a pose


def is_regular(arm: Arm, joints: Array) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """True (N,) where joints (N, n) are away from singularities of the tool's position."""
    columns = []
    for joint in range(joints.shape[1]):
        step = np.zeros(joints.shape[1])
        step[joint] = _STEP_RAD
        ahead, behind = arm.nominal_position(joints + step), arm.nominal_position(joints - step)
        columns.append((ahead - behind) / (2.0 * _STEP_RAD))
    least = np.linalg.svd(np.stack(columns, axis=-1), compute_uv=False)[:, -1]
    reach = sum(abs(joint["a"]) + abs(joint["d"]) for joint in arm.robot["kinematics"]["joints"])
    return np.asarray(least >= AWAY_FROM_SINGULAR * reach)


def make_plans(scenario: Scenario, arm: Arm) -> tuple[Plan, Plan]:
    """Training and test poses, payloads included; the test's poses are away from singularities."""
    random = np.random.default_rng([scenario.seed, 78])
    repeated, times = scenario.repeats.get("poses", 0), scenario.repeats.get("times", 0)
    fresh = scenario.poses - repeated * times
    masses = np.array(scenario.payloads if scenario.payloads is not None else PRESETS[scenario.arm].payloads)

    def plan(joints: Array, order: Index) -> Plan:
        payloads = random.choice(masses, len(joints))
        return Plan(joints[order], payloads[order], order.astype(float), scenario.interval)

    def poses(count: int) -> Array:
        return random_poses(arm.robot, arm.chain, count, random, scenario.floor)

    training = plan(poses(fresh), np.r_[np.arange(fresh), np.tile(np.arange(repeated), times)].astype(int))
    candidates = poses(20 * scenario.test_poses)
    regular = candidates[is_regular(arm, candidates)][: scenario.test_poses]
    return training, plan(regular, np.arange(len(regular)))
