"""Kinds of hidden-effect cases: the hidden effects, the circumstances, and the columns needed to find them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from .effects.base import EffectContext

ARMS = ("kr30", "irb2400", "cobot", "lbr")
# Errors of robot.yaml for every real arm: masses 20 % and centres 15 mm off, the base 3 mrad out of level.
UNLIKE_ITS_FILE = ("mass_parameters", "gravity_direction")
# A joint that repeats badly beside others at 2.5 urad.
BAD_REPEATABILITY = 2.5e-5


@dataclass(frozen=True)
class Kind:
    """hidden: number of effects; source: where they are drawn from, `catalogue`, `formulas` and `truths` (foreign/), or
    effect ids. changes: to the scenario. real: the arm differs from its file and one joint repeats badly. noise: factor
    on the tracker's. way: how the effect of `source` is hidden, if not as those of the catalogue."""

    hidden: int = 1
    source: str | tuple[str, ...] = "catalogue"
    changes: Mapping[str, Any] = field(default_factory=dict)
    noise: float = 1.0
    real: bool = False
    arms: tuple[str, ...] = ARMS
    way: Hiding | None = None


@dataclass(frozen=True)
class Hiding:
    """How a campaign hides an effect.

    joints: sets of joints of an arm that it may act on, of which the seed draws one. changes: to the scenario, so that
    the measurements can show it. arms: presets that can have it.
    believed: effects of model.yaml beside base, tool and joint zeros; without: joint that it leaves out of an effect.
    sizes: those that are not drawn. share: part of every joint's travel, about its middle, that the poses use.
    """

    joints: Callable[[EffectContext], list[list[int]]]
    changes: Mapping[str, Any] = field(default_factory=dict)
    believed: tuple[str, ...] = ("link_geometry", "joint_compliance")
    arms: tuple[str, ...] = ARMS
    sizes: Mapping[str, float] = field(default_factory=dict)
    without: Mapping[str, int] = field(default_factory=dict)
    share: float | None = None


def _whole(context: EffectContext) -> list[list[int]]:
    return [[]]


def _early(context: EffectContext) -> list[list[int]]:
    return [[k] for k in range(1, 5)]


def _wrist(context: EffectContext) -> list[list[int]]:
    return [list(pair) for pair in context.preset.wrist_pairs]


# One uninterrupted session shows no cause that is slower than it, hence sensors that swing, pauses, several set-ups.
LATER: dict[str, Hiding] = {
    "mass_parameters": Hiding(_whole),
    # A gear with only a soft zone: 0.2 mrad about zero load, as lost motion of half a minute of arc.
    "stiffness_nonlinear": Hiding(
        lambda context: [[k] for k in context.preset.compliant[:2]],
        sizes={"square": 0.0, "cube": 0.0, "soft": 2e-4},
    ),
    # The tilt of a mobile platform; with springs at joints 2 and 3 alone, 3 mrad is within the noise.
    "gravity_direction": Hiding(_whole, arms=("kr30", "cobot", "lbr"), sizes={"tilt": 0.01}),
    "axis_wobble": Hiding(_early),
    "cross_compliance": Hiding(EffectContext.parallel_pairs, arms=("kr30", "irb2400", "cobot")),
    "hysteresis": Hiding(_early, {"directions": "order", "columns": {"add": ["travel"]}}),
    "coupling_harmonics": Hiding(_wrist, arms=("kr30", "irb2400", "cobot")),
    "thermal_gradient": Hiding(
        lambda context: [[2], [3]], {"sensors": ["arm", "top", "bottom"], "temperature": {"wave": 2.0}}
    ),
    "self_heating": Hiding(_early, {"rests": {"count": 3, "seconds": 3000.0}, "columns": {"add": ["duty"]}}),
    "balancer_state": Hiding(
        lambda context: [[2]],
        believed=("link_geometry", "joint_compliance", "gravity_balancer"),
        arms=("kr30", "irb2400"),
    ),
    "axis_straightness": Hiding(lambda context: [[3]], arms=("stanford",)),
    # A scale error of distance equals a scale error of all lengths: it is visible only if the lengths are known.
    "tracker_scale": Hiding(_whole, believed=("joint_compliance",)),
    "tracker_angles": Hiding(_whole),
    "station": Hiding(_whole, {"setups": {"stations": 2}}),
    "nest": Hiding(_whole, {"setups": {"nests": 3}}),
}

