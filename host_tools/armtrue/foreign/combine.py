"""Foreign sheets joined to one table in the contract's form: rows of files matched, reflectors one below the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.foreign.pairing import Rows, match_rows
from armtrue.foreign.parts import Part, in_si, point_axis
from armtrue.foreign.polar import polar_headers
from armtrue.io.columns import POSITION


@dataclass
class LongTable:
    """The joined table: its columns, the unit of those that are not in SI, and the reflector of each row.

    Values keep the units of the files, so that a wrongly guessed unit can be corrected in dataset.yaml.
    """

    columns: dict[str, Array]
    units: dict[str, str]
    labels: list[str] | None

    def in_si(self, name: str) -> Array:
        """One column in SI units."""
        return in_si(self.columns[name], self.units.get(name))


@dataclass(frozen=True)
class _Block:
    """Rows of one reflector: its points in `part` under the name `point`, and the matched rows of joints and points."""

    label: str
    part: Part
    point: str
    joints: Rows
    points: Rows


# Name of a column of the table → values of its blocks of rows, one below the other, each with its unit.
_Pieces = dict[str, list[tuple[Array, str | None]]]


def long_table(parts: list[Part]) -> tuple[LongTable, list[str]]:
    """All files as one table under the contract's names, and notes on what was done."""
    with_joints = [part for part in parts if part.meaning.joints]
    if len(with_joints) != 1:
        names = ", ".join(part.sheet.path.name for part in (with_joints or parts))
        raise InputError(
            f"{names}: found joints in {len(with_joints)} of the files, expected them in one, "
            f"under a header that names them (q1, J1, A1, joint_1 …){without_header(parts)}"
        )
    base = with_joints[0]
    blocks, notes = _blocks(base, parts)
    if not blocks:
        raise InputError(_no_points(base, parts))
    if len(blocks) > 1:
        notes.append(f"{len(blocks)} reflectors, one below the other: {', '.join(b.label for b in blocks)}")
    columns: _Pieces = {}
    for block in blocks:
        for name, piece in _columns(base, block).items():
            columns.setdefault(name, []).append(piece)
    timed = [base if base.clock is not None else block.part for block in blocks]
    if len({part.clock.kind for part in timed if part.clock is not None}) > 1:
        columns.pop("time")
        notes.append(
            "time: not taken, as the times of the files cannot be compared (seconds, times of day, dates)"
        )
    of_some = [name for name, pieces in columns.items() if len(pieces) != len(blocks)]
    notes += [f"{name}: not taken, as not every reflector has it" for name in of_some]
    table = _joined({name: pieces for name, pieces in columns.items() if name not in of_some})
    if len(blocks) > 1:
        named = [part for part in parts if "target" in part.meaning.others]
        why = "not taken, as reflectors have columns or files of their own"
        notes += [f"{part.sheet.path.name}: {part.meaning.others['target']}: {why}" for part in named]
        table.labels = [block.label for block in blocks for _ in range(len(block.joints))]
        return table, notes
    table.labels, said = _reflectors(base, blocks[0])
    return table, notes + said


def _no_points(base: Part, parts: list[Part]) -> str:
    """That no file has points, in words, and what to do about it."""
    names = str(base.sheet.path) if len(parts) == 1 else ", ".join(part.sheet.path.name for part in parts)
    axes = ", ".join(name for name in base.sheet.header if name.lower() in POSITION)
    found = f"only {axes} of the columns of points" if axes else "no columns of points"
    message = f"{names}: found {found}, expected x, y and z in one of the files"
    for part in parts:
        if polar := polar_headers(part.sheet):
            message += (
                f"; {part.sheet.path.name} has {', '.join(polar)}, which may be polar readings, whose angles are not "
                "known well enough (azimuth and elevation or zenith are): export the points as Cartesian x, y, z"
            )
    return message + without_header(parts)


