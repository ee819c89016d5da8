"""Runs hidden-effect cases: refines a model that lacks effects, and judges the result against the hidden ones."""

from __future__ import annotations

import copy
import csv
import itertools
import json
import re
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from armtrue_sim.campaign import Campaign
from armtrue_sim.cases import HiddenCase, hidden_cases
from by_command import Ran, knows, run
from coefficients import deviations
from numpy.typing import NDArray

# Smallest probability of a candidate that counts as reported possible.
WORTH_NAMING = 0.05
# Smallest probability of a last candidate that counts as perhaps missing; some have half of it on any arm.
STAYS_OPEN = 0.1
# Smallest probability that counts as a statement of fact.
SURELY = 0.9
# The 95 % point of chi-squared with three degrees of freedom.
CHI2_3_95 = 7.815

# Effects that act on the whole arm: their joints are not part of their name.
WHOLE_ARM = frozenset(
    {
        *("base_compliance", "thermal_base", "warm_up", "time_drift"),
        *("parallelogram", "gravity_balancer", "thermal_expansion", "balancer_state"),
        *("mass_parameters", "gravity_direction", "tracker_scale", "tracker_angles", "station", "nest"),
    }
)


def named(effect: str, joints: list[int] | tuple[int, ...]) -> list[str]:
    """One word `effect joint` for each joint or pair of joints; the effect alone if it acts on the whole arm."""
    if effect in WHOLE_ARM or not joints:
        return [effect]
    if effect in ("joint_coupling", "coupling_harmonics", "cross_compliance"):
        pairs = [list(joints[i : i + 2]) for i in range(0, len(joints), 2)]
        # The order of a symmetric pair has no meaning.
        pairs = [sorted(pair) if effect == "cross_compliance" else pair for pair in pairs]
        return [f"{effect} {','.join(map(str, pair))}" for pair in pairs]
    return [f"{effect} {joint}" for joint in joints]


def effects_named(effects: list[Any]) -> set[str]:
    """All effects of a model as `named` words."""
    words: set[str] = set()
    for entry in effects:
        entry = {"effect": entry} if isinstance(entry, str) else entry
        words.update(named(entry["effect"], entry.get("joints") or []))
    return words


def words_of_label(label: str) -> set[str]:
    """`named` words of a label in `confounded_with`: effect, joints, and perhaps a period."""
    effect, *rest = label.split(" ")
    joints = rest[0].split(",") if rest and rest[0][0].isdigit() else []
    return set(named(effect, [int(joint) for joint in joints]))


@dataclass(frozen=True)
class Settings:
    """How cases are run. limit: seconds after which a command counts as hung; terminal: None means every other seed.

    reference: also fit the true model, for the error's ratio. statics: as in a scenario. variants: every seed has an
    arm of its own. keep: a folder that keeps the files of every case, each in a folder of its own. ratios: gear ratios
    in robot.yaml: known, negative (motors that turn against their joints), none, or wrong by 1 %. masses: of links in
    robot.yaml: known or none.
    """

    limit: float = 300.0
    terminal: bool | None = None
    reference: bool = True
    statics: str = "deflected"
    variants: bool = False
    keep: Path | None = None
    ratios: str = "known"
    masses: str = "known"


@dataclass
class Outcome:
    """Result of one case. Errors are mean distances on fresh exact poses [m]."""

    kind: str
    arm: str
    seed: int
    hidden: set[str]
    first: list[set[str]] = field(default_factory=list)
    ambiguity: list[set[str]] = field(default_factory=list)
    added: set[str] = field(default_factory=set)
    verdict: str = ""
    unexplained: list[dict[str, Any]] = field(default_factory=list)
    error: float = float("nan")
    error_true: float = float("nan")
    seconds: float = float("nan")
    steps: list[str] = field(default_factory=list)
    variables: set[str] = field(default_factory=set)
    joints: set[int] = field(default_factory=set)
    lost: set[str] = field(default_factory=set)
    untestable: bool = False
    accounted: bool = True
    accepted: set[str] = field(default_factory=set)
    causes: set[str] = field(default_factory=set)
    said: list[tuple[float, bool]] = field(default_factory=list)
    open: set[str] = field(default_factory=set)
    held: list[bool] = field(default_factory=list)
    trouble: str = ""
    deviations: dict[str, float] = field(default_factory=dict)
    sure: set[str] = field(default_factory=set)
    stand_ins: set[str] = field(default_factory=set)
    without_column: set[str] = field(default_factory=set)

    def ended(self, ran: Ran) -> Outcome:
        """Record a command that hung or failed, with its last line."""
        limit = f"hang: {ran.seconds:.0f} s, {ran.processor:.1f} s of processor"
        self.trouble = limit if ran.hung else f"status {ran.status}: {ran.said.strip().splitlines()[-1:]}"
        return self

    @property
    def found(self) -> bool:
        """True if all hidden effects are in the final model."""
        return self.hidden <= self.added

    @property
    def extras(self) -> set[str]:
        """Effects that were added but are not in the arm."""
        return self.added - self.hidden - self.accepted

    @property
    def surely_false(self) -> set[str]:
        """Effects that are not in the arm but were added with SURELY or more, or without a probability."""
        return (self.extras - self.causes) & self.sure

    @property
    def covered(self) -> bool:
        """True if the leading candidate or one that it is confounded with is a hidden effect."""
        return any(words & self.hidden for words in [*self.first[:1], *self.ambiguity])

    @property
    def error_ratio(self) -> float:
        """Error divided by that of the fit of the true effects."""
        return self.error / self.error_true if self.error_true > 0 else float("nan")


