"""Which poses to measure next: optimal design of experiments. The numbers are made in `armtrue._core`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue import _core
from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.io import Model, Robot
from armtrue.progress import Progress

# ΔBIC that settles a question: "very strong" evidence (Kass and Raftery 1995).
SETTLED = 10.0
_MOST_RIVALS = 4


@dataclass
class Cell:
    """Where the arm may be sent. Points in the robot's base frame [m], angles [rad]; None does not limit.

    box: (low, high) of x, y and z that the tool point keeps to. floor: lowest z of joints and tool point. tracker: from
    here the line to the reflector is `clearance` away from the arm. acceptance: largest angle between that line and
    `opening`, where the reflector looks in the tool frame.
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


@dataclass
class Plan:
    """Poses to measure, in the order to run them, and what they are expected to tell.

    columns: q1…qn [rad or m] and whatever else is to be set (payload [kg], dir…, temp_… [°C], time [s]).
    figures: of a campaign `unknowns`, `weak` (sentences: what no pose can tell well), `same_numbers` (parameters that
    are another's whatever the pose), `information` (present, planned, random: eigenvalues_per_m2, weakest,
    prediction_rms_um) and `random_poses_per_planned`; of a separation `candidates` and `separations` (truth, rival,
    delta_bic_now, delta_bic_expected, delta_bic_expected_random: BIC of truth less rival's).
    """

    columns: dict[str, NDArray[np.float64]]
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """How many poses there are."""
        return len(next(iter(self.columns.values())))

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

    levels: values that columns besides the joints may take, by column. tool: the reflector in the flange [m] where
    robot.yaml has no tool. candidates: possible poses to choose from. Errors: InputError where the model reads a column
    without levels, the tool is unknown, or hardly any pose is within limits and cell.
    """
    options = _options(poses, cell, levels, candidates, seed)
    options["instrument"] = model.instrument
    if tool is not None:
        options["tool"] = list(tool)
    specification = {"effects": model.effects, "parameters": model.parameters, "priors": model.priors}
    return _plan(
        lambda: _core.plan_campaign(robot.json(), json.dumps(specification), json.dumps(options), progress)
    )


def plan_sharpening(
    fit: Fit,
    poses: int,
    *,
    cell: Cell | None = None,
    levels: Mapping[str, list[float]] | None = None,
    candidates: int = 4000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Plan:
    """Choose `poses` further poses for the parameters of `fit`, given what its measurements know already.

    Arguments and errors as of `plan_campaign`; levels that are not given are as recorded.
    """
    options = json.dumps(_options(poses, cell, levels, candidates, seed))
    return _plan(lambda: _core.plan_sharpening(fit.core, options, progress))


def plan_separation(
    fit: Fit,
    rivals: list[dict[str, Any]],
    poses: int,
    *,
    cell: Cell | None = None,
    levels: Mapping[str, list[float]] | None = None,
    candidates: int = 4000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Plan:
    """Choose `poses` poses that tell `rivals` apart: entries of model.yaml, each an effect that `fit` lacks.

    Arguments as of `plan_sharpening`. Errors: InputError for fewer than two rivals, or where one cannot be fitted.
    """
    options = json.dumps(_options(poses, cell, levels, candidates, seed))
    return _plan(lambda: _core.plan_separation(fit.core, json.dumps(rivals), options, progress))


def ambiguity(diagnosis: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What a diagnosis leaves open, as entries of model.yaml: its first candidate and the rivals not yet ruled out.

    Rivals are confounded with the first and within a ΔBIC of 10 of it. At most four in all; tables are left out, as
    they can follow any rival on their joint. Empty where the diagnosis misses nothing or the first stands alone.
    """
    tables = {effect["id"] for effect in json.loads(_core.effects()) if effect["generic"]}
    candidates = diagnosis.get("candidates", [])
    if diagnosis.get("verdict") != "missing_effect" or not candidates:
        return []
    lead = candidates[0]
    confounded = set(lead.get("confounded_with", []))
    others = [
        entry
        for entry in candidates[1:]
        if _label(entry) in confounded
        and entry["effect"] not in tables
        and entry["delta_bic"] < lead["delta_bic"] + SETTLED
    ]
    return [_entry(candidate) for candidate in [lead, *others][:_MOST_RIVALS]] if others else []


def _label(candidate: Mapping[str, Any]) -> str:
    """A candidate as `confounded_with` names it: effect, joints, and the orders of a gear."""
    text = str(candidate["effect"])
    if candidate["joints"]:
        text += " " + ",".join(map(str, candidate["joints"]))
    for key in ("cycles", "orders"):
        if key in candidate.get("options", {}):
            text += f" {key} {json.dumps(candidate['options'][key], separators=(',', ':'))}"
    return text


def _entry(candidate: Mapping[str, Any]) -> dict[str, Any]:
    entry: dict[str, Any] = {"effect": candidate["effect"], **candidate.get("options", {})}
    if candidate["joints"]:
        entry["joints"] = list(candidate["joints"])
    return entry


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


def _plan(make: Callable[[], str]) -> Plan:
    try:
        result = json.loads(make())
    except _core.ModelError as error:
        raise InputError(str(error)) from None
    columns = result.pop("columns")
    return Plan({name: np.array(columns[name]) for name in result.pop("written")}, result)
