"""From a scenario to the real arm: nominal file, real base and reflectors, true terms."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from . import foreign  # noqa: F401  (registers its effects)
from .arm import Arm
from .effects import EffectContext, EffectTruth, build_effect
from .errors import ScenarioError
from .mechanics.chain import Chain
from .mechanics.transforms import Pose
from .presets import PRESETS, nominal_robot
from .scenario import Scenario


def context_of(scenario: Scenario) -> EffectContext:
    """Data of the scenario's arm that its effects may use."""
    robot = nominal_robot(scenario.arm, scenario.convention, scenario.variant)
    if scenario.sensors:
        robot.setdefault("temperature", {"reference": 20.0})["sensors"] = list(scenario.sensors)
    return EffectContext(robot, Chain.from_robot(robot), PRESETS[scenario.arm])


def build_truth(scenario: Scenario) -> EffectTruth:
    """True errors of arm and instrument from all entries of the scenario. Raises ScenarioError."""
    context = context_of(scenario)
    truth = EffectTruth()
    for role, name, joints, sizes in scenario.entries():
        truth += build_effect(name, joints, sizes, context, scenario.seed, f"{scenario.where}: {role}")
    return truth


def build_arm(scenario: Scenario) -> Arm:
    """The arm as it really is. Raises ScenarioError on an unknown arm, effect, joint or size."""
    context = context_of(scenario)
    rng = np.random.default_rng([scenario.seed, 3])
    base = _placed(scenario.base, _draw_base(scenario, rng))
    tool = _placed(scenario.tool, _draw_tool(scenario, rng))
    robot = context.robot
    tool_error = scenario.nominal_error.get("tool", 1e-3) * rng.uniform(-1.0, 1.0, 3)
    # robot.yaml states a position only; the reflector's real frame is turned like the flange.
    nominal_tool = tool.translation - tool_error
    robot["tool"] = {"xyz": [float(v) for v in nominal_tool]}
    size = scenario.nominal_error.get("base", 5e-3)
    base_error = Pose.from_vector(
        np.concatenate([size * rng.uniform(-1, 1, 3), size * rng.uniform(-1, 1, 3)])
    )
    robot["base"] = (base @ base_error.inverse()).xyz_rpy()
    targets = _reflectors(scenario, tool, rng)
    truth = build_truth(scenario)
    arm = Arm(
        robot,
        truth.terms,
        base,
        targets,
        truth.linkage,
        scenario.statics,
        truth.body,
        truth.physics,
        truth.histories,
        truth.tracker,
    )
    _refuse_unknown_state(scenario, arm)
    return arm


def published_robot(scenario: Scenario, robot: dict[str, Any]) -> dict[str, Any]:
    """robot.yaml as the owner of the arm has it: without the keys that the scenario omits. Raises ScenarioError."""
    published = copy.deepcopy(robot)
    for key in scenario.robot_file.get("omit", []):
        if key not in ("links", "tool", "base", "temperature", "gravity"):
            raise ScenarioError(
                f"{scenario.where}: robot_file.omit holds '{key}', expected links, tool, base, temperature or gravity"
            )
        published.pop(key, None)
    return published


def _placed(given: dict[str, list[float]] | None, drawn: Pose) -> Pose:
    return Pose.from_xyz_rpy(given["xyz"], given.get("rpy", [0.0, 0.0, 0.0])) if given else drawn


def _draw_base(scenario: Scenario, rng: np.random.Generator) -> Pose:
    """Random base pose in the measuring frame, which is the tracker's: beyond the arm's reach, any heading."""
    bearing, turn = rng.uniform(-np.pi, np.pi, 2)
    distance = PRESETS[scenario.arm].reach + rng.uniform(0.5, 1.5)
    xyz = [distance * np.cos(bearing), distance * np.sin(bearing), rng.uniform(-0.8, 0.2)]
    return Pose.from_xyz_rpy(xyz, [*(0.02 * rng.standard_normal(2)), turn])


def _draw_tool(scenario: Scenario, rng: np.random.Generator) -> Pose:
    return Pose(np.eye(3), np.array(PRESETS[scenario.arm].tool) + rng.uniform(-0.02, 0.02, 3))


def _reflectors(scenario: Scenario, tool: Pose, rng: np.random.Generator) -> dict[str, Pose]:
    """The first reflector sits at the tool point, the others 50 to 150 mm from it across the flange."""
    names = scenario.targets.get("names")
    if not names:
        return {"": tool}
    poses = {}
    for i, name in enumerate(names):
        radius, bearing = rng.uniform(0.05, 0.15), rng.uniform(0.0, 2.0 * np.pi)
        shift = np.array([radius * np.cos(bearing), radius * np.sin(bearing), rng.uniform(-0.03, 0.03)])
        poses[str(name)] = tool if i == 0 else tool @ Pose(np.eye(3), shift)
    return poses


def _refuse_unknown_state(scenario: Scenario, arm: Arm) -> None:
    """Evaluates one pose, which is enough to find an unknown variable or coordinate. Raises ScenarioError."""
    try:
        arm.true_pose(arm.chain.limits.mean(axis=1)[None])
    except ScenarioError as error:
        raise ScenarioError(f"{scenario.where}: {error}") from None
