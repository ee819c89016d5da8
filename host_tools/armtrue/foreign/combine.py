"""Foreign sheets to one table in the contract's form: units, files that belong together, wide to long, repeats."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError, RowError
from armtrue.foreign.headers import Meaning
from armtrue.foreign.sheets import Sheet, is_number, time_format, to_float
from armtrue.io.columns import UNITS

_FARTHEST_M = 20.0
# Joints of one pose differ by less, rad or m.
_SAME_POSE = 1e-3
# Columns whose cells may be words.
_TEXTS = ("time", "target", "repeat", "station", "nest")


@dataclass
class Part:
    """One file with its meaning. `units`: contract name → unit as stated or guessed; `notes`: from what.

    `skipped`: the file's lines of rows left out.
    """

    sheet: Sheet
    meaning: Meaning
    units: dict[str, str] = field(default_factory=dict)
    time_format: str | None = None
    notes: list[str] = field(default_factory=list)
    skipped: list[int] = field(default_factory=list)

    def leave_out_bad_rows(self) -> None:
        """Leave out the rows that cannot be read, with a note on each; `skipped` has their lines of the file.

        Errors: RowError where most of a column cannot be read.
        """
        numeric = [*self.meaning.joints.values(), *self.meaning.rotation]
        numeric += [header for headers in self.meaning.points.values() for header in headers]
        numeric += [header for name, header in self.meaning.others.items() if name not in _TEXTS]
        for header in numeric:
            bad = sum(not is_number(cell, self.sheet.decimal) for cell in self.sheet.cells(header))
            if 2 * bad > len(self.sheet.rows):
                self.numbers(header)  # raises: the column is something else
        while True:
            try:
                for header in numeric:
                    self.numbers(header)
                return
            except RowError as error:
                kept = [at for at, row in enumerate(self.sheet.numbers) if row != error.row]
                if not kept:
                    raise
                self.skipped.append(error.row)
                self.notes.append(f"left out: {str(error).removeprefix(f'{self.sheet.path} ')}")
                rows, numbers = self.sheet.rows, self.sheet.numbers
                self.sheet = replace(
                    self.sheet, rows=[rows[at] for at in kept], numbers=[numbers[at] for at in kept]
                )

    def numbers(self, header: str) -> Array:
        """One column as numbers. Errors: InputError naming the first cell that is none."""
        sheet = self.sheet
        cells = sheet.cells(header)
        for cell, row in zip(cells, sheet.numbers, strict=True):
            if not is_number(cell, sheet.decimal):
                found = f"'{cell}'" if cell else "nothing"
                raise RowError(
                    row, f"{sheet.path} row {row} column {header}: found {found}, expected a number"
                )
        return np.array([to_float(cell, sheet.decimal) for cell in cells])

    def in_si(self, name: str, header: str) -> Array:
        """One column in SI units by the unit that was found for `name`."""
        return _in_si(self.numbers(header), self.units.get(name))


def find_units(part: Part, prismatic: set[str]) -> None:
    """Fill `part.units` for joints, points, rotation, temperatures, time and payload; drop columns that are no use."""
    sheet, meaning = part.sheet, part.meaning
    _joint_units(part, prismatic)
    for name, headers in meaning.points.items():
        stated = next((sheet.units[header] for header in headers if header in sheet.units), None)
        points = np.column_stack([part.numbers(header) for header in headers])
        spread = float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))
        unit = stated or ("mm" if spread > _FARTHEST_M else "m")
        part.units[f"point {name}"] = unit
        part.notes.append(
            f"{', '.join(headers)}: {unit}, {_source(stated, f'points lie {spread:.4g} apart')}"
        )
    if len(meaning.rotation) == 3:
        stated = next((sheet.units[header] for header in meaning.rotation if header in sheet.units), None)
        largest = max(float(np.abs(part.numbers(header)).max()) for header in meaning.rotation)
        part.units["rotation"] = stated or ("deg" if largest > 2.0 * math.pi else "rad")
    _drop_numbers_of_repetitions(part)
    for name, header in list(meaning.others.items()):
        if name == "time":
            _find_time(part, header)
            continue
        own_unit = sheet.units.get(header)
        if name.startswith("temp_"):
            own_unit = own_unit or ("K" if float(np.median(part.numbers(header))) > 200.0 else "degC")
        if own_unit is not None:
            part.units[name] = own_unit
        part.notes.append(f"{header}: {name}{f' in {own_unit}' if own_unit else ''}, by its header")
    part.notes += [f"{header}: variable {name}, by its header" for name, header in meaning.variables.items()]
    meaning.left |= dict.fromkeys(meaning.externals, "the arm has no joint for it")
    part.notes += [f"{header}: not taken, as {why}" for header, why in meaning.left.items()]


def _drop_numbers_of_repetitions(part: Part) -> None:
    """Drop a `repeat` that counts the repetitions of a pose, where the contract's names the pose."""
    header = part.meaning.others.get("repeat")
    if header is None or not part.meaning.joints:
        return
    joints = np.column_stack([part.in_si(name, own) for name, own in part.meaning.joints.items()])
    _, first, code = np.unique(part.sheet.cells(header), return_index=True, return_inverse=True)
    if float(np.abs(joints - joints[first[code.reshape(-1)]]).max()) > _SAME_POSE:
        del part.meaning.others["repeat"]
        part.meaning.left[header] = "rows with the same name in it have different joints"


