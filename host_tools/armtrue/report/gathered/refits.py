"""Fits made for the report: intermediate steps between two given fits, and a fit with a candidate added."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from armtrue.errors import InputError
from armtrue.fitting import Fit, add, with_effects

Entry = dict[str, Any]

# Rows × unknowns² up to which a fit takes some ten seconds; less for intermediate fits, as there may be several.
_SOON_DONE = 2e10
_SOON_DONE_BETWEEN = 4e9
_MOST_BETWEEN = 8


def between(before: Fit, after: Fit) -> list[Fit]:
    """Intermediate fits from `before` to `after`, each with one more changed effect; both ends are left out.

    Empty where the two differ by one effect only, or where fits of this size take too long.
    """
    plan = effects_between(before.effects, after.effects)
    if len(plan) > _MOST_BETWEEN or _work(after) > _SOON_DONE_BETWEEN:
        return []
    return [with_effects(after, effects) for effects in plan]


def effects_between(before: list[Entry], after: list[Entry]) -> list[list[Entry]]:
    """Intermediate models from `before` to `after`: effects are added in the order of `after`, removed at the end."""
    changed = [k for k, entry in enumerate(after) if entry not in before]
    gone = [entry for entry in before if not any(entry["effect"] == other["effect"] for other in after)]

    def model(changes: list[int]) -> list[Entry]:
        entries: list[Entry] = []
        for k, entry in enumerate(after):
            if k not in changed or k in changes:
                entries.append(entry)
            else:
                entries += [old for old in before if old["effect"] == entry["effect"] and old not in after]
        return entries + gone

    return [model(changed[:count]) for count in range(1, len(changed))]


def with_candidate(fit: Fit, candidate: Entry) -> Fit | None:
    """`fit` with a candidate added, not cross-validated; None where that is refused or would take too long."""
    if _work(fit, len(candidate["parameters"])) > _SOON_DONE:
        return None
    quick = {**fit.document, "options": {**fit.document["options"], "cross_validate": False}}
    try:
        base = replace(fit, document=quick)
        return add(base, candidate["effect"], candidate["joints"] or None, candidate["options"])
    except InputError:  # it is in the model on these joints already
        return None


def _work(fit: Fit, more: int = 0) -> float:
    unknowns = sum(not parameter["held"] for parameter in fit.document["parameters"]) + more
    return float(fit.document["data"]["rows"]) * unknowns**2
