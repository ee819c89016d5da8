"""Random cases for the hidden-effect tests: campaigns whose models lack known effects.

Every hidden effect is large enough to be found in principle: it moves the tool by at least three times the noise, and
at least the noise remains of it after a geometric fit with the believed effects (RMS over the poses, decision 0021).
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .arm import Arm, Term
from .build import build_arm, context_of
from .campaign import Campaign, measure, simulate
from .errors import ScenarioError
from .foreign import TRUTHS, foreign_effects
from .kinds import BAD_REPEATABILITY, KINDS, PAIR_KINDS, UNLIKE_ITS_FILE, Kind
from .mechanics.expression import variables
from .mechanics.statics import BodyError
from .mechanics.transforms import Array
from .presets import PRESETS, nominal_robot
from .scenario import Scenario
from .sensitivity import geometry_terms, orthonormal_range, rms, sensitivity, unexplained, unit_term

TRACKER_SIGMA = 8e-6  # metres an axis
DRIVE_SIGMA = 2.5e-6  # radians
RAW_FACTOR, VISIBLE_FACTOR = 3.0, 1.0
# Effects that look alike in a session with warming and drift; a case has at most one of them.
SESSION_EFFECTS = frozenset(
    {"thermal_expansion", "thermal_joint_drift", "thermal_base", "warm_up", "time_drift"}
)
# Largest factor by which an effect may exceed the size drawn from its realistic range.
LARGEST_SCALE = 3.0
MOST_DRAWS = 60
# Columns that a case omits, and the effects that cannot be identified without them.
_WITHHELD: tuple[tuple[tuple[str, ...], frozenset[str]], ...] = (
    (("dir",), frozenset({"backlash"})),
    (("temp_arm",), SESSION_EFFECTS),
    (("time",), frozenset({"time_drift", "warm_up"})),
    (("payload",), frozenset()),
    (("temp_arm", "dir", "time"), SESSION_EFFECTS | {"backlash"}),
)


@dataclass(frozen=True)
class HiddenEffect:
    """An effect that a model lacks. joints from 1, as in the contract's candidates; RMS displacements over poses, m.

    visible_rms is the part of raw_rms that remains after a fit of everything else. variables: state variables of an
    effect outside the catalogue, else empty.
    """

    effect: str
    joints: tuple[int, ...]
    raw_rms: float
    visible_rms: float
    variables: tuple[str, ...] = ()


@dataclass(frozen=True)
class HiddenCase:
    """A campaign in memory and the effects that its model lacks. untestable: hidden effects whose column is omitted.

    accepted: effects that the arm has too, so that a diagnosis may name them. For a foreign truth, `causes` and
    `variables` (foreign/) are the right answers.
    """

    kind: str
    arm: str
    seed: int
    campaign: Campaign
    hidden: tuple[HiddenEffect, ...]
    untestable: tuple[str, ...] = ()
    accepted: tuple[str, ...] = ()
    causes: frozenset[str] = frozenset()
    variables: frozenset[str] = frozenset()

    @property
    def believed(self) -> list[Any]:
        """Effects of model.yaml."""
        return list(self.campaign.model["effects"])

    @property
    def pairs(self) -> list[tuple[str, list[int]]]:
        """(effect, joints) of everything hidden."""
        return [(h.effect, list(h.joints)) for h in self.hidden]

    @property
    def true_model(self) -> dict[str, Any]:
        """model.yaml with the hidden effects added."""
        return self.campaign.true_model


def hidden_cases(
    kind: str, arm: str, seed: int, statics: str = "deflected", variant: int | None = None
) -> HiddenCase:
    """One seeded case. kind: one of KINDS or PAIR_KINDS; arm: any preset; statics, variant: as in a scenario.

    Raises ScenarioError on another kind or arm, or if no effect of realistic size is visible in MOST_DRAWS draws.
    """
    if kind not in KINDS and kind not in PAIR_KINDS:
        raise ScenarioError(f"kind of case is '{kind}', expected one of {', '.join(KINDS)}")
    if arm not in PRESETS:
        raise ScenarioError(f"arm is '{arm}', expected one of {', '.join(PRESETS)}")
    given = KINDS.get(kind) or PAIR_KINDS[kind]
    rng = np.random.default_rng([seed, zlib.crc32(f"{kind} {arm}".encode())])
    plan = _plan(kind, given, arm, seed, rng) | {"statics": statics, "variant": variant}
    accepted = UNLIKE_ITS_FILE if given.real else ()
    if not given.hidden:
        return HiddenCase(kind, arm, seed, simulate(plan), (), accepted=accepted)
    for _ in range(MOST_DRAWS):
        entries, changes, untestable = _draw(kind, given, arm, rng)
        sized = _sized(plan | changes, entries, rng)
        if sized is None:
            if isinstance(given.source, tuple):
                # With one effect on few joints, only another arm of the kind gives other sizes.
                plan["seed"] = int(rng.integers(2**31))
            continue
        campaign = simulate(plan | changes | {"hidden": [entry for entry, _, _ in sized]})
        hidden = tuple(
            HiddenEffect(h["effect"], tuple(h["joints"]), raw, visible, _variables(entry))
            for h, (entry, raw, visible) in zip(campaign.hidden, sized, strict=True)
        )
        causes, variables_of = (
            _right_answers(hidden) if given.source == "truths" else (frozenset(), frozenset())
        )
        return HiddenCase(kind, arm, seed, campaign, hidden, untestable, accepted, causes, variables_of)
    raise ScenarioError(f"case {plan['name']}: no effect of realistic size is visible in {MOST_DRAWS} draws")


def _right_answers(hidden: tuple[HiddenEffect, ...]) -> tuple[frozenset[str], frozenset[str]]:
    truth, joints = TRUTHS[hidden[0].effect], hidden[0].joints
    joint = joints[0] if joints else 0
    return truth.causes(joint), truth.variables(joint)


def _plan(kind: str, given: Kind, arm: str, seed: int, rng: np.random.Generator) -> dict[str, Any]:
    """The scenario of a case without its hidden effects."""
    plan: dict[str, Any] = {
        "name": f"{kind}-{arm}-{seed}",
        "arm": arm,
        "seed": int(rng.integers(2**31)),
        "instrument": {"sigma": TRACKER_SIGMA * given.noise},
        "repeatability": {"drive": DRIVE_SIGMA},
        "believed": [
            *("base_frame", "tool_offset", "joint_offset", "link_geometry"),
            {"effect": "joint_compliance", "joints": list(PRESETS[arm].compliant)},
        ],
        **given.changes,
    }
    if kind == "gross_errors":
        plan["gross_errors"] = {"count": int(rng.integers(3, 9)), "size": [4e-4, 5e-3]}
    if given.real:
        plan["unlike"] = list(UNLIKE_ITS_FILE)
        bad = int(rng.integers(1, 1 + min(5, len(PRESETS[arm].torsion))))
        plan["repeatability"] = {"drive": DRIVE_SIGMA, "joints": {bad: BAD_REPEATABILITY}}
    way = given.way
    if way is None:
        return plan
    context = context_of(Scenario(arm=arm))
    every = list(range(1, context.chain.n + 1))
    plan["believed"] = ["base_frame", "tool_offset"]
    for name in ("joint_offset", *way.believed):
        joints = list(PRESETS[arm].compliant) if name == "joint_compliance" else every
        left = [k for k in joints if k != way.without.get(name)]
        is_plain = left == every or name not in ("joint_compliance", *way.without)
        plan["believed"].append(name if is_plain else {"effect": name, "joints": left})
    if way.share is not None:
        low, high = context.chain.limits.T
        middle, half = (low + high) / 2.0, way.share * (high - low) / 2.0
        plan["joint_range"] = [[float(m - h), float(m + h)] for m, h in zip(middle, half, strict=True)]
    return plan | dict(way.changes)


def _variables(entry: dict[str, Any]) -> tuple[str, ...]:
    return tuple(sorted(variables(entry["expression"]))) if entry["effect"] == "custom" else ()


def catalogue_choices(arm: str) -> dict[str, list[list[int]]]:
    """Effects that can hide in an arm, each with the joints to choose from."""
    preset = PRESETS[arm]
    robot = nominal_robot(arm)
    n = len(robot["kinematics"]["joints"])
    # Not the last joint: the reflector is only some centimetres from its axis, so its errors move the tool little.
    singles = [[k] for k in range(1, n)]
    loaded = [[k] for k in preset.compliant[:2]]
    choices: dict[str, list[list[int]]] = {
        "joint_scale": singles,
        "stiffness_nonlinear": loaded,
        "bending_compliance": [[k] for k in range(1, min(n, 4) + 1)],
        "base_compliance": [[]],
        "gear_harmonics": singles,
        "gear_mesh": singles,
        "transmission_pwl": singles,
        "backlash": singles,
        "thermal_expansion": [list(range(1, n + 1))],
        "thermal_joint_drift": singles,
        "thermal_base": [[]],
        "warm_up": [[]],
        "time_drift": [[]],
        "command_readback": singles[:5],
    }
    # Joints loaded by gravity beside the believed ones: the wrist.
    weak = [[k] for k in range(4, n) if k not in preset.compliant]
    if weak:
        choices["joint_compliance"] = weak
    if preset.wrist_pairs:
        choices["joint_coupling"] = [list(pair) for pair in preset.wrist_pairs]
    if not preset.strain_wave:
        choices["gravity_balancer"] = [[2]]
    if "linkage" in robot:
        choices["parallelogram"] = [[2, 3]]
    return choices


Drawn = tuple[list[dict[str, Any]], dict[str, Any], tuple[str, ...]]


def _draw(kind: str, given: Kind, arm: str, rng: np.random.Generator) -> Drawn:
    """Entries to hide, changes to the plan that their measurement needs, and effects that the case makes untestable."""
    if given.source == "formulas":
        shapes = foreign_effects(arm, rng)
        return [shapes[rng.integers(len(shapes))]], {}, ()
    if given.source == "truths":
        name = str(rng.choice(sorted(TRUTHS)))
        options = TRUTHS[name].choices(arm)
        return [_entry(name, options[rng.integers(len(options))])], dict(TRUTHS[name].plan), ()
    if isinstance(given.source, tuple):
        entries = []
        for name in given.source:
            way = given.way
            options = way.joints(context_of(Scenario(arm=arm))) if way else catalogue_choices(arm)[name]
            joints = options[rng.integers(len(options))]
            sizes = way.sizes if way else {}
            entries.append(_entry(name, [] if name == "thermal_expansion" else joints) | dict(sizes))
        return entries, {}, ()
    return _draw_from_catalogue(kind, arm, given.hidden, rng)


def _entry(name: str, joints: list[int]) -> dict[str, Any]:
    return {"effect": name, "joints": joints} if joints else {"effect": name}


def _draw_from_catalogue(kind: str, arm: str, wanted: int, rng: np.random.Generator) -> Drawn:
    choices = catalogue_choices(arm)
    changes: dict[str, Any] = {}
    untestable: tuple[str, ...] = ()
    names = sorted(choices)
    if kind == "missing_columns":
        omitted, effects = _WITHHELD[rng.integers(len(_WITHHELD))]
        changes["columns"] = {"omit": list(omitted)}
        if "payload" in omitted:
            changes["payloads"] = [0.0]
        if rng.random() < 0.3 and "backlash" in effects:
            names, untestable = ["backlash"], ("backlash",)
        else:
            names = [name for name in names if name not in effects]
    picked: list[str] = []
    while len(picked) < wanted:
        name = str(rng.choice(names))
        clash = name in picked or (name in SESSION_EFFECTS and SESSION_EFFECTS & set(picked))
        if not clash:
            picked.append(name)
    entries = []
    for name in picked:
        options = choices[name]
        entry: dict[str, Any] = {"effect": name}
        joints = options[rng.integers(len(options))]
        # Effects of the whole arm get no joints; the linkage and the expansion take their default joints.
        if joints and name not in ("parallelogram", "thermal_expansion"):
            entry["joints"] = joints
        if name == "transmission_pwl":
            entry["shape"] = str(rng.choice(["table", "bump"]))
        entries.append(entry)
    if "time_drift" in picked:
        changes["interval"] = 300.0
    if "warm_up" in picked:
        changes["temperature"] = {"rise": 0.5}
    if "command_readback" in picked:
        changes["columns"] = {**changes.get("columns", {}), "add": ["qr"]}
    return entries, changes, untestable


def _sized(
    plan: dict[str, Any], entries: list[dict[str, Any]], rng: np.random.Generator
) -> list[tuple[dict[str, Any], float, float]] | None:
    """Entries scaled until each is visible, with raw and visible RMS (m); None if that needs an unrealistic size."""
    noise = np.sqrt(3.0) * TRACKER_SIGMA
    scenario = Scenario.from_dict(plan)
    bare = build_arm(scenario)
    campaign = measure(scenario, bare)
    columns = campaign.data | campaign.unrecorded
    q, reference = campaign.q, _seen(bare, campaign.q, columns)
    known = _known_columns(bare, plan, q, columns)
    arms = [build_arm(Scenario.from_dict(plan | {"hidden": [entry]})) for entry in entries]
    moves = [_seen(arm, q, columns) - reference for arm in arms]
    own = [_own_columns(arm, bare, q, columns, move) for arm, move in zip(arms, moves, strict=True)]
    sized = []
    for i, (entry, moved) in enumerate(zip(entries, moves, strict=True)):
        others = [columns_of for j, columns_of in enumerate(own) if j != i]
        basis = orthonormal_range(np.hstack([known, *others]))
        raw, visible = rms(moved), rms(unexplained(moved, basis))
        needed = max(RAW_FACTOR * noise / raw, VISIBLE_FACTOR * noise / visible)
        if needed > LARGEST_SCALE:
            return None
        scale = needed * float(rng.uniform(1.0, 1.3)) if needed > 1.0 else 1.0
        sized.append(({**entry, "scale": float(scale)}, float(scale * raw), float(scale * visible)))
    return sized


def _seen(arm: Arm, q: Array, columns: dict[str, Array]) -> Array:
    """Tool positions (N, 3) as the instrument sees them, without noise; the history states are those of `arm`."""
    table = columns | {history.column: history.along(q, columns["time"]) for history in arm.histories}
    rotation, position = arm.true_pose(q, table)
    return arm.tracker.as_seen(position, rotation, table, np.zeros(3))


def _known_columns(bare: Arm, plan: dict[str, Any], q: Array, columns: dict[str, Array]) -> Array:
    """Sensitivities of the believed model's parameters and, if the arm differs from its file, of its weights."""
    entries = [{"effect": e} if isinstance(e, str) else e for e in plan["believed"]]
    every = range(1, bare.chain.n + 1)
    joints = {e["effect"]: e.get("joints", every) for e in entries}
    held = {f"motor{k}" for k in joints["joint_offset"]} | {"base", "tool"}
    held |= {f"link{k}" for k in joints.get("link_geometry", ())}
    geometry = [t for t in geometry_terms(bare) if t.coordinate.partition(".")[0] in held]
    shape = ("joint_offset", "link_geometry")
    believed = [unit_term(t.coordinate, t.expression) for t in bare.terms if t.effect not in shape]
    known = sensitivity(bare, q, columns, geometry + believed)
    return np.hstack([known, _weight_columns(bare, q, columns)]) if "unlike" in plan else known