def codes_of_words(part: Part) -> None:
    """Make whole numbers from 1 of stations and nests that have names; the table must then be written anew."""
    sheet = part.sheet
    for name in ("station", "nest"):
        header = part.meaning.others.get(name)
        if header is None or all(is_number(cell, sheet.decimal) for cell in sheet.cells(header)):
            continue
        words = list(dict.fromkeys(sheet.cells(header)))
        at = sheet.header.index(header)
        rows = [[*row[:at], str(1 + words.index(row[at])), *row[at + 1 :]] for row in sheet.rows]
        part.sheet = replace(sheet, rows=rows, direct=False)
        sheet = part.sheet
        part.notes.append(
            f"{header}: {', '.join(f'{word} is {name} {k}' for k, word in enumerate(words, start=1))}"
        )


def _joint_units(part: Part, prismatic: set[str]) -> None:
    """Find the unit of each joint: from its own header, else from another joint's that turns or slides as it does.

    Where no header states one, the size of the values tells it.
    """
    for kind, default, foreign, largest_default in (
        ("angle", "rad", "deg", 2.2 * math.pi),
        ("length", "m", "mm", _FARTHEST_M),
    ):
        joints = {
            name: header
            for name, header in part.meaning.joints.items()
            if (name.lstrip("qr") in prismatic) == (kind == "length")
        }
        if not joints:
            continue
        largest = max(float(np.abs(part.numbers(header)).max()) for header in joints.values())
        stated = {name: part.sheet.units[h] for name, h in joints.items() if h in part.sheet.units}
        for name, unit in stated.items():
            if UNITS[unit][0] != kind:
                moves = "turns" if kind == "angle" else "slides"
                raise InputError(
                    f"{part.sheet.path} header: found column '{joints[name]}' in {unit}, expected a unit of {kind}, as "
                    f"joint {name.lstrip('qr')} of the arm {moves} (columns in the order of the arm's joints)"
                )
        unit = next(iter(stated.values()), foreign if largest > largest_default else default)
        part.units |= dict.fromkeys(joints, unit) | stated
        units = ", ".join(dict.fromkeys(part.units[name] for name in joints))
        words = ", ".join(joints.values())
        part.notes.append(
            f"{words}: joints in {units}, {_source(next(iter(stated), None), f'the largest is {largest:.4g}')}"
        )


def _source(stated: str | None, otherwise: str) -> str:
    return "as its header says" if stated else f"as {otherwise}"


