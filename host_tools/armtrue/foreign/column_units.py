"""Units of the columns of a foreign file: as headers state them, else by the size of the values."""

from __future__ import annotations

import math

import numpy as np

from armtrue.errors import InputError
from armtrue.foreign.clocks import read_clock, why_no_clock
from armtrue.foreign.parts import Part, in_si, point_axis
from armtrue.io.columns import UNITS

_FARTHEST_M = 20.0
# Joints of one pose differ by less, rad or m.
_SAME_POSE = 1e-3


def find_geometry_units(part: Part, prismatic: set[str]) -> None:
    """Fill `part.units` for joints and points; a unit in a column's own header comes first."""
    _joint_units(part, prismatic)
    for name, headers in part.meaning.points.items():
        stated = [_stated(part, header, "length", "a point") for header in headers]
        unit = next((unit for unit in (*stated, part.sheet.length_unit) if unit), None)
        unit = unit or ("mm" if _apart(part, name) > _FARTHEST_M else "m")
        part.units |= {point_axis(name, axis): own or unit for axis, own in zip("xyz", stated, strict=True)}


def find_units(part: Part) -> None:
    """Fill `part.units` for all other columns, note each unit with its reason, and drop columns without use."""
    sheet, meaning = part.sheet, part.meaning
    for name, headers in meaning.points.items():
        units = [part.units[point_axis(name, axis)] for axis in "xyz"]
        guessed = "a comment says" if sheet.length_unit else f"points lie {_apart(part, name):.4g} apart"
        part.notes.append(f"{', '.join(headers)}: {_of_each(units)}, {_source(part, headers, guessed)}")
    if len(meaning.rotation) == 3:
        _rotation_unit(part)
    _drop_numbers_of_repetitions(part)
    for name, header in list(meaning.others.items()):
        if name in ("time", "target"):  # noted where they are read
            continue
        own_unit = sheet.units.get(header)
        if name.startswith("temp_"):
            own_unit = own_unit or _temperature_unit(part, header)
        if own_unit is not None:
            part.units[name] = own_unit
        part.notes.append(f"{header}: {name}{f' in {own_unit}' if own_unit else ''}, by its header")
    part.notes += [f"{header}: variable {name}, by its header" for name, header in meaning.variables.items()]
    meaning.left |= dict.fromkeys(meaning.externals, "the arm has no joint for it")
    part.notes += [f"{header}: not taken, as {why}" for header, why in meaning.left.items()]


def _drop_numbers_of_repetitions(part: Part) -> None:
    """Drop a `repeat` that numbers the repetitions of a pose; the contract's `repeat` identifies the pose."""
    header = part.meaning.others.get("repeat")
    if header is None or not part.meaning.joints:
        return
    joints = np.column_stack([part.in_si(name, own) for name, own in part.meaning.joints.items()])
    _, first, code = np.unique(part.sheet.cells(header), return_index=True, return_inverse=True)
    if float(np.abs(joints - joints[first[code.reshape(-1)]]).max()) > _SAME_POSE:
        del part.meaning.others["repeat"]
        part.meaning.left[header] = "rows with the same name in it have different joints"


def codes_of_words(part: Part) -> None:
    """Replace names of stations and nests by whole numbers from 1; the table must then be written to a new file."""
    for name in ("station", "nest"):
        header = part.meaning.others.get(name)
        if header is None or part.sheet.is_numeric(header):
            continue
        cells = part.sheet.cells(header)
        codes = {word: str(k) for k, word in enumerate(dict.fromkeys(cells), start=1)}
        part.sheet = part.sheet.with_columns({**part.sheet.columns, header: [codes[cell] for cell in cells]})
        part.notes.append(f"{header}: {', '.join(f'{word} is {name} {k}' for word, k in codes.items())}")