def verdict_of(outcome: Outcome) -> str:
    """`right`, or what is wrong: hang, failed, missed, extra, lost, not accounted for, false alarm and the like."""
    if outcome.trouble:
        return "hang" if outcome.trouble.startswith("hang") else "failed"
    if not outcome.accounted:
        return "not accounted for"
    if outcome.kind == "outside_catalogue":
        return verdict_outside(outcome)
    if outcome.causes:
        return verdict_foreign(outcome)
    if outcome.kind == "thermal_pair_noise_x4" and one_of_the_readings(outcome):
        return "right"
    if not outcome.found:
        return "missed"
    if outcome.extras:
        return "extra"
    if outcome.lost:
        return "lost"
    return "right" if outcome.verdict == "nothing_missing" or outcome.untestable else "false alarm"


def verdict_outside(outcome: Outcome) -> str:
    """Verdict on a formula that no effect has: the leading finding must name one of its variables and joints."""
    if outcome.added:
        return "explained away"
    named_right = any(
        outcome.variables & set(found["variables"]) and outcome.joints & set(found["joints"])
        for found in outcome.unexplained[:1]
    )
    return "right" if outcome.verdict == "unexplained_structure" and named_right else "unnamed"


def verdict_foreign(outcome: Outcome) -> str:
    """Verdict on a truth whose form no effect has: a cause must be added, or a finding name one of its variables."""
    if outcome.added - outcome.causes - outcome.accepted:
        return "extra"
    depends = {variable for found in outcome.unexplained for variable in variables_found(found)}
    return "right" if outcome.added & outcome.causes or depends & outcome.variables else "unnamed"


def variables_found(found: dict[str, Any]) -> set[str]:
    """Variables of a finding: `variable` in the contract, `variables` today."""
    return {*found.get("variables", []), *([found["variable"]] if "variable" in found else [])}


def one_of_the_readings(outcome: Outcome) -> bool:
    """True if warm_up was added for heat that noise hides, and all hidden effects are reported possible."""
    return outcome.added <= outcome.hidden | {"warm_up"} and outcome.hidden <= outcome.added | outcome.open


def accounted_for(steps: list[dict[str, Any]]) -> bool:
    """True if each step's effects are those of the step before, plus its stated addition, minus its stated removals."""

    def words(entry: dict[str, Any] | str) -> set[str]:
        # Entries for one link and for the whole arm may be in the model together for some steps.
        if isinstance(entry, dict) and entry["effect"] == "thermal_expansion":
            return {f"thermal_expansion {entry.get('joints')}"}
        return effects_named([entry])

    for before, after in itertools.pairwise(steps):
        # One name may have two entries: harmonics of two orders that were added one after the other.
        effects = Counter(name for entry in before["effects"] for name in words(entry))
        effects.update(words(after["added"]) if after["added"] else ())
        effects.subtract(name for removed in after["removed"] for name in words(removed))
        if set(+effects) != set().union(*map(words, after["effects"])):
            return False
    return True