def _weight_columns(arm: Arm, q: Array, columns: dict[str, Array]) -> Array:
    """Displacements by an error of each mass (1 %), centre (1 mm) and tilt of gravity (1 mrad), by differences."""
    errors = [BodyError(tilt=1e-3 * axis) for axis in np.eye(3)[:2]]
    errors += [BodyError(payload_centre=1e-3 * axis) for axis in np.eye(3)]
    for k, link in enumerate(arm.heavy.links):
        errors.append(BodyError(mass={k: 0.01 * link.mass}))
        errors += [BodyError(centre={k: 1e-3 * axis}) for axis in np.eye(3)]
    reference = _seen(arm, q, columns)
    moved = [_seen(replace(arm, body=arm.body + error), q, columns) - reference for error in errors]
    return np.stack([m.ravel() for m in moved], axis=1)


def _own_columns(arm: Arm, bare: Arm, q: Array, columns: dict[str, Array], moved: Array) -> Array:
    """Sensitivities of the coefficients of an arm's effect, and the displacement by the whole effect."""
    terms = _own_terms(arm, bare)
    whole = moved.reshape(-1, 1)
    if not terms:
        return whole
    table = columns | {history.column: history.along(q, columns["time"]) for history in arm.histories}
    return np.hstack([sensitivity(arm, q, table, terms), whole])


def _own_terms(arm: Arm, bare: Arm) -> list[Term]:
    """Terms of the arm that the bare one lacks, as unit terms; the linkage by its first order."""
    known = set(bare.terms)
    terms = [unit_term(t.coordinate, t.expression) for t in arm.terms if t not in known]
    if arm.linkage is not None and bare.linkage is None:
        beta = f"({arm.linkage.angle!r} + q3 - q2)"
        terms += [unit_term("link3.rz", text.replace("beta", beta)) for text in arm.linkage.first_order()]
    return terms