def _joint_units(part: Part, prismatic: set[str]) -> None:
    """Find the unit of each joint: from its own header, else from that of another joint of the same type.

    If no header states a unit, it is guessed from the size of the values.
    """
    for kind, default, foreign, largest_default in (
        ("angle", "rad", "deg", 2.2 * math.pi),
        ("length", "m", "mm", _FARTHEST_M),
    ):
        all_joints, slides = part.meaning.joints.items(), kind == "length"
        joints = {name: header for name, header in all_joints if (name.lstrip("qr") in prismatic) == slides}
        if not joints:
            continue
        largest = max(float(np.abs(part.numbers(header)).max()) for header in joints.values())
        stated = {name: part.sheet.units[h] for name, h in joints.items() if h in part.sheet.units}
        for name, unit in stated.items():
            if UNITS[unit][0] != kind:
                moves = "slides" if slides else "turns"
                raise InputError(
                    f"{part.sheet.path} header: found column '{joints[name]}' in {unit}, expected a unit of {kind}, as "
                    f"joint {name.lstrip('qr')} of the arm {moves} (columns in the order of the arm's joints)"
                )
        unit = next(iter(stated.values()), foreign if largest > largest_default else default)
        part.units |= dict.fromkeys(joints, unit) | stated
        units = ", ".join(dict.fromkeys(part.units[name] for name in joints))
        why = _source(part, list(joints.values()), f"the largest is {largest:.4g}")
        part.notes.append(f"{', '.join(joints.values())}: joints in {units}, {why}")


def _source(part: Part, headers: list[str], otherwise: str) -> str:
    """Words that say where the unit of these columns is stated, or, if it is guessed, from what (`otherwise`)."""
    stated = [header for header in headers if header in part.sheet.units]
    return part.sheet.sources.get(stated[0], "as its header says") if stated else f"as {otherwise}"


def _of_each(units: list[str]) -> str:
    """One unit, or that of each column where they differ."""
    return units[0] if len(set(units)) == 1 else f"{', '.join(units)}, each by its own"


def _apart(part: Part, name: str) -> float:
    points = np.column_stack([part.numbers(header) for header in part.meaning.points[name]])
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def _stated(part: Part, header: str, kind: str, of: str) -> str | None:
    """The unit that a header states. Errors: InputError if it is not a unit of `kind`."""
    unit = part.sheet.units.get(header)
    if unit is not None and UNITS[unit][0] != kind:
        raise InputError(
            f"{part.sheet.path} header: found column '{header}' in {unit}, expected a unit of {kind}, as it is of {of}"
        )
    return unit


def _rotation_unit(part: Part) -> None:
    """Find the unit of three angles. If headers state different units, all angles are rewritten in radians."""
    headers = part.meaning.rotation
    stated = [_stated(part, header, "angle", "an orientation") for header in headers]
    largest = max(float(np.abs(part.numbers(header)).max()) for header in headers)
    unit = next((unit for unit in stated if unit), "deg" if largest > 2.0 * math.pi else "rad")
    units = [own or unit for own in stated]
    part.units["rotation"] = units[0]
    if len(set(units)) == 1:
        return
    part.notes.append(f"{', '.join(headers)}: {_of_each(units)}, as its header says, and written in rad")
    part.units["rotation"] = "rad"
    angles = {h: in_si(part.numbers(h), own) for h, own in zip(headers, units, strict=True)}
    cells = {header: part.sheet.written(values) for header, values in angles.items()}
    part.sheet = part.sheet.with_columns({**part.sheet.columns, **cells})


def _temperature_unit(part: Part, header: str) -> str:
    """The unit by the letter at the end of the header, else by the size of the values."""
    if header.lower().endswith(("_f", " f", ".f")):
        return "degF"
    return "K" if float(np.median(part.numbers(header))) > 200.0 else "degC"


def find_clock(part: Part) -> None:
    """Fill `part.clock` if a column of time can be read, and note how it is read, or why it is not."""
    header = part.meaning.others.get("time")
    if header is None:
        return
    cells = part.sheet.cells(header)
    if len(set(cells)) > 1:
        part.clock = read_clock(part.sheet, header)
    if part.clock is not None:
        part.notes.append(f"{header}: {part.clock.words}")
        return
    part.meaning.others.pop("time")
    why = why_no_clock(cells, part.sheet.numbers) if len(set(cells)) > 1 else "the same in all rows"
    part.notes.append(f"{header}: not used as time, {why}")
