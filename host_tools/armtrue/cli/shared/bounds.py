"""Fitted values that lie outside what is physical: by the bound and the sign that each parameter brings."""

from __future__ import annotations

from typing import Any

from armtrue.units import value_and_sigma

# Within so many standard deviations of its bound a value may lie inside.
_SIGMAS = 2.0


def outside_words(parameter: dict[str, Any]) -> str:
    """`outside 0 to 200 µrad/Nm` where the value is, by more than its uncertainty, beyond its bound; else nothing."""
    bound = parameter.get("bound") or 0.0
    if not bound or parameter.get("held") or parameter.get("fixed"):
        return ""
    sign = parameter.get("sign", 0)
    # What has a sign by physics, such as a spring that yields, ends at zero.
    lowest, highest = (0.0 if sign > 0 else -bound), (0.0 if sign < 0 else bound)
    margin = _SIGMAS * (parameter.get("sigma") or 0.0)
    if lowest - margin <= parameter["value"] <= highest + margin:
        return ""
    words, _, unit = value_and_sigma(bound, None, parameter["unit"])
    if sign:
        return f"outside {f'0 to {words}' if sign > 0 else f'-{words} to 0'} {unit}"
    return f"outside ±{words} {unit}"