def without_header(parts: list[Part]) -> str:
    """What to do about files without a header, in words; empty where each has one."""
    bare = [part.sheet.path.name for part in parts if not part.sheet.has_header]
    have = "has" if len(bare) == 1 else "have"
    line = "write a first line that names its columns, such as Name,X,Y,Z"
    return f"; {', '.join(bare)} {have} no header: {line}" if bare else ""


def _reflectors(base: Part, block: _Block) -> tuple[list[str] | None, list[str]]:
    """The reflector of each row of the only block, None where there is one for all, and a note on the column."""
    for part, rows in ((base, block.joints), (block.part, block.points)):
        header = part.meaning.others.get("target")
        if header is None:
            continue
        cells = part.sheet.cells(header)
        labels = [cells[at] for at in rows]
        if len(set(labels)) > 1:
            return labels, [f"{part.sheet.path.name}: {header}: target, by its header"]
        return None, [f"{part.sheet.path.name}: {header}: not taken, as it is the same in all rows"]
    return None, []


def _blocks(base: Part, parts: list[Part]) -> tuple[list[_Block], list[str]]:
    """One block for each reflector of each file, and notes on how its rows were matched to those of the joints."""
    blocks: list[_Block] = []
    notes: list[str] = []
    for part in (part for part in parts if part.meaning.points):
        rows: Rows = np.arange(len(base.sheet.rows), dtype=np.int64)
        own, other = rows, rows
        if part is not base:
            own, other, how = match_rows(base, part)
            notes.append(f"{part.sheet.path.name} belongs to {base.sheet.path.name} {how}")
        for name in part.meaning.points:
            alone = len(part.meaning.points) == 1 and part is not base
            label = part.sheet.path.stem if alone else (name or part.sheet.path.stem)
            blocks.append(_Block(label, part, name, own, other))
    return blocks, notes


def _columns(base: Part, block: _Block) -> dict[str, tuple[Array, str | None]]:
    """The columns of one reflector. Columns that both files have are taken from the file with the joints."""
    part = block.part
    columns: dict[str, tuple[Array, str | None]] = {}
    for name, header in base.meaning.joints.items():
        columns[name] = base.numbers(header)[block.joints], base.units.get(name)
    for axis, header in zip("xyz", part.meaning.points[block.point], strict=True):
        columns[axis] = part.numbers(header)[block.points], part.units[point_axis(block.point, axis)]
    for source, rows in ((part, block.points), (base, block.joints)):
        for name, header in (source.meaning.others | source.meaning.variables).items():
            if name not in ("time", "target", "repeat"):
                columns[name] = source.numbers(header)[rows], source.units.get(name)
    if "repeat" in base.meaning.others:
        repeats = np.unique(base.sheet.cells(base.meaning.others["repeat"]), return_inverse=True)[1]
        columns["repeat"] = repeats.astype(np.float64)[block.joints], None
    timed, rows = (base, block.joints) if base.clock is not None else (part, block.points)
    if timed.clock is not None:
        columns["time"] = timed.seconds()[rows], None
    return columns


def _joined(columns: _Pieces) -> LongTable:
    """The pieces of each column one below the other; the time counts from the earliest row."""
    table = LongTable({}, {}, None)
    for name, pieces in columns.items():
        if name == "time":
            earliest = min(float(values.min()) for values, _ in pieces)
            pieces = [(values - earliest, None) for values, _ in pieces]
        units = list(dict.fromkeys(unit for _, unit in pieces))
        one = units[0] if len(units) == 1 else None
        table.columns[name] = np.concatenate([v if one else in_si(v, unit) for v, unit in pieces])
        if one is not None:
            table.units[name] = one
    return table


def write_long(table: LongTable) -> str:
    """The text of a CSV of `table`."""
    columns = {name: [f"{value:.10g}" for value in values] for name, values in table.columns.items()}
    if table.labels:
        columns["target"] = [label.replace(",", " ") for label in table.labels]
    rows = [columns, *zip(*columns.values(), strict=True)]
    return "".join(",".join(row) + "\n" for row in rows)
