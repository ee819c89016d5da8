"""What to measure next, in one call: poses that settle what a fit's data leave open, or that sharpen what it knows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from armtrue.diagnosis import diagnose
from armtrue.fitting import Fit
from armtrue.planning import Cell, Plan, ambiguity, plan_separation, plan_sharpening
from armtrue.progress import Progress


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

    `rivals`: entries of model.yaml to tell apart; None takes what the fit's data leave open of its diagnosis, an empty
    list nothing. With nothing to tell apart the poses are for the fit's own parameters. `plan.separates` says which it
    was. Other arguments and errors as of `plan_campaign`, which is for an arm that was not measured yet.
    """
    settings: dict[str, Any] = {"cell": cell, "levels": levels, "candidates": candidates, "seed": seed}
    if rivals is None:
        left_open = ambiguity(fit, diagnose(fit, progress))
        rivals = left_open.open if left_open else []
    if rivals:
        return plan_separation(fit, rivals, poses, progress=progress, **settings)
    return plan_sharpening(fit, poses, progress=progress, **settings)