_FEW = {"poses": 60, "repeats": {"poses": 2, "times": 3}}
KINDS: dict[str, Kind] = {
    "one_hidden": Kind(),
    "three_hidden": Kind(3),
    "nothing_hidden": Kind(0),
    "outside_catalogue": Kind(source="formulas"),
    "gross_errors": Kind(),
    "sixty_poses": Kind(changes=_FEW),
    "noise_x4": Kind(noise=4.0),
    "missing_columns": Kind(),
    "three_at_sixty_poses": Kind(3, changes=_FEW),
    "thermal_pair_noise_x4": Kind(2, ("thermal_expansion", "thermal_joint_drift"), noise=4.0),
    "real_nothing": Kind(0, real=True),
    "real_one": Kind(real=True),
    "real_three": Kind(3, real=True),
    "foreign_truth": Kind(source="truths"),
    **{f"later_{name}": Kind(source=(name,), arms=later.arms, way=later) for name, later in LATER.items()},
}


@dataclass(frozen=True)
class Suspect:
    """One cause of a pair. An effect without `joints` acts on the whole arm."""

    effect: str
    joints: tuple[int, ...] = ()
    sizes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """`effect joints`."""
        return f"{self.effect} {','.join(map(str, self.joints))}".strip()


@dataclass(frozen=True)
class Pair:
    """Two causes with similar effects, a session that cannot tell them apart, and one that can (None: there is none).

    open, decides: changes to the scenario of the one and the other session; lacks, measurement: the same in words.
    share: part of the travel used in the first session. believed, without: as in Hiding.
    """

    suspects: tuple[Suspect, Suspect]
    open: Mapping[str, Any]
    lacks: str
    decides: Mapping[str, Any] | None
    measurement: str
    share: float | None = None
    believed: tuple[str, ...] = Hiding.believed
    without: Mapping[str, int] = field(default_factory=dict)
    arms: tuple[str, ...] = ("kr30", "cobot")

    def kind(self, hidden: int, decides: bool) -> str:
        """Name of the kind of case that hides suspect `hidden` (0 or 1)."""
        one, other = (self.suspects[k].words.replace(" ", "_") for k in (hidden, 1 - hidden))
        return f"{'decided' if decides else 'open'}_{one}_or_{other}"

    def kinds(self) -> dict[str, Kind]:
        """Kinds by name: each of the two suspects hidden, in each of the two sessions."""
        found = {}
        for decides, changes in ((False, self.open), (True, self.decides)):
            for hidden, suspect in enumerate(self.suspects):
                way = Hiding(
                    lambda context, joints=list(suspect.joints): [joints],
                    changes or {},
                    self.believed,
                    self.arms,
                    suspect.sizes,
                    self.without,
                    None if decides else self.share,
                )
                if changes is not None:
                    found[self.kind(hidden, decides)] = Kind(
                        source=(suspect.effect,), arms=self.arms, way=way
                    )
        return found


