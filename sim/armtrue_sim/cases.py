"""Random cases for the hidden-effect tests: campaigns of which it is known what their model lacks.

Every hidden effect is large enough to be found in principle: it moves the tool by at least three times the noise, and
what a geometric fit with the believed effects leaves of it is at least the noise (RMS over the poses, decision 0022).
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arm import Arm, Term
from .build import build_arm
from .campaign import Campaign, measure, simulate
from .errors import ScenarioError
from .expression import variables
from .foreign import foreign_effects
from .presets import PRESETS, nominal_robot
from .scenario import Scenario
from .sensitivity import geometry_terms, orthonormal_range, sensitivity, unexplained, unit_term
from .transforms import Array

KINDS = (
    "one_hidden",
    "three_hidden",
    "nothing_hidden",
    "outside_catalogue",
    "gross_errors",
    "sixty_poses",
    "noise_x4",
    "missing_columns",
)
ARMS = ("kr30", "irb2400", "cobot", "lbr")
TRACKER_SIGMA = 8e-6  # metres an axis
DRIVE_SIGMA = 2.5e-6  # radians
RAW_FACTOR, VISIBLE_FACTOR = 3.0, 1.0
# Effects that a warming, creeping session makes look alike; one case holds at most one of them.
SESSION_EFFECTS = frozenset(
    {"thermal_expansion", "thermal_joint_drift", "thermal_base", "warm_up", "time_drift"}
)
# No real effect is made larger than this many times what was drawn from its realistic range.
LARGEST_SCALE = 3.0
MOST_DRAWS = 60
# Columns that a case withholds, and the effects that then cannot be told.
_WITHHELD: tuple[tuple[tuple[str, ...], frozenset[str]], ...] = (
    (("dir",), frozenset({"backlash"})),
    (("temp_arm",), SESSION_EFFECTS),
    (("time",), frozenset({"time_drift", "warm_up"})),
    (("payload",), frozenset()),
    (("temp_arm", "dir", "time"), SESSION_EFFECTS | {"backlash"}),
)


@dataclass(frozen=True)
class HiddenEffect:
    """What a model lacks. joints from 1, as the contract's candidates name them; RMS displacements over the poses, m.

    visible_rms is what a fit of everything else leaves of raw_rms. For an effect of no catalogue `variables` are the
    state variables that it depends on; else it is empty.
    """

    effect: str
    joints: tuple[int, ...]
    raw_rms: float
    visible_rms: float
    variables: tuple[str, ...] = ()


@dataclass(frozen=True)
class HiddenCase:
    """A campaign in memory and what its model lacks. untestable: hidden effects whose column the case withholds."""

    kind: str
    arm: str
    seed: int
    campaign: Campaign
    hidden: tuple[HiddenEffect, ...]
    untestable: tuple[str, ...] = ()

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
        """model.yaml of an owner who knows what is hidden."""
        return self.campaign.true_model


def hidden_cases(kind: str, arm: str, seed: int) -> HiddenCase:
    """One seeded case. kind: one of KINDS; arm: one of ARMS (any preset works). Raises ScenarioError on another."""
    if kind not in KINDS:
        raise ScenarioError(f"kind of case is '{kind}', expected one of {', '.join(KINDS)}")
    if arm not in PRESETS:
        raise ScenarioError(f"arm is '{arm}', expected one of {', '.join(PRESETS)}")
    rng = np.random.default_rng([seed, zlib.crc32(f"{kind} {arm}".encode())])
    plan: dict[str, Any] = {
        "name": f"{kind}-{arm}-{seed}",
        "arm": arm,
        "seed": int(rng.integers(2**31)),
        "instrument": {"sigma": TRACKER_SIGMA * (4.0 if kind == "noise_x4" else 1.0)},
        "repeatability": {"drive": DRIVE_SIGMA},
        "believed": [
            *("base_frame", "tool_offset", "joint_offset", "link_geometry"),
            {"effect": "joint_compliance", "joints": list(PRESETS[arm].compliant)},
        ],
    }
    if kind == "sixty_poses":
        plan |= {"poses": 60, "repeats": {"poses": 2, "times": 3}}
    if kind == "gross_errors":
        plan["gross_errors"] = {"count": int(rng.integers(3, 9)), "size": [4e-4, 5e-3]}
    if kind == "nothing_hidden":
        return HiddenCase(kind, arm, seed, simulate(plan), ())
    wanted = 3 if kind == "three_hidden" else 1
    for _ in range(MOST_DRAWS):
        entries, changes, untestable = _draw(kind, arm, wanted, rng)
        sized = _sized(plan | changes, entries, rng)
        if sized is None:
            continue
        campaign = simulate(plan | changes | {"hidden": [entry for entry, _, _ in sized]})
        hidden = tuple(
            HiddenEffect(h["effect"], tuple(h["joints"]), raw, visible, _variables(entry))
            for h, (entry, raw, visible) in zip(campaign.hidden, sized, strict=True)
        )
        return HiddenCase(kind, arm, seed, campaign, hidden, untestable)
    raise ScenarioError(f"case {plan['name']}: no effect of realistic size is visible in {MOST_DRAWS} draws")


def _variables(entry: dict[str, Any]) -> tuple[str, ...]:
    return tuple(sorted(variables(entry["expression"]))) if entry["effect"] == "custom" else ()


def catalogue_choices(arm: str) -> dict[str, list[list[int]]]:
    """Effects that can hide in an arm, each with the joints to choose from."""
    preset = PRESETS[arm]
    robot = nominal_robot(arm)
    n = len(robot["kinematics"]["joints"])
    # The last axis carries the reflector at a lever of some centimetres: little of its errors reaches the tool.
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
    # Joints beyond the believed ones whose axes gravity loads: the wrist.
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


def _draw(kind: str, arm: str, wanted: int, rng: np.random.Generator) -> Drawn:
    """Entries to hide, changes to the plan that their measurement needs, and effects that the case makes untestable."""
    if kind == "outside_catalogue":
        shapes = foreign_effects(arm, rng)
        return [shapes[rng.integers(len(shapes))]], {}, ()
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
        # Effects that name no joints take none; the balancer and the linkage know theirs.
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
    """Entries scaled until each can be seen, with raw and visible RMS (m); None where that takes an unreal size."""
    noise = np.sqrt(3.0) * TRACKER_SIGMA
    scenario = Scenario.from_dict(plan)
    bare = build_arm(scenario)
    campaign = measure(scenario, bare)
    columns = campaign.data | campaign.unrecorded
    q, reference = campaign.q, bare.true_position(campaign.q, columns)
    believed = [unit_term(t.coordinate, t.expression) for t in bare.terms if t.effect == "joint_compliance"]
    geometry = sensitivity(bare, q, columns, geometry_terms(bare) + believed)
    arms = [build_arm(Scenario.from_dict(plan | {"hidden": [entry]})) for entry in entries]
    own = [sensitivity(bare, q, columns, _own_terms(arm, bare)) for arm in arms]
    sized = []
    for i, (entry, arm) in enumerate(zip(entries, arms, strict=True)):
        others = [columns_of for j, columns_of in enumerate(own) if j != i]
        basis = orthonormal_range(np.hstack([geometry, *others]))
        moved = arm.true_position(q, columns) - reference
        raw, visible = _rms(moved), _rms(unexplained(moved, basis))
        needed = max(RAW_FACTOR * noise / raw, VISIBLE_FACTOR * noise / visible)
        if needed > LARGEST_SCALE:
            return None
        scale = needed * float(rng.uniform(1.0, 1.3)) if needed > 1.0 else 1.0
        sized.append(({**entry, "scale": scale}, scale * raw, scale * visible))
    return sized


def _own_terms(arm: Arm, bare: Arm) -> list[Term]:
    """What the arm has beyond the bare one, as unit terms; the linkage by its first order."""
    known = set(bare.terms)
    terms = [unit_term(t.coordinate, t.expression) for t in arm.terms if t not in known]
    if arm.linkage is not None and bare.linkage is None:
        beta = f"({arm.linkage.angle!r} + q3 - q2)"
        terms += [unit_term("link3.rz", text.replace("beta", beta)) for text in arm.linkage.first_order()]
    return terms


def _rms(displacement: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(displacement**2, axis=1))))
