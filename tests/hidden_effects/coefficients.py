"""Fitted coefficients of hidden effects compared with the true ones, in the fit's standard deviations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from armtrue_sim.campaign import Campaign
from armtrue_sim.errors import ScenarioError
from armtrue_sim.mechanics.expression import evaluate

# Relative tolerance to which two expressions of the same basis differ only by a factor.
SAME = 1e-6


def deviations(fit: Mapping[str, Any], campaign: Campaign) -> dict[str, float]:
    """(fitted - true) / sigma by parameter name, for parameters of hidden effects whose terms match true ones.

    Terms are paired by effect, coordinate and the values of their expressions at the measured poses. A parameter with
    another basis (a variable that the simulator lacks, a nonlinear constant) is left out. The true value of a parameter
    with several terms is the nearest to theirs: of a wobble's two senses of turning, `link_geometry` takes the one that
    stands still, and these terms together have the other.
    """
    state = campaign.arm.standing_state(campaign.q, campaign.data | campaign.unrecorded)
    hidden = {entry["effect"] for entry in campaign.hidden}
    found = {}
    for parameter in fit["parameters"]:
        if parameter["effect"] not in hidden or not parameter.get("sigma"):
            continue
        true = [_true_value(term, parameter["effect"], state, campaign) for term in parameter["terms"]]
        known = [
            (term["weight"], value)
            for term, value in zip(parameter["terms"], true, strict=True)
            if value is not None
        ]
        if len(known) == len(true):
            nearest = sum(w * w * value for w, value in known) / sum(w * w for w, _ in known)
            found[parameter["name"]] = (parameter["value"] - nearest) / parameter["sigma"]
    return found


def _true_value(term: Mapping[str, Any], effect: str, state: Any, campaign: Campaign) -> float | None:
    """The coefficient with which the fitted term equals a true one; None if no true term matches."""
    try:
        basis = np.broadcast_to(term["weight"] * evaluate(term["expression"], state), len(state.q))
    except ScenarioError:
        return None
    if not np.any(basis):
        return None
    for true in campaign.arm.terms:
        if (true.effect, true.coordinate) != (effect, term["coordinate"]):
            continue
        other = evaluate(true.expression, state) + 0.0 * state.q[:, 0]
        if not np.any(np.abs(other) > SAME * np.abs(basis).max()):
            continue  # nothing moves here: a load on a vertical axis
        factor = float(other @ basis / (basis @ basis))
        if np.linalg.norm(other - factor * basis) <= SAME * np.linalg.norm(other):
            return factor * true.value
    return None
