"""Which poses to measure next: optimal design of experiments. `armtrue._core` computes the numbers."""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue import _core
from armtrue.candidates import entry_of, label, model_entry
from armtrue.diagnosis import diagnose
from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.io import Model, Robot
from armtrue.io.dataset import with_joints_mapped
from armtrue.io.files import csv_text
from armtrue.progress import Progress
from armtrue.units import plural
from armtrue.verdicts import of_other_sensors

# ΔBIC that settles a question: "very strong" evidence (Kass and Raftery 1995).
SETTLED = 10.0
# ΔBIC that is "not worth more than a bare mention" (same source).
HARDLY = 2.0
# What poses may vary besides the joints, by the stem of the column, with the option that does so.
_LEVELS = {
    "payload": "payload (armtrue plan with --levels payload=0,8,16 says whether it would)",
    "dir": "approach from both sides (--levels dir=-1,1)",
    "temp_": "temperature",
}
_MOST_RIVALS = 4
# Random poses that add less than this share of the present information give no meaningful ratio.
_LEAST_GAIN = 1e-4
_COORDINATES = 3  # of a measured pose


@dataclass
class Cell:
    """Where the arm may be sent. Points in the robot's base frame [m], angles [rad]; None does not limit.

    box: (low, high) of x, y and z for the tool point. floor: lowest z of joints and tool point. tracker: position of
    the instrument, whose line of sight to the reflector keeps `clearance` from the arm. acceptance: largest angle
    between that line and `opening`, the direction in the tool frame that the reflector faces.
    """

    box: list[tuple[float, float]] | None = None
    floor: float | None = None
    tracker: tuple[float, float, float] | None = None
    clearance: float | None = None
    acceptance: float | None = None
    opening: tuple[float, float, float] | None = None

    def document(self) -> dict[str, Any]:
        """The keys that are given, as the numerical library reads them."""
        return {key: value for key, value in self.__dict__.items() if value is not None}


def _percent(delta_bic: float) -> str:
    """The probability of one of two causes from its BIC minus the other's, if the cause is one of the two."""
    share = 1.0 / (1.0 + math.exp(max(-700.0, min(700.0, delta_bic / 2.0))))
    return "more than 99.9 %" if share > 0.999 else f"{100.0 * share:.{1 if share > 0.99 else 0}f} %"