def run_case(kind: str, arm: str, seed: int, settings: Settings | None = None) -> Outcome:
    """Simulate, fit the believed model, refine, and compare with the fit of the true model."""
    settings = settings or Settings()
    case = hidden_cases(kind, arm, seed, settings.statics, seed if settings.variants else None)
    case.campaign.robot = with_ratios(case.campaign.robot, settings.ratios)
    if settings.masses == "none":
        case.campaign.robot.pop("links", None)
    if settings.keep is not None:
        return _judged(case, settings.keep / f"{kind}-{arm}-{seed}", settings)
    with tempfile.TemporaryDirectory(prefix="armtrue-hidden-") as folder:
        return _judged(case, Path(folder), settings)


def _judged(case: HiddenCase, folder: Path, settings: Settings) -> Outcome:
    case.campaign.write(folder)
    # Both uses are covered: on a terminal, which shows progress, and in a script, which does not.
    terminal = settings.terminal if settings.terminal is not None else case.seed % 2 == 1
    outcome = Outcome(case.kind, case.arm, case.seed, hidden_words(case), accepted=set(case.accepted))
    outcome.causes, outcome.variables = set(case.causes), set(case.variables) or variables_of(case)
    outcome.joints, outcome.untestable = joints_of(case), bool(case.untestable)
    fitted = _fitted(folder, "model.yaml", "fit.json", settings)
    if fitted.status != 0:
        return outcome.ended(fitted)
    refined = run(
        [
            "refine",
            str(folder / "fit.json"),
            "--out",
            str(folder / "best.json"),
            "--json",
            str(folder / "out.json"),
        ],
        settings.limit,
        terminal,
    )
    outcome.seconds = refined.seconds
    if refined.status != 0:
        return outcome.ended(refined)
    read_refinement(outcome, json.loads((folder / "out.json").read_text()))
    outcome.deviations = deviations(json.loads((folder / "best.json").read_text()), case.campaign)
    outcome.error, outcome.held = fresh_error(case, folder, "best.json", settings)
    if settings.reference:
        (folder / "true.yaml").write_text(yaml.safe_dump(known_to_the_model(case.true_model)))
        (folder / "weighed.yaml").write_text(yaml.safe_dump(weighed_robot(case)))
        if _fitted(folder, "true.yaml", "true.json", settings, "weighed.yaml").status == 0:
            outcome.error_true = fresh_error(case, folder, "true.json", settings)[0]
    return outcome


def with_ratios(robot: dict[str, Any], ratios: str) -> dict[str, Any]:
    """robot.yaml without gear ratios, with ratios wrong by 1 %, or with those of motors that turn the other way."""
    robot = copy.deepcopy(robot)
    factor = {"known": 1.0, "negative": -1.0, "none": 0.0, "wrong": 1.01}[ratios]
    for joint in robot["kinematics"]["joints"]:
        if ratio := factor * joint.pop("gear_ratio", 0.0):
            joint["gear_ratio"] = ratio
    return robot


def weighed_robot(case: HiddenCase) -> dict[str, Any]:
    """robot.yaml with the true masses, gravity and payload centre, as if the owner had measured them."""
    robot, truth = dict(case.campaign.robot), case.campaign.truth
    if not case.accepted:
        return robot
    # Every arm of a case is in Craig's convention: its flange is the last link's frame.
    centre = [a + b for a, b in zip(robot["tool"]["xyz"], truth["payload_centre"], strict=True)]
    return robot | {"links": truth["links"], "gravity": truth["gravity"], "payload": {"com": centre}}


def _fitted(folder: Path, model: str, out: str, settings: Settings, robot: str = "robot.yaml") -> Ran:
    """`armtrue fit`; a column that the case withholds makes it end with status 2."""
    files = [str(folder / name) for name in ("data.csv", robot, model, out)]
    return run(["fit", files[0], "--robot", files[1], "--model", files[2], "--out", files[3]], settings.limit)


def read_refinement(outcome: Outcome, document: dict[str, Any]) -> None:
    """Read refine's JSON into the outcome."""
    steps = document["steps"]
    before, after = effects_named(steps[0]["effects"]), effects_named(document["effects"])
    candidates = steps[0]["candidates"]
    outcome.first = [set(named(c["effect"], c["joints"])) for c in candidates[:3]]
    lead = candidates[0]["confounded_with"] if candidates else []
    outcome.ambiguity = [words_of_label(str(label)) for label in lead]
    outcome.added, outcome.lost = after - before, before - after
    outcome.verdict, outcome.unexplained = steps[-1]["verdict"], steps[-1]["unexplained"]
    outcome.steps, outcome.accounted = [step_words(step) for step in steps], accounted_for(steps)
    outcome.said = said_of(outcome, document)
    outcome.sure = {
        word
        for entry in document["effects"]
        if isinstance(entry, dict) and entry.get("probability", 1.0) >= SURELY
        for word in effects_named([entry])
    }
    outcome.stand_ins = stand_ins_of(steps)
    outcome.without_column = {entry["effect"] for entry in steps[-1]["untestable"]}
    outcome.open = {
        word
        for step in steps
        for c in step["candidates"]
        if c.get("probability", 0.0) >= WORTH_NAMING
        for word in named(c["effect"], c["joints"])
    } | {
        word
        for step in steps
        for c in step["candidates"]
        for w in c["confounded_with"]
        for word in words_of_label(str(w))
    }


