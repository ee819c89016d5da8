"""Figures as people read them: micrometres, arcseconds and degrees, with as many digits as they carry."""

from __future__ import annotations

import math

# SI unit → display units, smallest first: (name, factor to SI); the largest that keeps the figure above 1 is taken.
_FOR_PEOPLE: dict[str, list[tuple[str, float]]] = {
    "m": [("µm", 1e-6), ("mm", 1e-3), ("m", 1.0)],
    "rad": [("″", math.pi / 648000.0), ("°", math.pi / 180.0)],
    "m/m": [("ppm", 1e-6), ("%", 1e-2)],
    "rad/rad": [("ppm", 1e-6), ("%", 1e-2)],
    "m/rad": [("µm/rad", 1e-6), ("mm/rad", 1e-3)],
    "rad/m": [("µrad/m", 1e-6), ("mrad/m", 1e-3)],
    "m/N": [("nm/N", 1e-9), ("µm/N", 1e-6)],
    "rad/Nm": [("µrad/Nm", 1e-6), ("mrad/Nm", 1e-3)],
    "rad/Nm^2": [("nrad/Nm²", 1e-9), ("µrad/Nm²", 1e-6)],
    "rad/Nm^3": [("prad/Nm³", 1e-12), ("nrad/Nm³", 1e-9)],
    "rad/N": [("nrad/N", 1e-9), ("µrad/N", 1e-6)],
    "rad/N/m*kg": [("nrad kg/(N m)", 1e-9), ("µrad kg/(N m)", 1e-6)],
    "rad/K": [("µrad/K", 1e-6)],
    "m/K": [("µm/K", 1e-6)],
    "1/K": [("µm/(m K)", 1e-6)],
    "m/h": [("µm/h", 1e-6), ("mm/h", 1e-3)],
    "rad/h": [("″/h", math.pi / 648000.0)],
    "s": [("s", 1.0), ("min", 60.0), ("h", 3600.0)],
}
_MOST_DECIMALS = 9
# Smallest figure shown in a unit, 1 for the others; angles below 0.3° are shown in arcseconds.
_ENOUGH = {"°": 0.3, "mm": 1.0, "m": 1.0}


def for_people(value: float, unit: str) -> tuple[float, str]:
    """Return `(figure, unit)` for `value` in the SI `unit`; a unit without a form for people stays."""
    chosen = (value, unit)
    for name, factor in _FOR_PEOPLE.get(unit, []):
        if chosen[1] == unit or abs(value) / factor >= _ENOUGH.get(name, 1.0):
            chosen = (value / factor, name)
    return chosen


def figure(value: float, digits: int = 4) -> str:
    """`value` with `digits` significant digits, without an exponent where it reads well without."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    magnitude = math.floor(math.log10(abs(value)))
    if -4 <= magnitude < 6:
        return f"{value:.{max(0, digits - 1 - magnitude)}f}"
    return f"{value:.{digits - 1}e}"


def value_and_sigma(value: float, sigma: float | None, unit: str) -> tuple[str, str, str]:
    """Return `(value, ± sigma, unit)` for people, both in one unit, to two digits of sigma."""
    spread = sigma if sigma is not None and math.isfinite(sigma) else 0.0
    largest = max(abs(value), spread)
    shown, name = for_people(largest, unit)
    factor = largest / shown if shown else 1.0
    if spread <= 0.0:
        return figure(value / factor), "", name
    decimals = max(0, 1 - math.floor(math.log10(spread / factor)))
    if decimals > _MOST_DECIMALS:
        digits = max(1, 1 + math.floor(math.log10(largest / spread)))
        return f"{value / factor:.{digits}e}", f"{spread / factor:.1e}", name
    return f"{value / factor:.{decimals}f}", f"{spread / factor:.{decimals}f}", name


def plural(count: int, word: str) -> str:
    """A count and its noun: "1 row", "2 rows"."""
    return f"{count} {word if count == 1 else word + 's'}"
