"""What the data can and cannot tell, asked of a fit of the geometry alone."""

from __future__ import annotations

import numpy as np

from armtrue.checking import sigma
from armtrue.checking.alignment import evenly
from armtrue.checking.report import Finding
from armtrue.errors import InputError
from armtrue.io.catalogue import with_role
from armtrue.io.dataset import Dataset
from armtrue.io.model import Model
from armtrue.io.robot import Robot

# Enough to see what separates; more only takes time.
_ROWS = 300
# Below this share of its limits a joint leaves much of the workspace unseen.
_SHARE_OF_LIMITS = 0.5
# What the fitter says of pairs that other poses would separate; the rest holds of any poses and is no finding.
_OF_THESE_POSES = "by these poses"


def find(data: Dataset, robot: Robot) -> list[Finding]:
    """Notes on what stays unknown or untestable, and on the share of the workspace that was visited."""
    return [*_coverage(data, robot), *_of_a_fit(data, robot)]


def _of_a_fit(data: Dataset, robot: Robot) -> list[Finding]:
    from armtrue.diagnosis import diagnose
    from armtrue.fitting import fit

    model = Model([{"effect": effect} for effect in with_role("placement", "geometry")])
    try:
        geometry = fit(data.take(evenly(data.count, _ROWS)), robot, model, folds=2)
        untestable = diagnose(geometry)["untestable"]
    except InputError as error:
        return [Finding("no_fit", "warning", f"the geometry cannot be fitted to these data: {error}")]
    findings = [
        Finding(
            "cannot_tell",
            "note",
            sentence,
            {},
            "Measure poses that differ more, or live with the sum of the two, which is known.",
        )
        for sentence in geometry.document["unobservable"]
        if _OF_THESE_POSES in sentence
    ]
    findings += sigma.find(data, float(np.sqrt(np.mean(np.sum(geometry.residuals() ** 2, axis=1)))))
    return findings + [
        Finding(
            "untestable",
            "note",
            f"{entry['effect']} cannot be tested without {', '.join(entry['needs'])}",
            entry,
            "Record it, should the arm or the session give reason to suspect the effect.",
        )
        for entry in untestable
    ]


def _coverage(data: Dataset, robot: Robot) -> list[Finding]:
    shares: dict[str, float] = {}
    for k, joint in enumerate(robot.joints, start=1):
        if "limits" in joint and k not in robot.passive:
            lo, hi = joint["limits"]
            shares[str(k)] = float(np.ptp(data.columns[f"q{k}"])) / (hi - lo)
    narrow = [f"joint {k} {share:.0%}" for k, share in shares.items() if share < _SHARE_OF_LIMITS]
    if not narrow:
        return []
    return [
        Finding(
            "coverage",
            "note",
            f"these joints were moved through less than half of their limits: {', '.join(narrow)}",
            {"share_of_limits": shares},
            "Trust the fit where poses were measured; tables are neutral elsewhere.",
        )
    ]