def stand_ins_of(steps: list[dict[str, Any]]) -> set[str]:
    """`named` words of alternatives to the leading and the added candidates, and of those perhaps still missing."""
    labels = [label for c in steps[0]["candidates"][:1] for label in c["confounded_with"]]
    labels += [label for step in steps if step["added"] for label in step["added"]["confounded_with"]]
    return {word for label in labels for word in words_of_label(str(label))} | {
        word
        for c in steps[-1]["candidates"]
        if c.get("probability", 0.0) >= STAYS_OPEN
        for word in named(c["effect"], c["joints"])
    }


def said_of(outcome: Outcome, document: dict[str, Any]) -> list[tuple[float, bool]]:
    """(stated probability, whether it is true) of added effects, of the last candidates, and of nothing missing."""
    there = outcome.hidden | outcome.accepted | outcome.causes
    # A truth whose form no effect has may have several names: one of them in the model is enough.
    named_already = outcome.causes if outcome.causes & outcome.added else set()
    last = document["steps"][-1]
    # An added joint may be in one entry with joints of the initial model.
    said = [
        (float(entry["probability"]), effects_named([entry]) & outcome.added <= there)
        for entry in document["effects"]
        if isinstance(entry, dict) and "probability" in entry
    ]
    for entry in last["candidates"]:
        if entry.get("probability") is not None:
            words = set(named(entry["effect"], entry.get("joints") or []))
            # A candidate that is in the model already is not missing.
            missing = not words <= outcome.added | named_already
            said.append((float(entry["probability"]), words <= there and missing))
    if last.get("probability_nothing") is not None:
        complete = bool(outcome.causes & outcome.added) if outcome.causes else outcome.found
        said.append((float(last["probability_nothing"]), complete))
    return said


def fresh_error(case: HiddenCase, folder: Path, fit: str, settings: Settings) -> tuple[float, list[bool]]:
    """Mean distance [m] of prediction and exact position on the test poses; whether each lies in its 95 % region."""
    asked = ["--uncertainty"] if knows("predict", "--uncertainty") else []
    names = (str(folder / name) for name in (fit, "test.csv", "predicted.csv"))
    fit_file, test, out = names
    ran = run(["predict", fit_file, test, "--out", out, *asked], settings.limit)
    if ran.status != 0:
        return float("nan"), []
    distances, held = misses(Path(out), case.campaign)
    return float(distances.mean()), held


def misses(predicted: Path, campaign: Campaign) -> tuple[NDArray[np.float64], list[bool]]:
    """Distance [m] of each prediction from the exact pose; whether that is in the 95 % region (with --uncertainty)."""
    with predicted.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    off = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
    off -= np.stack([campaign.test[axis] for axis in "xyz"], axis=1)
    held = []
    for row, error in zip(rows, off, strict=True):
        if "cxx" in row:
            xx, xy, xz, yy, yz, zz = (float(row[f"c{c}"]) for c in ("xx", "xy", "xz", "yy", "yz", "zz"))
            covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            held.append(bool(error @ np.linalg.solve(covariance, error) <= CHI2_3_95))
    return np.linalg.norm(off, axis=1), held


def hidden_words(case: HiddenCase) -> set[str]:
    """`named` words of the effects to be found, without those whose column the case withholds."""
    words = {word for effect, joints in case.pairs for word in named(effect, joints)}
    return {word for word in words if not word.startswith(case.untestable or ("nothing",))}


def variables_of(case: HiddenCase) -> set[str]:
    """State variables that hidden formulas read."""
    return {variable.replace("temp_", "dT_") for h in case.hidden for variable in h.variables}


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
    """A true model without the keys that state the size of an effect, which only the simulator reads."""
    sizes = ("scale", "shape", "tilt")
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
