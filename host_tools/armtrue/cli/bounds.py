"""Fitted values that lie outside what is physical: by the bound that each parameter brings, and its effect's range."""

from __future__ import annotations

import re
from typing import Any

from armtrue.io.catalogue import catalogue
from armtrue.units import value_and_sigma

# Within so many standard deviations of its bound a value may lie inside.
_SIGMAS = 2.0
_NUMBER = r"-?[0-9.]+(?:e-?[0-9]+)?"
_RANGE = re.compile(rf"^({_NUMBER}) to ({_NUMBER}) ")


def outside_words(parameter: dict[str, Any]) -> str:
    """`outside 0 to 200 µrad/Nm` where the value is, by more than its uncertainty, beyond its bound; else nothing."""
    bound = parameter.get("bound") or 0.0
    if not bound or parameter.get("held") or parameter.get("fixed"):
        return ""
    lowest = _lowest(parameter, bound)
    margin = _SIGMAS * (parameter.get("sigma") or 0.0)
    if lowest - margin <= parameter["value"] <= bound + margin:
        return ""
    low, _, low_unit = value_and_sigma(lowest, None, parameter["unit"])
    high, _, unit = value_and_sigma(bound, None, parameter["unit"])
    low_words = low if low_unit == unit or lowest == 0.0 else f"{low} {low_unit}"
    return f"outside {'±' + high if lowest == -bound else f'{low_words} to {high}'} {unit}"


def _lowest(parameter: dict[str, Any], bound: float) -> float:
    """The lower end: 0 for what only yields, such as a spring, else as far below as `bound` is above."""
    info = catalogue().get(parameter["effect"])
    stated = _RANGE.match(info.bound) if info else None
    # Parameters in other units, as springs times masses, have bounds of their own and either sign.
    return float(stated[1]) if stated and float(stated[2]) == bound else -bound
