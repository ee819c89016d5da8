"""Runs hidden-effect cases: a campaign whose model lacks something, refined, and judged against what was hidden."""

from __future__ import annotations

import itertools
import json
import re
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from armtrue import _core
from armtrue_sim.cases import HiddenCase, hidden_cases

# Effects that act on the whole arm: their joints are not part of their name.
WHOLE_ARM = frozenset(
    {
        *("base_compliance", "thermal_base", "warm_up", "time_drift"),
        *("parallelogram", "gravity_balancer", "thermal_expansion"),
    }
)


def named(effect: str, joints: list[int] | tuple[int, ...]) -> list[str]:
    """Effect and joint as one word each, joint by joint where it acts joint by joint."""
    if effect in WHOLE_ARM or not joints:
        return [effect]
    if effect == "joint_coupling":
        return [f"{effect} {','.join(map(str, joints[i : i + 2]))}" for i in range(0, len(joints), 2)]
    return [f"{effect} {joint}" for joint in joints]


def effects_named(effects: list[Any]) -> set[str]:
    """All effects of a model as `named` words."""
    words: set[str] = set()
    for entry in effects:
        entry = {"effect": entry} if isinstance(entry, str) else entry
        words.update(named(entry["effect"], entry.get("joints") or []))
    return words


def words_of_label(label: str) -> set[str]:
    """`named` words of a candidate as `confounded_with` has it: effect, joints, and perhaps a period."""
    effect, *rest = label.split(" ")
    joints = rest[0].split(",") if rest and rest[0][0].isdigit() else []
    return set(named(effect, [int(joint) for joint in joints]))


@dataclass
class Outcome:
    """What became of one case. Errors are mean distances on fresh exact poses [m]."""

    kind: str
    arm: str
    seed: int
    hidden: set[str]
    first: list[set[str]]
    ambiguity: list[set[str]]
    added: set[str]
    verdict: str
    unexplained: list[dict[str, Any]]
    error: float
    error_true: float
    seconds: float
    steps: list[str] = field(default_factory=list)
    variables: set[str] = field(default_factory=set)
    joints: set[int] = field(default_factory=set)
    lost: set[str] = field(default_factory=set)
    untestable: bool = False
    accounted: bool = True

    @property
    def found(self) -> bool:
        """All that was hidden is in the final model."""
        return self.hidden <= self.added

    @property
    def extras(self) -> set[str]:
        """What was added though it was not hidden."""
        return self.added - self.hidden

    @property
    def covered(self) -> bool:
        """The leading candidate or one that it could be taken for is among what was hidden."""
        return any(words & self.hidden for words in [*self.first[:1], *self.ambiguity])

    @property
    def error_ratio(self) -> float:
        """Error over that of the fit that was handed the true effects."""
        return self.error / self.error_true if self.error_true > 0 else float("nan")


def verdict_of(outcome: Outcome) -> str:
    """`right`, or what is wrong: missed, extra, lost, not accounted for, false alarm, explained away, unnamed."""
    if not outcome.accounted:
        return "not accounted for"
    if outcome.kind == "outside_catalogue":
        if outcome.added:
            return "explained away"
        # The leading finding alone: a variable that it depends on, and a joint that it acts on or depends on.
        leading = outcome.unexplained[:1]
        named_right = any(
            outcome.variables & set(found["variables"]) and outcome.joints & set(found["joints"])
            for found in leading
        )
        return "right" if outcome.verdict == "unexplained_structure" and named_right else "unnamed"
    if not outcome.found:
        return "missed"
    if outcome.extras:
        return "extra"
    if outcome.lost:
        return "lost"
    return "right" if outcome.verdict == "nothing_missing" or outcome.untestable else "false alarm"


def accounted_for(steps: list[dict[str, Any]]) -> bool:
    """True where each step's effects are those before it, and what it says it added, less what it says it removed."""

    def words(entry: dict[str, Any] | str) -> set[str]:
        # On one link and on the whole arm it may stand side by side for a while.
        if isinstance(entry, dict) and entry["effect"] == "thermal_expansion":
            return {f"thermal_expansion {entry.get('joints')}"}
        return effects_named([entry])

    for before, after in itertools.pairwise(steps):
        effects = set().union(*map(words, before["effects"]))
        if after["added"]:
            effects |= words(after["added"])
        for removed in after["removed"]:
            effects -= words(removed)
        if effects != set().union(*map(words, after["effects"])):
            return False
    return True