_UNLOADED = {**_FEW, "payloads": [0.0]}
_LOADED = "three payloads, the whole travel, 240 poses"
# One morning: the temperature rises with the time constant of the warm-up.
_MORNING = {"temperature": {"time_constant": 2000.0, "jitter": 0.05}}
_WARM_UP = Suspect("warm_up", sizes={"tau": 2000.0})
_RETURN = {**_MORNING, "rests": {"count": 3, "seconds": 8000.0, "cold": True}}
# One day in which the hall's temperature rises nearly linearly with time, and three such days.
_DAY = {
    "interval": 600.0,
    "poses": 120,
    "temperature": {"rise": 30.0, "time_constant": 2.5e5, "jitter": 0.05},
}
_DAYS = {**_DAY, "rests": {"count": 2, "seconds": 3e4, "cold": True}}
# docs/planning.md, "Causes that look alike"; results of the diagnosis: docs/effects.md.
PAIRS = (
    Pair(
        (Suspect("joint_compliance", (2,)), Suspect("gear_harmonics", (2,))),
        _UNLOADED,
        "one payload, 60 poses in a third of the travel",
        {},
        _LOADED,
        share=0.3,
        without={"joint_compliance": 2},
    ),
    Pair(
        (Suspect("mass_parameters"), Suspect("bending_compliance", (2,))),
        _UNLOADED,
        "one payload, 60 poses",
        {},
        _LOADED,
    ),
    Pair(
        (Suspect("gravity_direction", sizes={"tilt": 0.01}), Suspect("bending_compliance", (1,))),
        _UNLOADED,
        "one payload, 60 poses",
        {},
        _LOADED,
        arms=("kr30", "lbr"),
    ),
    Pair(
        (
            Suspect("base_compliance", sizes={"cx": 1e-7, "cy": 1e-7}),
            Suspect("bending_compliance", (1,), {"cx": 2.5e-7, "cy": 2.5e-7}),
        ),
        _UNLOADED,
        "one payload, 60 poses in half of the travel",
        {},
        _LOADED,
        share=0.5,
        arms=("kr30", "irb2400"),
    ),
    Pair(
        (
            Suspect("bending_compliance", (1,), {"cx": 6e-6, "cy": 6e-6}),
            Suspect("bending_compliance", (2,), {"cx": 6e-6, "cy": 6e-6}),
        ),
        {},
        "nothing on link 1 is measured; axes 1 and 2 meet",
        None,
        "",
        arms=("cobot", "lbr"),
    ),
    Pair(
        (Suspect("cross_compliance", (2, 3)), Suspect("joint_compliance", (3,))),
        _UNLOADED,
        "one payload, 60 poses in a third of the travel",
        {},
        _LOADED,
        share=0.3,
        without={"joint_compliance": 3},
    ),
    Pair(
        (Suspect("thermal_expansion"), _WARM_UP),
        _MORNING,
        "one warming morning",
        _RETURN,
        "rest, cool and return",
    ),
    Pair(
        (Suspect("thermal_joint_drift", (2,)), _WARM_UP),
        _MORNING,
        "one warming morning",
        _RETURN,
        "rest, cool and return",
    ),
    Pair(
        (Suspect("self_heating", (2,)), _WARM_UP),
        {"columns": {"add": ["duty"]}},
        "one warming morning",
        {"columns": {"add": ["duty"]}, "rests": {"count": 3, "seconds": 3000.0}},
        "three rests",
    ),
    Pair(
        (Suspect("thermal_base"), Suspect("time_drift")),
        _DAY,
        "one day in which the hall warms",
        _DAYS,
        "three days, the hall cold each morning",
    ),
    Pair(
        (Suspect("time_drift"), Suspect("station")),
        {"interval": 300.0, "setups": {"stations": 2}, "columns": {"omit": ["station"]}},
        "without column `station`",
        {"interval": 300.0, "setups": {"stations": 2}},
        "column `station`",
    ),
    Pair(
        (Suspect("backlash", (2,)), Suspect("joint_scale", (2,))),
        {"directions": "order", "columns": {"omit": ["dir"]}},
        "without columns `dir1…`",
        {"directions": "order"},
        "columns `dir1…`",
    ),
    Pair(
        (Suspect("backlash", (2,)), Suspect("joint_offset", (2,))),
        {"directions": "up"},
        "one approach",
        {},
        "both approaches",
        believed=("joint_compliance",),
        without={"joint_offset": 2},
    ),
    Pair(
        (Suspect("hysteresis", (2,)), Suspect("backlash", (2,))),
        {"directions": "order", "columns": {"add": ["travel"]}},
        "long ways to every pose",
        {"columns": {"add": ["travel"]}},
        "short and long ways",
    ),
    Pair(
        (Suspect("axis_wobble", (2,)), Suspect("gear_harmonics", (2,))),
        _FEW,
        "one reflector, 60 poses in half of the travel",
        {"targets": {"names": ["A", "B", "C"]}, **_FEW},
        "three reflectors, the whole travel",
        share=0.5,
    ),
    Pair(
        (Suspect("tracker_angles"), Suspect("gear_harmonics", (1,))),
        _FEW,
        "60 poses in a third of the travel",
        {},
        "joint 1 through its travel, 240 poses",
        share=0.3,
    ),
)
PAIR_KINDS = {name: kind for pair in PAIRS for name, kind in pair.kinds().items()}