@dataclass
class Plan:
    """Poses to measure, in the order to run them, and what they are expected to tell.

    columns: q1…qn [rad or m] and whatever else is to be set (payload [kg], dir…, temp_… [°C], time [s]). target: the
    reflector that they are for; None where reflectors have no names.
    figures: of a campaign `unknowns`, `weak` (sentences on unknowns that no pose determines well), `same_numbers` (how
    many parameters act exactly as others do in every pose), `information` (present, planned, random:
    eigenvalues_per_m2, weakest, prediction_rms_um) and `random_poses_per_planned` (the function of that name); of a
    separation `candidates` and `separations` (truth, rival, delta_bic_now, delta_bic_expected,
    delta_bic_expected_random: BIC of truth minus BIC of rival).
    """

    columns: dict[str, NDArray[np.float64]]
    figures: dict[str, Any] = field(default_factory=dict)
    target: str | None = None

    def __repr__(self) -> str:
        sentences = [*self.decisions(), *filter(None, [self.precision()])]
        return "\n".join([f"{plural(self.count, 'pose')} of {', '.join(self.columns)}", *sentences])

    @property
    def count(self) -> int:
        """How many poses there are."""
        return len(next(iter(self.columns.values())))

    def decisions(self) -> list[str]:
        """A sentence for each pair of candidates: how well the poses decide, for the harder case of the two causes."""
        pairs: dict[frozenset[str], list[dict[str, Any]]] = {}
        for entry in self.figures.get("separations", []):
            pairs.setdefault(frozenset((entry["truth"], entry["rival"])), []).append(entry)
        sentences = []
        for entries in pairs.values():
            worst = max(float(entry["delta_bic_expected"]) for entry in entries)
            random = max(float(entry["delta_bic_expected_random"]) for entry in entries)
            known = min(entries, key=lambda entry: float(entry["delta_bic_now"]))
            if known["delta_bic_now"] <= -SETTLED < worst:
                likely, share = known["truth"], _percent(known["delta_bic_now"])
                sentences.append(
                    f"The data decide already between {likely} and {known['rival']}: if the arm has one of the two, "
                    f"it is {likely} with a probability of {share}, which {self._these().lower()} would hardly change; "
                    "armtrue diagnose states whether the arm has either."
                )
                continue
            pair = f"between {entries[0]['truth']} and {entries[0]['rival']}"
            if worst > -HARDLY:
                sentences.append(self._cannot_decide(pair, worst, random))
                continue
            s = "s" if self.count == 1 else ""
            settles = f"decide{s}" if worst <= -SETTLED else f"help{s} to decide"
            sentences.append(
                f"{self._these()} {settles} {pair}: whichever is the cause is expected to reach a probability "
                f"of {_percent(worst)}, with as many random poses {_percent(random)}."
            )
        return sentences

    def _cannot_decide(self, pair: str, worst: float, random: float) -> str:
        """A sentence on a pair that the poses leave undecided, and on what else could decide it."""
        if random <= -HARDLY:
            what_else = f"As many random poses are expected to reach {_percent(random)}: take more."
        else:
            varied = [name for name, values in self.columns.items() if np.ptp(values) > 0.0]
            lacking = [
                words for stem, words in _LEVELS.items() if not any(n.startswith(stem) for n in varied)
            ]
            listed = ", ".join([*lacking, "another station"])
            what_else = f"Quantities that may decide and are not varied in them: {listed}."
        return (
            f"{self._these()} cannot decide {pair}: whichever is the cause is expected to reach a probability "
            f"of {_percent(worst)}, with as many random poses {_percent(random)}. {what_else}"
        )

    def _these(self) -> str:
        return "This pose" if self.count == 1 else f"These {self.count} poses"

    def precision(self) -> str | None:
        """A sentence on how many random poses would predict as well; None for a plan that tells effects apart."""
        if self.separates:
            return None
        ratio = self.figures["random_poses_per_planned"]
        if ratio is None:
            return "As many random poses hardly determine the unknowns: no number of them equals these poses."
        planned = plural(self.count, "planned pose")
        give = "gives" if self.count == 1 else "give"
        random = round(ratio * self.count)
        return f"{planned} {give} the precision of {plural(random, 'random one')}."

    def csv(self) -> str:
        """The poses as a file to run, with ten decimals, and a column `target` where reflectors have names."""
        own = [] if self.target is None else [self.target]
        rows = zip(*self.columns.values(), strict=True)
        cells = [[*(f"{value:.10f}" for value in row), *own] for row in rows]
        return csv_text([*self.columns, *(["target"] if own else [])], cells)

    @property
    def separates(self) -> bool:
        """True where the poses are for telling candidates apart, False where they are for the model's parameters."""
        return "separations" in self.figures


