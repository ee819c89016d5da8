"""Limits of the data: joints and columns that hardly vary, and parameters that a fit of geometry cannot determine."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

import numpy as np

from armtrue.arrays import rms_length
from armtrue.checking import directions
from armtrue.checking.alignment import evenly
from armtrue.checking.report import Finding
from armtrue.checking.scatter import rounding, sigma
from armtrue.checking.scatter.repeats import repeats_scatter_m
from armtrue.errors import InputError
from armtrue.io.catalogue import with_role
from armtrue.io.dataset import Dataset, with_travels
from armtrue.io.model import Model
from armtrue.io.robot import Robot
from armtrue.verdicts import needs_words

# Enough rows to find parameters that the poses do not separate; more only take time.
_ROWS = 300
# Below this share of its limits a joint leaves much of the workspace unseen.
_SHARE_OF_LIMITS = 0.5
# Phrase of the fitter for pairs that other poses would separate; other pairs are inseparable by any, and no finding.
_OF_THESE_POSES = "by these poses"
_DIRECTION = re.compile(r"dir([0-9]+)")
# Columns that are no cause of errors: joints (their standstill is another finding), measured values and groupings.
_NO_CAUSE = re.compile(r"qr?[0-9]+|q[wxyz]|[xyz]|travel[0-9]+|sigma|repeat|target|station|nest")
_FROM_BOTH_SIDES = "Approach some poses from the other side ('armtrue plan' with --levels dir=-1,1)."
_ONLY_THE_SUM = "Measure poses that differ more, or accept that only the sum of the two is known."
_OTHER_VALUES = "Measure some poses at another value if you suspect an effect that depends on it."


def find(data: Dataset, robot: Robot) -> list[Finding]:
    """Notes on undetermined parameters, untestable effects, and the share of the joint limits that was covered."""
    return [*_coverage(data, robot), *_never_change(data), *_of_a_fit(data, robot)]


def _never_change(data: Dataset) -> Iterator[Finding]:
    """Notes on recorded columns that carry no information, as they have one value in all rows."""
    other_signs = directions.are_zero_or_one(data)
    for name, values in data.columns.items():
        joint = _DIRECTION.fullmatch(name)
        sides = np.unique(values[values != 0.0]) if joint else np.unique(values)
        if _NO_CAUSE.fullmatch(name) or sides.size != 1 or data.count < 2:
            continue
        if joint and (int(joint[1]) in other_signs or not np.ptp(data.columns[f"q{joint[1]}"])):
            continue
        confused = (
            f"joint {joint[1]} approached all poses from one side, so that its lost motion (backlash, hysteresis) "
            "cannot be distinguished from a shift of its zero"
            if joint
            else "effects that depend on it cannot be distinguished from constant ones such as a joint zero"
        )
        or_none = " or 0" if joint and not values.all() else ""
        yield Finding(
            "never_changes",
            "note",
            f"column {name}: found {sides[0]:g}{or_none} in all rows: {confused}",
            {"columns": [name], "value": float(sides[0])},
            _FROM_BOTH_SIDES if joint else _OTHER_VALUES,
        )


def _of_a_fit(data: Dataset, robot: Robot) -> list[Finding]:
    from armtrue import _core
    from armtrue.fitting import fit

    model = Model([{"effect": effect} for effect in with_role("placement", "geometry")])
    try:
        geometry = fit(with_travels(data).take(evenly(data.count, _ROWS)), robot, model, folds=2)
        untestable = json.loads(_core.untestable(geometry.core))
    except InputError as error:
        return [Finding("no_fit", "warning", f"the geometry cannot be fitted to these data: {error}")]
    pairs = [sentence for sentence in geometry.document["unobservable"] if _OF_THESE_POSES in sentence]
    findings = [Finding("cannot_tell", "note", sentence, {}, _ONLY_THE_SUM) for sentence in pairs]
    repeats_m = repeats_scatter_m(data)
    findings += sigma.find(data, repeats_m, rms_length(geometry.residuals()))
    findings += rounding.find(data, robot, geometry, repeats_m)
    for entry in untestable:
        words = f"{entry['effect']} cannot be tested without {needs_words(entry['needs'])}"
        findings.append(Finding("untestable", "note", words, entry, _way_to_test(entry["needs"])))
    return findings


def _way_to_test(needs: list[str]) -> str:
    """What to do about an effect that needs `needs`; empty where the arm or the model is of another kind."""
    if any(" " not in need or "temp_NAME" in need for need in needs):
        return "Record it if you suspect this effect."
    return "State it in robot.yaml if the arm has it." if "robot.yaml" in " ".join(needs) else ""


def _coverage(data: Dataset, robot: Robot) -> Iterator[Finding]:
    shares: dict[str, float] = {}
    for k, joint in enumerate(robot.joints, start=1):
        if "limits" in joint and k not in robot.passive:
            lo, hi = joint["limits"]
            shares[str(k)] = float(np.ptp(data.columns[f"q{k}"])) / (hi - lo)
    narrow = [f"joint {k} {share:.0%}" for k, share in shares.items() if share < _SHARE_OF_LIMITS]
    if narrow:
        yield Finding(
            "coverage",
            "note",
            f"these joints were moved through less than half of their limits: {', '.join(narrow)}",
            {"share_of_limits": shares},
            "Trust the fit only where poses were measured; tables give no correction elsewhere.",
        )
