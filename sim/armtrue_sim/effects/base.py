"""Effects of the simulator: functions that turn drawn or given sizes into true terms."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arm import LinkPhysics, Term
from ..errors import ScenarioError
from ..history import History
from ..mechanics.chain import Chain
from ..mechanics.fourbar import FourBar
from ..mechanics.statics import BodyError, gravity_loads
from ..mechanics.transforms import Array
from ..presets import Preset
from ..tracker import TrackerError

ARCSEC = np.pi / 180.0 / 3600.0
DEGREE = np.pi / 180.0
# Metres on a linear axis that stand for a joint error of 1 rad, to apply the literature's angle sizes to it.
PRISMATIC_SIZE = 0.1


def hats(joint: int, nodes: Array) -> list[str]:
    """One expression per node of a piecewise linear curve over `joint` (from 1): 1 there, 0 at its neighbours."""
    at = [float(node) for node in nodes]
    return [
        f"hat(q{joint}, {left!r}, {node!r}, {right!r})"
        for left, node, right in zip([at[0], *at[:-1]], at, [*at[1:], at[-1]], strict=True)
    ]


@dataclass(frozen=True)
class EffectContext:
    """Data of the arm that an effect may use."""

    robot: dict[str, Any]
    chain: Chain
    preset: Preset

    def size(self, joint: int) -> float:
        """Factor from an angle's size to the joint's own unit (joint from 1)."""
        return PRISMATIC_SIZE if self.chain.prismatic[joint - 1] else 1.0

    def unit(self, joint: int) -> str:
        """rad or m (joint from 1)."""
        return "m" if self.chain.prismatic[joint - 1] else "rad"

    def parallel_pairs(self) -> list[list[int]]:
        """Neighbouring revolute joints whose axes are parallel, as [deflected, loaded]."""
        chain = self.chain
        along = [chain.fixed[k].rotation[:, 2] for k in range(chain.n)]
        return [
            [k, k + 1]
            for k in range(1, chain.n)
            if abs(along[k][2]) > 1.0 - 1e-9 and not chain.prismatic[k - 1] and not chain.prismatic[k]
        ]

    def sensor_variable(self, sensor: str | None) -> str:
        """State variable of a temperature sensor; None: the first."""
        sensors = self.robot.get("temperature", {}).get("sensors", [])
        if sensor is None:
            return "dT"
        if sensor not in sensors:
            raise ScenarioError(f"sensor '{sensor}' is none of the robot's sensors {sensors}")
        return f"dT_{sensor}"


@dataclass
class EffectTruth:
    """Errors that one entry of a scenario adds to the real arm and its instrument."""

    terms: list[Term] = field(default_factory=list)
    linkage: FourBar | None = None
    body: BodyError = field(default_factory=BodyError)
    tracker: TrackerError = field(default_factory=TrackerError)
    histories: list[History] = field(default_factory=list)
    physics: list[LinkPhysics] = field(default_factory=list)

    def __add__(self, other: EffectTruth) -> EffectTruth:
        return EffectTruth(
            self.terms + other.terms,
            other.linkage or self.linkage,
            self.body + other.body,
            self.tracker + other.tracker,
            self.histories + other.histories,
            self.physics + other.physics,
        )

    def scaled(self, factor: float) -> EffectTruth:
        """The same effect, `factor` times as large."""
        return EffectTruth(
            [replace(term, value=factor * term.value) for term in self.terms],
            self.linkage.scaled(factor) if self.linkage else None,
            self.body.scaled(factor),
            self.tracker.scaled(factor),
            self.histories,
            [physics.scaled(factor) for physics in self.physics],
        )


class Sizes:
    """Sizes of one effect: each is given by the scenario, else drawn from its realistic range.

    Every draw is made, used or not, so that giving one value does not change the others.
    """

    def __init__(
        self, given: Mapping[str, Any], rng: np.random.Generator, joints: Sequence[int], where: str
    ) -> None:
        self.given = dict(given)
        self.rng = rng
        self._joints = list(joints)
        self._where = where
        self._asked: set[str] = set()

    def value(self, name: str, drawn: float, joint: int | None = None) -> float:
        """Given value of `name` (a number, or a list in the order of the joints), else `drawn`."""
        self._asked.add(name)
        if name not in self.given:
            return float(drawn)
        given = self.given[name]
        try:
            if isinstance(given, list | tuple):
                return float(given[self._joints.index(joint)] if joint is not None else given[0])
            return float(given)
        except (TypeError, ValueError, IndexError):
            raise ScenarioError(
                f"{self._where}: '{name}' is {given!r}, expected a number or one number a joint"
            ) from None

    def option(self, name: str, default: Any) -> Any:
        """Given value of any type."""
        self._asked.add(name)
        return self.given.get(name, default)

    def signed(self, low: float, high: float) -> float:
        """Uniform magnitude in [low, high] with a random sign."""
        return float(self.rng.uniform(low, high) * self.rng.choice([-1.0, 1.0]))

    def refuse_unasked(self) -> None:
        """Raises ScenarioError for a given size that the effect does not know."""
        unknown = sorted(set(self.given) - self._asked)
        if unknown:
            raise ScenarioError(
                f"{self._where}: unknown key '{unknown[0]}', expected {', '.join(sorted(self._asked))}"
            )


def full_torque(context: EffectContext, joint: int) -> float:
    """Largest gravity torque (Nm) on a motor (joint from 1) over many poses with the largest payload; at least 1."""
    chain = context.chain
    q = np.random.default_rng(0).uniform(chain.limits[:, 0], chain.limits[:, 1], (256, chain.n))
    frames = chain.frames(chain.link_variables(q))
    load = np.full(len(q), max(context.preset.payloads))
    torque = gravity_loads(chain, frames, load, frames.flange_origin).motor_torque[:, joint - 1]
    return max(float(np.abs(torque).max()), 1.0)


def joint_pairs(effect_name: str, joints: list[int]) -> list[tuple[int, int]]:
    """[a, b, c, d] as pairs (a, b), (c, d). Raises ScenarioError if `joints` are no pairs of different joints."""
    pairs = list(zip(joints[::2], joints[1::2], strict=False))
    if not joints or len(joints) % 2 or any(first == second for first, second in pairs):
        raise ScenarioError(
            f"{effect_name}: joints {joints}, expected pairs of different joints, as [driven, driving]"
        )
    return pairs


# Gives the true terms, or all errors where they are more than terms.
Build = Callable[[EffectContext, list[int], Sizes], EffectTruth | Iterator[Term]]


@dataclass(frozen=True)
class EffectRule:
    """One effect id: its build function and its default joints (empty: an effect without joints)."""

    build: Build
    joints: Callable[[EffectContext], list[int]]


EFFECTS: dict[str, EffectRule] = {}


def every_joint(context: EffectContext) -> list[int]:
    """All joints, from 1."""
    return list(range(1, context.chain.n + 1))


def driven_joints(context: EffectContext) -> list[int]:
    """All joints that have a motor, from 1."""
    return [k for k in every_joint(context) if not context.chain.passive[k - 1]]


def no_joint(context: EffectContext) -> list[int]:
    """For effects without joints."""
    return []


def compliant_joints(context: EffectContext) -> list[int]:
    """Joints whose torsion matters most; 2 and 3 on a six-axis arm (contract.md)."""
    return list(context.preset.compliant)


def effect(name: str, joints: Callable[[EffectContext], list[int]]) -> Callable[[Build], Build]:
    """Registers the decorated function as the effect `name`."""

    def register(build: Build) -> Build:
        EFFECTS[name] = EffectRule(build, joints)
        return build

    return register


def default_joints(name: str, context: EffectContext) -> list[int]:
    """Joints of the effect if none are named."""
    return EFFECTS[name].joints(context)


def build_effect(
    name: str,
    joints: Sequence[int] | None,
    given: Mapping[str, Any],
    context: EffectContext,
    seed: int,
    where: str,
) -> EffectTruth:
    """True terms of one scenario entry.

    joints from 1, None: the default. given: sizes that are not drawn; `scale`: a factor on all sizes. Only `seed` and
    the entry decide the draws, so that adding one effect to a scenario does not change the others. Raises
    ScenarioError.
    """
    if name not in EFFECTS:
        raise ScenarioError(f"{where}: unknown effect '{name}', expected one of {', '.join(sorted(EFFECTS))}")
    chosen = list(joints) if joints is not None else default_joints(name, context)
    for joint in chosen:
        if not isinstance(joint, int) or not 1 <= joint <= context.chain.n:
            raise ScenarioError(
                f"{where}: joint {joint!r} of '{name}' is not between 1 and {context.chain.n}"
            )
    tag = str(given.get("name", ""))
    rng = np.random.default_rng([seed, zlib.crc32(f"{name} {chosen} {tag}".encode())])
    sizes = Sizes(given, rng, chosen, f"{where}: {name}")
    factor = sizes.value("scale", 1.0)
    built = EFFECTS[name].build(context, chosen, sizes)
    truth = built if isinstance(built, EffectTruth) else EffectTruth(list(built))
    sizes.refuse_unasked()
    return truth if factor == 1.0 else truth.scaled(factor)