def _find_time(part: Part, header: str) -> None:
    cells = part.sheet.cells(header)
    decimal = part.sheet.decimal
    if len(set(cells)) < 2:
        part.meaning.others.pop("time")
        part.notes.append(f"{header}: the same in all rows, not used")
        return
    part.time_format = time_format(cells)
    if part.time_format is not None:
        part.notes.append(f"{header}: time as {part.time_format}")
        return
    if all(is_number(cell, decimal) for cell in cells):
        stated = part.sheet.units.get(header)
        part.units["time"] = stated if stated in ("s", "ms", "min", "h") else "s"
        part.notes.append(f"{header}: time in {part.units['time']}")
        return
    part.meaning.others.pop("time")
    part.notes.append(f"{header}: found no time in '{cells[0]}', not used")


_CLOCKS_BEGIN = datetime.datetime(2000, 1, 1)


def seconds(part: Part) -> Array:
    """Seconds of each row of a sheet with time. Clocks of all sheets count from the same moment."""
    header = part.meaning.others["time"]
    if part.time_format is None:
        return part.in_si("time", header)
    stamps = [datetime.datetime.strptime(cell, part.time_format) for cell in part.sheet.cells(header)]
    return np.array([(stamp - _CLOCKS_BEGIN).total_seconds() for stamp in stamps])


def _kind_of_clock(part: Part) -> str:
    """Plain seconds, times of day, or times with a date: times of two kinds cannot be compared."""
    if part.time_format is None:
        return "seconds"
    return "date" if "%Y" in part.time_format else "day"


def match_rows(joints: Part, points: Part) -> tuple[NDArray[np.int64], NDArray[np.int64], str]:
    """Which rows of the two files belong together, and by what. Errors: InputError where nothing tells."""
    one, other = joints.meaning.key, points.meaning.key
    if one is not None and other is not None:
        own, foreign = joints.sheet.cells(one), points.sheet.cells(other)
        if len(set(own)) == len(own) and len(set(own) & set(foreign)) >= 0.5 * len(foreign):
            place = {key: at for at, key in enumerate(own)}
            pairs = [(place[key], at) for at, key in enumerate(foreign) if key in place]
            left, right = zip(*pairs, strict=True)
            return np.array(left), np.array(right), f"by {one} and {other}"
    count = len(joints.sheet.rows)
    if count != len(points.sheet.rows):
        raise InputError(
            f"{points.sheet.path}: found {len(points.sheet.rows)} rows where {joints.sheet.path} has {count}, expected "
            "as many, or a column of pose numbers in both"
        )
    rows = np.array(range(count), dtype=np.int64)
    return rows, rows, "row by row"


@dataclass
class LongTable:
    """Several files as one: its columns, the unit of those that are not in SI, and the reflector of each row.

    Figures stay as the files have them, so that a unit that was guessed wrongly can be put right where it is stated.
    """

    columns: dict[str, Array]
    units: dict[str, str]
    labels: list[str] | None

    def in_si(self, name: str) -> Array:
        """One column in SI units."""
        return _in_si(self.columns[name], self.units.get(name))


def _in_si(values: Array, unit: str | None) -> Array:
    _, factor, added = UNITS[unit] if unit else ("", 1.0, 0.0)
    return values * factor + added


