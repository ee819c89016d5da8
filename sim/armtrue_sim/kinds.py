"""Kinds of hidden-effect cases: what is hidden, in which circumstances, and what must be recorded to find it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from .effects.base import EffectContext
from .mechanics.chain import Chain
from .presets import PRESETS, nominal_robot

ARMS = ("kr30", "irb2400", "cobot", "lbr")
# What robot.yaml has wrong of every real arm: masses 20 % and centres 15 mm off, the base 3 mrad out of level.
UNLIKE_ITS_FILE = ("mass_parameters", "gravity_direction")
# A joint that repeats badly beside others at 2.5 urad.
BAD_REPEATABILITY = 2.5e-5


@dataclass(frozen=True)
class Kind:
    """hidden: how many effects; source: where they are drawn from, `catalogue`, `formulas` and `truths` (foreign/), or
    effect ids. changes: to the scenario. real: the arm is unlike its file and one joint repeats badly. noise: times the
    tracker's."""

    hidden: int = 1
    source: str | tuple[str, ...] = "catalogue"
    changes: Mapping[str, Any] = field(default_factory=dict)
    noise: float = 1.0
    real: bool = False
    arms: tuple[str, ...] = ARMS


@dataclass(frozen=True)
class Later:
    """How an effect of the contract's later rows hides: joints to choose from, what its measurement needs, which arms.

    believed: what model.yaml has beside base, tool and joint zeros. sizes: those that are not to be drawn.
    """

    joints: Callable[[EffectContext], list[list[int]]]
    changes: Mapping[str, Any] = field(default_factory=dict)
    believed: tuple[str, ...] = ("link_geometry", "joint_compliance")
    arms: tuple[str, ...] = ARMS
    sizes: Mapping[str, float] = field(default_factory=dict)


def context_for(arm: str) -> EffectContext:
    """Effects' view of a preset."""
    robot = nominal_robot(arm)
    return EffectContext(robot, Chain.from_robot(robot), PRESETS[arm])


def _whole(context: EffectContext) -> list[list[int]]:
    return [[]]


def _early(context: EffectContext) -> list[list[int]]:
    return [[k] for k in range(1, 5)]


def _wrist(context: EffectContext) -> list[list[int]]:
    return [list(pair) for pair in context.preset.wrist_pairs]


# A closed session shows no cause that is slower than it: sensors that swing, pauses, several set-ups.
LATER: dict[str, Later] = {
    "mass_parameters": Later(_whole),
    # A gear with a soft zone alone: 0.2 mrad about zero load, as lost motion of half a minute of arc.
    "stiffness_nonlinear": Later(
        lambda context: [[k] for k in context.preset.compliant[:2]],
        sizes={"square": 0.0, "cube": 0.0, "soft": 2e-4},
    ),
    # As a mobile platform stands; 3 mrad on springs 2 and 3 alone are within the noise.
    "gravity_direction": Later(_whole, arms=("kr30", "cobot", "lbr"), sizes={"tilt": 0.01}),
    "axis_wobble": Later(_early),
    "cross_compliance": Later(EffectContext.parallel_pairs, arms=("kr30", "irb2400", "cobot")),
    "hysteresis": Later(_early, {"directions": "order", "columns": {"add": ["travel"]}}),
    "coupling_harmonics": Later(_wrist, arms=("kr30", "irb2400", "cobot")),
    "thermal_gradient": Later(
        lambda context: [[2], [3]], {"sensors": ["arm", "top", "bottom"], "temperature": {"wave": 2.0}}
    ),
    "self_heating": Later(_early, {"rests": {"count": 3, "seconds": 3000.0}, "columns": {"add": ["duty"]}}),
    "balancer_state": Later(
        lambda context: [[2]],
        believed=("link_geometry", "joint_compliance", "gravity_balancer"),
        arms=("kr30", "irb2400"),
    ),
    "axis_straightness": Later(lambda context: [[3]], arms=("stanford",)),
    # A scale of distance is a scale of all lengths: it shows only where the lengths are known.
    "tracker_scale": Later(_whole, believed=("joint_compliance",)),
    "tracker_angles": Later(_whole),
    "station": Later(_whole, {"setups": {"stations": 2}}),
    "nest": Later(_whole, {"setups": {"nests": 3}}),
}

_SIXTY = {"poses": 60, "repeats": {"poses": 2, "times": 3}}
KINDS: dict[str, Kind] = {
    "one_hidden": Kind(),
    "three_hidden": Kind(3),
    "nothing_hidden": Kind(0),
    "outside_catalogue": Kind(source="formulas"),
    "gross_errors": Kind(),
    "sixty_poses": Kind(changes=_SIXTY),
    "noise_x4": Kind(noise=4.0),
    "missing_columns": Kind(),
    "three_at_sixty_poses": Kind(3, changes=_SIXTY),
    "thermal_pair_noise_x4": Kind(2, ("thermal_expansion", "thermal_joint_drift"), noise=4.0),
    "real_nothing": Kind(0, real=True),
    "real_one": Kind(real=True),
    "real_three": Kind(3, real=True),
    "foreign_truth": Kind(source="truths"),
    **{f"later_{name}": Kind(source=(name,), arms=later.arms) for name, later in LATER.items()},
}