def fresh_error(core: Any, case: HiddenCase, robot: str) -> float:
    """Mean distance [m] between prediction and the exact positions of the test poses."""
    document = {**json.loads(core.document()), "robot": json.loads(robot)}
    test = {
        name: np.ascontiguousarray(values, dtype=float)
        for name, values in case.campaign.test.items()
        if name != "target"
    }
    predicted = np.asarray(_core.predict(json.dumps(document), test))
    exact = np.stack([case.campaign.test[axis] for axis in "xyz"], axis=1)
    return float(np.linalg.norm(predicted - exact, axis=1).mean())


def run_case(kind: str, arm: str, seed: int) -> Outcome:
    """Simulate, fit what is believed, refine, and compare with the fit that was handed the truth."""
    case = hidden_cases(kind, arm, seed)
    robot = json.dumps(case.campaign.robot)
    columns = {name: np.ascontiguousarray(values, dtype=float) for name, values in case.campaign.data.items()}
    started = time.perf_counter()
    fit = _core.fit(robot, columns, json.dumps({"effects": case.believed}))
    refined, text = _core.refine(fit)
    seconds = time.perf_counter() - started
    steps = json.loads(text)["steps"]
    before = effects_named(steps[0]["effects"])
    words = [named(c["effect"], c["joints"]) for c in steps[0]["candidates"]]
    lead = steps[0]["candidates"][0] if steps[0]["candidates"] else {"confounded_with": []}
    hidden = {word for effect, joints in case.pairs for word in named(effect, joints)}
    try:
        error_true = fresh_error(
            _core.fit(robot, columns, json.dumps(known_to_the_model(case.true_model))), case, robot
        )
    except ValueError:  # what was hidden needs a column that the case withholds
        error_true = float("nan")
    return Outcome(
        kind=kind,
        arm=arm,
        seed=seed,
        hidden={word for word in hidden if not word.startswith(case.untestable or ("nothing",))},
        first=[set(w) for w in words[:3]],
        ambiguity=[words_of_label(str(c)) for c in lead["confounded_with"]],
        added=effects_named(steps[-1]["effects"]) - before,
        verdict=steps[-1]["verdict"],
        unexplained=steps[-1]["unexplained"],
        error=fresh_error(refined, case, robot),
        error_true=error_true,
        seconds=seconds,
        steps=[step_words(step) for step in steps],
        lost=before - effects_named(steps[-1]["effects"]),
        untestable=bool(case.untestable),
        accounted=accounted_for(steps),
        joints=joints_of(case),
        variables={variable.replace("temp_", "dT_") for h in case.hidden for variable in h.variables},
    )


def joints_of(case: HiddenCase) -> set[int]:
    """Joints that hidden effects depend on or act on."""
    joints = {joint for h in case.hidden for joint in h.joints}
    for effect in case.true_model["effects"]:
        if isinstance(effect, dict) and (
            acts_on := re.fullmatch(r"(?:motor|link)(\d+).*", effect.get("coordinate", ""))
        ):
            joints.add(int(acts_on[1]))
    return joints


def known_to_the_model(model: dict[str, Any]) -> dict[str, Any]:
    """A true model without the keys that say how large an effect is: those are for the simulator."""
    sizes = ("scale", "shape")
    effects = [
        e if isinstance(e, str) else {k: v for k, v in e.items() if k not in sizes} for e in model["effects"]
    ]
    return {"effects": effects}


def step_words(step: dict[str, Any]) -> str:
    """`+ effect joints − effect joints` of one step."""
    added = step["added"]
    words = [f"+ {added['effect']} {added['joints']}"] if added else []
    words += [f"- {removed['effect']} {removed['joints']}" for removed in step["removed"]]
    return " ".join(words) or "as it stood"