def plan_campaign(
    robot: Robot,
    model: Model,
    poses: int,
    *,
    cell: Cell | None = None,
    levels: Mapping[str, list[float]] | None = None,
    tool: tuple[float, float, float] | None = None,
    candidates: int = 4000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Plan:
    """Choose `poses` poses for a first campaign, D-optimal for the parameters of `model`.

    levels: values that columns besides the joints may take, by column. tool: position of the reflector in the flange
    frame [m] where robot.yaml has no tool; the default is the first of its `tools`. candidates: number of possible
    poses to choose from. Errors: InputError where the model reads a column without levels, the tool is unknown, or
    hardly any pose is within limits and cell.
    """
    options = _options(poses, cell, levels, candidates, seed)
    options["instrument"] = model.instrument
    target = None
    if tool is None and robot.spec.get("tools"):
        target = next(iter(robot.spec["tools"]))
        tool = robot.spec["tools"][target]["xyz"]
    if tool is not None:
        options["tool"] = list(tool)
    specification = {"effects": model.effects, "parameters": model.parameters, "priors": model.priors}
    texts = robot.json(), json.dumps(specification), json.dumps(options)
    try:
        return _plan(lambda: _core.plan_campaign(*texts, progress), target, robot)
    except InputError as error:
        if "column" not in str(error):
            raise
        remedy = "give the values that it may take, such as --levels temp_arm=20,35"
        raise InputError(f"plan: {error}; {remedy}") from None


def plan(
    fit: Fit,
    poses: int,
    *,
    rivals: list[dict[str, Any]] | None = None,
    cell: Cell | None = None,
    levels: Mapping[str, list[float]] | None = None,
    candidates: int = 4000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Plan:
    """Choose the next `poses` poses for `fit`, as `armtrue plan FIT` does.

    `rivals`: two or more entries of model.yaml to tell apart, each an effect that `fit` lacks; None: those that a
    diagnosis leaves undecided. Without any (or with an empty list) the poses are for the fit's own parameters;
    `plan.separates` says which it was. Other arguments and errors as of `plan_campaign`, which is for an arm that was
    not measured yet; a column without levels takes its recorded values.
    """
    if rivals is None:
        left_open = ambiguity(fit, diagnose(fit, progress))
        rivals = left_open.open if left_open else []
    options = json.dumps(_options(poses, cell, levels, candidates, seed))
    # The reflector that poses are planned for: the first of those that the measurements name.
    target = next(map(str, fit.document["data"].get("targets") or []), None)
    if not rivals:
        return _plan(lambda: _core.plan_sharpening(fit.core, options, progress), target, fit.robot)
    wanted = json.dumps(rivals)
    chosen = _plan(
        lambda: _core.plan_separation(fit.core, wanted, options, progress),
        target,
        fit.robot,
        fit.path or "the fit",
    )
    # The library's names do not contain the sensor.
    named = zip(chosen.figures["candidates"], rivals, strict=True)
    names = [name + _sensor_words(fit, rival) for name, rival in named]
    chosen.figures["candidates"] = names
    for (truth, rival), entry in zip(permutations(names, 2), chosen.figures["separations"], strict=True):
        entry["truth"], entry["rival"] = truth, rival
    return chosen


@dataclass(frozen=True)
class Rival:
    """An alternative to the first candidate of a diagnosis.

    candidate: its name in the diagnosis. entry: its entry of model.yaml. delta_bic: BIC with it minus BIC with the
    first, both refitted; positive where the data prefer the first. misfit: delta_bic without its penalty on the number
    of parameters. Both None where it cannot be fitted. table: True if it can follow any error of its joints.
    """

    candidate: str
    entry: dict[str, Any]
    delta_bic: float | None
    misfit: float | None
    table: bool

    @property
    def fits_as_well(self) -> bool:
        """True where the data fit it as well as the first: at most its number of parameters speaks against it."""
        return self.misfit is not None and self.misfit < SETTLED

    @property
    def decided(self) -> bool:
        """True where the data rule it out; a table, which fits anything, also by its number of nodes alone."""
        if self.delta_bic is None:
            return True
        return self.delta_bic >= SETTLED and (self.table or not self.fits_as_well)


@dataclass(frozen=True)
class Ambiguity:
    """The ambiguity set of a diagnosis: its first candidate and those confounded with it, the closest first."""

    candidate: str
    entry: dict[str, Any]
    rivals: list[Rival]

    @property
    def open(self) -> list[dict[str, Any]]:
        """Entries of model.yaml to tell apart: the first candidate and its undecided rivals, four in all at most.

        Tables are not among them, because they can follow any other cause. Empty where no rival is undecided.
        """
        undecided = [rival.entry for rival in self.rivals if not rival.decided and not rival.table]
        return [self.entry, *undecided][:_MOST_RIVALS] if undecided else []

    def figures(self) -> dict[str, Any]:
        """The set as JSON output has it."""
        keys = ("candidate", "delta_bic", "misfit", "decided")
        rivals = [{key: getattr(rival, key) for key in keys} for rival in self.rivals]
        return {"candidate": self.candidate, "rivals": rivals}


def ambiguity(fit: Fit, diagnosis: Mapping[str, Any]) -> Ambiguity | None:
    """The ambiguity set of a diagnosis of `fit`, every member refitted; None where the diagnosis recommends nothing.

    Its members are what the diagnosis gives as `confounded_with` of its first candidate, and the same effect with
    another thermometer where that explains nearly as much. Errors: InputError where the first cannot be fitted.
    """
    candidates = diagnosis.get("candidates", [])
    if diagnosis.get("verdict") != "missing_effect" or not candidates:
        return None
    lead = candidates[0]
    first = model_entry(lead)
    # Candidates that differ only in their sensor have one name; the dict keeps the better one.
    listed = {label(entry): entry for entry in map(model_entry, reversed(candidates))}
    named = [entry_of(called) for called in lead.get("confounded_with", [])]
    others = [model_entry(other) for other in of_other_sensors(lead, candidates)]
    others += [listed.get(label(entry), entry) for entry in named]
    evidence, *found = json.loads(_core.plan_evidence(fit.core, json.dumps([first, *others])))
    if evidence is None:
        raise InputError(
            f"plan: {label(first)} cannot be fitted, expected the diagnosis' first candidate to be"
        )
    tables = {effect["id"] for effect in json.loads(_core.effects()) if effect["generic"]}
    rivals = []
    for entry, figures in zip(others, found, strict=True):
        keys = ("delta_bic", "misfit")
        change, misfit = (figures[key] - evidence[key] if figures else None for key in keys)
        called = label(entry) + _sensor_words(fit, entry)
        rivals.append(Rival(called, entry, change, misfit, entry["effect"] in tables))
    rivals.sort(key=lambda rival: math.inf if rival.delta_bic is None else rival.delta_bic)
    return Ambiguity(label(first) + _sensor_words(fit, first), first, rivals)


def _options(
    poses: int, cell: Cell | None, levels: Mapping[str, list[float]] | None, candidates: int, seed: int
) -> dict[str, Any]:
    return {
        "poses": poses,
        "candidates": candidates,
        "seed": seed,
        "levels": dict(levels or {}),
        **(cell.document() if cell else {}),
    }


def _sensor_words(fit: Fit, entry: Mapping[str, Any]) -> str:
    return f" sensor {entry['sensor']}" if "sensor" in entry and len(fit.robot.sensors) > 1 else ""


def _plan(
    make: Callable[[], str], target: str | None, robot: Robot, fit_file: str | Path = "the fit"
) -> Plan:
    try:
        result = json.loads(make())
    except _core.ModelError as error:
        if found := _IN_THE_FIT.match(str(error)):
            raise InputError(_in_the_fit(found, fit_file)) from None
        if _MEASURED_TORQUE.match(str(error)):
            why = "torques were measured, and for new poses they can only be computed from masses"
            raise InputError(f"plan: {error}; {why}") from None
        raise InputError(str(error)) from None
    columns = result.pop("columns")
    if "information" in result:
        result["random_poses_per_planned"] = random_poses_per_planned(result, len(columns["q1"]))
    chosen = {name: np.array(columns[name]) for name in result.pop("written")}
    # Poses are written in the joint values that the controller reports and accepts; it may couple them.
    reported_from_drives = np.asarray(np.linalg.inv(robot.drives_from_reported), float)
    return Plan(with_joints_mapped(chosen, reported_from_drives), result, target)


def random_poses_per_planned(figures: Mapping[str, Any], poses: int) -> float | None:
    """How many random poses lead to the same error of predictions as one of `poses` planned ones; None where none does.

    figures: of a `Plan`. The inverse of the mean square error is taken to grow equally with each random pose, starting
    from that of the measurements; without measurements, from the fewest poses that determine the unknowns.
    """
    information = figures["information"].items()
    errors = {key: entry and float(entry["prediction_rms_um"]) for key, entry in information}
    first = 0.0 if errors["present"] else float(figures["unknowns"]) / _COORDINATES
    present = errors["present"] ** -2 if errors["present"] else 0.0
    random, planned = (errors[key] ** -2 - present for key in ("random", "planned"))
    if poses <= first or random <= _LEAST_GAIN * present:
        return None
    return float(first + (poses - first) * planned / random) / poses


def _in_the_fit(found: re.Match[str], fit_file: str | Path) -> str:
    """The message for a candidate that is an effect of the fit already."""
    effect, joints = found["effect"], found["joints"]
    only = f" --joints {joints}" if joints else ""
    remove = f"armtrue remove {shlex.quote(str(fit_file))} {effect}{only} --out without.json"
    candidate = f"{effect} {joints}" if joints else effect
    return (
        f"plan: found the candidate {candidate} in {fit_file} already, expected effects that it lacks; to tell it from "
        f"another, plan for the fit without it, as '{remove}' writes it"
    )


_IN_THE_FIT = re.compile(
    r"(?:model: )?found parameter \w+(?:\[(?P<joints>[\d,]+)[^]]*\])?\S* of effect (?P<effect>\w+) twice"
)
_MEASURED_TORQUE = re.compile(r"column tau\d+ ")
