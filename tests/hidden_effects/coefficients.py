"""Fitted coefficients of hidden effects beside the true ones, in the fit's own standard deviations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from armtrue_sim.campaign import Campaign
from armtrue_sim.errors import ScenarioError
from armtrue_sim.mechanics.expression import evaluate

# Two expressions are the same basis where they differ by a factor alone, to this part of their size.
SAME = 1e-6


def deviations(fit: Mapping[str, Any], campaign: Campaign) -> dict[str, float]:
    """(fitted - true) / sigma by parameter name, for those of hidden effects that one true term stands behind.

    Terms are paired by effect, coordinate and what their expressions come to on the measured poses. A parameter with
    another basis (several terms, a variable that the simulator lacks, a nonlinear constant) is left out.
    """
    state = campaign.arm.standing_state(campaign.q, campaign.data | campaign.unrecorded)
    hidden = {entry["effect"] for entry in campaign.hidden}
    found = {}
    for parameter in fit["parameters"]:
        if parameter["effect"] not in hidden or not parameter.get("sigma") or len(parameter["terms"]) != 1:
            continue
        (term,) = parameter["terms"]
        try:
            basis = term["weight"] * evaluate(term["expression"], state)
        except ScenarioError:
            continue
        if not np.any(basis):
            continue
        for true in campaign.arm.terms:
            if (true.effect, true.coordinate) != (parameter["effect"], term["coordinate"]):
                continue
            other = evaluate(true.expression, state) + 0.0 * state.q[:, 0]
            if not np.any(np.abs(other) > SAME * np.abs(basis).max()):
                continue  # nothing moves here: a load on a vertical axis
            factor = float(other @ basis / (basis @ basis))
            if np.linalg.norm(other - factor * basis) <= SAME * np.linalg.norm(other):
                found[parameter["name"]] = (parameter["value"] - factor * true.value) / parameter["sigma"]
    return found
