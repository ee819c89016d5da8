"""Polar readings of trackers (azimuth, elevation or zenith angle, distance) converted to points."""

from __future__ import annotations

import math
import re

import numpy as np

from armtrue.arrays import Array
from armtrue.foreign.headers import meaning
from armtrue.foreign.sheets import Sheet, split_unit
from armtrue.io.columns import POSITION, UNITS

_AZIMUTH = re.compile(r"az(?:imuth|imut)?(?:[_ ]?angle)?$", re.IGNORECASE)
_ELEVATION = re.compile(r"el(?:ev|evation)?(?:[_ ]?angle)?$", re.IGNORECASE)
_ZENITH = re.compile(r"zen(?:ith)?(?:[_ ]?angle)?$", re.IGNORECASE)
_DISTANCE = re.compile(r"(?:d|dist(?:ance)?|range|radius)$", re.IGNORECASE)
# Circles whose sense and zero differ from instrument to instrument.
_CIRCLE = re.compile(r"(?:hz|v|horizontal|vertical)(?:[_ ]?(?:angle|circle))?$", re.IGNORECASE)
# Without a unit, lengths above this many metres are millimetres.
_FARTHEST_M = 100.0


def from_polar(sheet: Sheet) -> tuple[Sheet, str | None]:
    """`sheet` with x, y, z [m] in place of its polar readings, and a note; unchanged (None) where it has none.

    Azimuth counts from x towards y, elevation up from the xy plane, the zenith angle down from z.
    """
    found = _polar(sheet)
    if found is None or meaning(sheet, []).points:
        return sheet, None
    around, up, far = found
    if not all(map(sheet.is_numeric, found)):
        return sheet, None
    azimuth, second = (_in_si(sheet, name, "rad", "deg", 2.0 * math.pi) for name in (around, up))
    distance = _in_si(sheet, far, "m", "mm", _FARTHEST_M)
    is_zenith = bool(_ZENITH.match(split_unit(up)[0]))
    elevation = math.pi / 2.0 - second if is_zenith else second
    level = distance * np.cos(elevation)
    points = level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)
    columns = {name: cells for name, cells in sheet.columns.items() if name not in found}
    columns |= {axis: sheet.written(values) for axis, values in zip(POSITION, points, strict=True)}
    units = {name: unit for name, unit in sheet.units.items() if name not in found}
    polar = sheet.with_columns(
        columns,
        units=units | dict.fromkeys(POSITION, "m"),
        sources=sheet.sources | dict.fromkeys(POSITION, "as converted"),
    )
    angle = "zenith angle down from z" if is_zenith else "elevation up from the xy plane"
    return polar, (
        f"{around}, {up}, {far}: polar readings are converted to x, y, z (azimuth from x towards y, {angle}); if the "
        "instrument counts differently, export the points as Cartesian x, y, z"
    )


def polar_headers(sheet: Sheet) -> list[str]:
    """Headers of columns that may be polar readings, two or more; empty where there are fewer."""
    found = _matching(sheet, _AZIMUTH, _ELEVATION, _ZENITH, _CIRCLE, _DISTANCE)
    return found if len(found) > 1 else []


def _polar(sheet: Sheet) -> list[str] | None:
    """Headers of azimuth, elevation or zenith angle, and distance; None where one is missing or has another unit."""
    found = []
    for patterns, kind in (
        ((_AZIMUTH,), "angle"),
        ((_ELEVATION, _ZENITH), "angle"),
        ((_DISTANCE,), "length"),
    ):
        names = _matching(sheet, *patterns)
        unit = sheet.units.get(names[0]) if names else None
        if len(names) != 1 or (unit is not None and UNITS[unit][0] != kind):
            return None
        found += names
    return found


def _matching(sheet: Sheet, *patterns: re.Pattern[str]) -> list[str]:
    return [name for name in sheet.header if any(p.match(split_unit(name)[0]) for p in patterns)]


def _in_si(sheet: Sheet, name: str, small: str, large: str, limit: float) -> Array:
    """One column in SI units: as stated, else in `small` if no value is above `limit`, else in `large`."""
    values = sheet.figures(name)
    unit = sheet.units.get(name) or (large if np.abs(values).max() > limit else small)
    return np.asarray(values * UNITS[unit][1])