def long_table(parts: list[Part]) -> tuple[LongTable, list[str]]:
    """All files as one table under the contract's names, and what was done."""
    with_joints = [part for part in parts if part.meaning.joints]
    if len(with_joints) != 1:
        names = ", ".join(part.sheet.path.name for part in (with_joints or parts))
        raise InputError(
            f"{names}: found joints in {len(with_joints)} of the files, expected them in one, "
            "under a header that names them (q1, J1, A1, joint_1 …)"
        )
    base = with_joints[0]
    blocks: list[tuple[str, Part, str, NDArray[np.int64], NDArray[np.int64]]] = []
    notes: list[str] = []
    for part in parts:
        if not part.meaning.points:
            continue
        if part is base:
            own = other = np.array(range(len(base.sheet.rows)), dtype=np.int64)
        else:
            own, other, how = match_rows(base, part)
            notes.append(f"{part.sheet.path.name} belongs to {base.sheet.path.name} {how}")
        for name in part.meaning.points:
            alone = len(part.meaning.points) == 1 and part is not base
            label = part.sheet.path.stem if alone else (name or part.sheet.path.stem)
            blocks.append((label, part, name, own, other))
    if not blocks:
        raise InputError(
            f"{base.sheet.path}: found no columns of points, expected x, y and z in one of the files"
        )
    if len(blocks) > 1:
        notes.append(
            f"{len(blocks)} reflectors, one below the other: {', '.join(block[0] for block in blocks)}"
        )
    columns: dict[str, list[tuple[Array, str | None]]] = {}
    labels: list[str] = []
    kinds: set[str] = set()

    def put(name: str, values: Array, unit: str | None = None) -> None:
        columns.setdefault(name, []).append((values, unit))

    for label, part, point, own, other in blocks:
        for name, header in base.meaning.joints.items():
            put(name, base.numbers(header)[own], base.units.get(name))
        for axis, header in zip("xyz", part.meaning.points[point], strict=True):
            put(axis, part.numbers(header)[other], part.units[f"point {point}"])
        # What both files have is taken from that with the joints.
        further: dict[str, tuple[Array, str | None]] = {}
        for source, rows in ((part, other), (base, own)):
            for name, header in (source.meaning.others | source.meaning.variables).items():
                if name not in ("time", "target", "repeat"):
                    further[name] = (source.numbers(header)[rows], source.units.get(name))
        for name, (values, unit) in further.items():
            put(name, values, unit)
        if "repeat" in base.meaning.others:
            repeats = np.unique(base.sheet.cells(base.meaning.others["repeat"]), return_inverse=True)[1]
            put("repeat", repeats.astype(np.float64)[own])
        timed, rows = (base, own) if "time" in base.meaning.others else (part, other)
        if "time" in timed.meaning.others:
            put("time", seconds(timed)[rows])
            kinds.add(_kind_of_clock(timed))
        labels += [label] * len(own)
    if len(kinds) > 1:
        columns.pop("time")
        notes.append(
            "time: not taken, as the times of the files cannot be compared (seconds, times of day, dates)"
        )
    of_some = [name for name, pieces in columns.items() if len(pieces) != len(blocks)]
    notes += [f"{name}: not taken, as not every reflector has it" for name in of_some]
    table = LongTable({}, {}, labels)
    for name in (name for name in columns if name not in of_some):
        if name == "time":
            earliest = min(float(values.min()) for values, _ in columns[name])
            columns[name] = [(values - earliest, None) for values, _ in columns[name]]
        units = list(dict.fromkeys(unit for _, unit in columns[name]))
        one = units[0] if len(units) == 1 else None
        table.columns[name] = np.concatenate([v if one else _in_si(v, unit) for v, unit in columns[name]])
        if one is not None:
            table.units[name] = one
    if len(blocks) > 1:
        return table, notes
    named = base.meaning.others.get("target")
    cells = base.sheet.cells(named) if named else []
    # One name a row is that of the pose, and no reflector's.
    few = 1 < 2 * len(set(cells)) <= len(cells)
    table.labels = [cells[at] for at in blocks[0][3]] if few else None
    return table, notes


def write_long(table: LongTable) -> str:
    """The text of a CSV of `table`."""
    labels = table.labels
    names = [*table.columns, *(["target"] if labels else [])]
    lines = [",".join(names)]
    for at in range(len(next(iter(table.columns.values())))):
        cells = [f"{values[at]:.10g}" for values in table.columns.values()]
        lines.append(",".join([*cells, *([labels[at].replace(",", " ")] if labels else [])]))
    return "\n".join(lines) + "\n"
