"""Fitted values outside their physical range, which is given by the bound and the sign of each parameter."""

from __future__ import annotations

from typing import Any

from armtrue.units import value_and_sigma

# A value beyond its bound by less than this many standard deviations may be inside.
_SIGMAS = 2.0


def outside_words(parameter: dict[str, Any]) -> str:
    """`outside 0 to 200 µrad/Nm` if the value is beyond its bound by more than its uncertainty, else an empty text."""
    bound = parameter.get("bound") or 0.0
    if not bound or parameter.get("held") or parameter.get("fixed"):
        return ""
    sign = parameter.get("sign", 0)
    # The range of a parameter with a physical sign, such as a compliance, ends at zero.
    lowest, highest = (0.0 if sign > 0 else -bound), (0.0 if sign < 0 else bound)
    margin = _SIGMAS * (parameter.get("sigma") or 0.0)
    if lowest - margin <= parameter["value"] <= highest + margin:
        return ""
    words, _, unit = value_and_sigma(bound, None, parameter["unit"])
    if sign:
        return f"outside {f'0 to {words}' if sign > 0 else f'-{words} to 0'} {unit}"
    return f"outside ±{words} {unit}"
