"""Measurements: a CSV in the contract's form, or a foreign one through its dataset.yaml."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError, RowError, did_you_mean, shorten
from armtrue.io import rotation
from armtrue.io.columns import (
    POSITION,
    QUATERNION,
    TEXT_COLUMNS,
    ColumnNames,
    commanded_joints,
    contract_name,
    span,
)
from armtrue.io.delimited import RawColumns, read_columns
from armtrue.io.layout import (
    Layout,
    RotationSource,
    TimeSource,
    contract_layout,
    foreign,
    read_stamp,
    yaml_layout,
)
from armtrue.io.model import EXPRESSION_WORDS, state_names
from armtrue.io.plausible import WrongUnitError, refuse_wrong_units
from armtrue.io.robot import Robot
from armtrue.io.ways import directions, travels
from armtrue.units import plural

# Quaternions in files are rounded; numbers further from unit length than this are no quaternion.
_QUATERNION_LENGTH_TOLERANCE = 1e-3
# A reflector that moves less than this [m] in all while a joint moves more than that [rad, m] is fixed to the floor.
_FIXED_SPAN_M = 5e-3
_ARM_MOVED = 0.2
# A misspelt name has at least this share of its letters right.
_ALIKE = 0.75
# Controllers round the angle that they compute for a passive joint [rad, m].
_PASSIVE_FOLLOWS = 2e-3
# More bad rows than this mean that the file is read in the wrong way.
_MOST_SKIPPED = 100


@dataclass(frozen=True)
class Dataset:
    """Measurements in SI units under the contract's column names.

    `path`: the requested CSV or dataset.yaml; `file`: the file that holds the rows.
    `columns`: name → float64 array (N,); `target` and `repeat` hold codes, whose names are in `labels`.
    `rows`: the file row of each entry (the header is 1 if it is the first line). `notes`: what the reader did.
    `skipped`: file row → error, for the unreadable rows left out with `skip_bad`. `left_out`: file rows that a user
    marked as wrong. `turns`: the file's Euler angles (N, 3) [rad], if it has any; `rotation`: how they were read.
    `passive`: the file's columns `qK` of joints without a motor, for which `columns` has zeros. `derived`: names of
    columns that no file has, but the order of the rows.
    """

    path: Path
    file: Path
    columns: dict[str, Array]
    rows: NDArray[np.int64]
    labels: dict[str, list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    rotation: RotationSource | None = None
    turns: Array | None = None
    skipped: dict[int, str] = field(default_factory=dict)
    left_out: list[int] = field(default_factory=list)
    passive: dict[str, Array] = field(default_factory=dict)
    derived: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        return f"{self.file.name}: {plural(self.count, 'measurement')} of {', '.join(self.columns)}"

    @property
    def count(self) -> int:
        """Number of measurements."""
        return int(self.rows.size)

    @property
    def joints(self) -> Array:
        """Commanded joints (N, n), motor side."""
        return np.column_stack([self.columns[name] for name in commanded_joints(self.columns)])

    @property
    def positions_m(self) -> Array:
        """Measured positions (N, 3) in the measuring frame."""
        return np.column_stack([self.columns[name] for name in POSITION])

    @property
    def clock(self) -> Array:
        """Time [s] of each entry (N,); the number of the entry where no time was recorded."""
        return self.columns.get("time", np.arange(self.count, dtype=np.float64))

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Mask (N,) of rows without a position: x, y and z are 0, as instruments write after losing the reflector."""
        if not self.has_positions:
            return np.zeros(self.count, dtype=np.bool_)
        return np.asarray((self.positions_m == 0.0).all(axis=1))

    @property
    def has_positions(self) -> bool:
        """True where x, y and z were measured."""
        return all(name in self.columns for name in POSITION)

    def reflectors_among(self, names: list[str], whose: str) -> NDArray[np.intp]:
        """Index in `names` of each entry's reflector, (N,). Errors: InputError for a reflector not in `names`."""
        labels = self.labels.get("target", [])
        if unknown := [label for label in labels if label not in names]:
            raise InputError(
                f"{self.path} column target: found '{unknown[0]}', expected one of {whose} {', '.join(names)}"
            )
        places = np.array([names.index(label) for label in labels], dtype=np.intp)
        return places[self.columns["target"].astype(np.intp)]

    def take(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> Dataset:
        """Return the entries selected by a mask (N,) or by indices, in that order."""
        columns = {name: values[which] for name, values in self.columns.items()}
        turns = None if self.turns is None else self.turns[which]
        passive = {name: values[which] for name, values in self.passive.items()}
        return replace(self, columns=columns, rows=self.rows[which], turns=turns, passive=passive)

    def noting(self, note: str, **changes: Any) -> Dataset:
        """Return the measurements with `changes` of their fields and with a further note on their file."""
        return replace(self, notes=[*self.notes, f"{self.file.name}: {note}"], **changes)

    def without(self, rows: list[int]) -> Dataset:
        """Return the measurements without these rows of the file. Errors: InputError for a row that is not there."""
        if unknown := sorted(set(rows) - set(self.rows.tolist())):
            raise InputError(
                f"{self.file}: found no row {unknown[0]} to leave out, expected a row that was read"
            )
        if not rows:
            return self
        taken = self.take(~np.isin(self.rows, rows))
        return replace(taken, left_out=sorted({*self.left_out, *rows}))


def load_data(
    path: str | Path,
    robot: Robot,
    *,
    need_position: bool = True,
    strict: bool = True,
    skip_bad: bool = False,
) -> Dataset:
    """Read measurements of `robot` from a CSV or a dataset.yaml (docs/files.md).

    `need_position`: False for poses to predict: measured columns are not read, and rows come in file order.
    `strict`: refuse wrong units and positions of 0, and leave out copies of rows and reflectors that are not mounted
    on the arm; `check` passes False and reports all four as findings instead. `skip_bad`: leave out up to 100 rows
    that cannot be read.

    Errors: InputError naming file, row and column or key, what was found and what was expected.
    """
    path = Path(path)
    described = path.suffix.lower() in (".yaml", ".yml")
    layout = yaml_layout(path, robot) if described else contract_layout(path, robot)
    if not need_position:
        layout = layout.without_measurements()
    _require_columns(layout, path if described else layout.file, robot, need_position)
    skipped: dict[int, str] = {}
    while True:
        try:
            data = _assemble(path, layout, ColumnNames(robot), skipped)
            if data.count == 0:
                raise InputError(f"{layout.file}: found no rows of measurements, expected at least one")
            _check_values(data)
            if strict and data.lost.any():
                row = int(data.rows[data.lost][0])
                raise RowError(
                    row,
                    f"{data.file} row {row} columns x, y, z: found 0, 0, 0, which instruments write that have lost "
                    "their reflector, expected a measured position",
                )
            break
        except RowError as error:
            if not skip_bad:
                raise
            skipped[error.row] = str(error)
            if len(skipped) > _MOST_SKIPPED:
                raise InputError(f"{error}; expected no more than {_MOST_SKIPPED} such rows") from None
    data = _with_passive_still(data, robot)
    if need_position:
        # In poses to predict, a direction of 0 is an unspecified one.
        data = _without_unrecorded(data)
    if "dir" in layout.from_order and "travel" not in layout.from_order:
        data = replace(data, derived=frozenset(directions(data.columns)))
    if not strict:
        return data
    try:
        refuse_wrong_units(data.file, data.columns, data.rows, robot)
    except WrongUnitError as error:
        if described or not need_position or not error.of_geometry:
            raise
        raise foreign(str(error), path, robot) from None
    if not need_position:
        return in_file_order(with_travels(data))
    return without_fixed_targets(with_travels(without_copies(data)))


def _with_passive_still(data: Dataset, robot: Robot) -> Dataset:
    """`data` with the drives' angles and passive joints at zero: these have no motor; couplings turn their links.

    For such a joint controllers write a constant, or the angle that the couplings give. Neither adds information, and
    neither is used. Errors: InputError for a column with any other values.
    """
    if not robot.passive:
        return _at_the_drives(data, robot)
    names = ColumnNames(robot)
    columns = {name: values for name, values in data.columns.items() if not names.of_passive(name)}
    still = {f"q{k}": np.zeros(data.count) for k in robot.passive}
    moved = _at_the_drives(replace(data, columns=columns | still), robot)
    follows = moved.joints @ robot.mechanical_coupling.T
    given = {f"q{k}": data.columns[f"q{k}"] for k in robot.passive if f"q{k}" in data.columns}
    for name, reported in given.items():
        k = int(name[1:])
        apart = min(float(np.ptp(reported - angle)) for angle in (0.0, follows[:, k - 1]))
        if apart > _PASSIVE_FOLLOWS:
            unit = "rad" if robot.joints[k - 1]["type"] == "revolute" else "m"
            raise InputError(
                f"{data.file} column q{k}: found values up to {apart:.3g} {unit} from robot.yaml's coupling, expected "
                f"no column (joint {k} is passive), the same value in all rows, or the angle by that coupling"
            )
        moved = moved.noting(f"q{k} is not used: joint {k} has no motor, and its link follows")
    if others := sorted(name for name in data.columns if names.of_passive(name) and name not in given):
        moved = moved.noting(f"not used, as the joints have no motor: {', '.join(others)}")
    return replace(moved, columns={**moved.columns, **still}, passive=given)


def _at_the_drives(data: Dataset, robot: Robot) -> Dataset:
    """`data` with coupled angles, as the controller reports them, converted to the drives' angles of the model."""
    matrix = robot.drives_from_reported
    if np.array_equal(matrix, np.eye(robot.joint_count)):
        return data
    columns = with_joints_mapped(data.columns, matrix)
    note = "joint angles are converted to drive angles: by robot.yaml, the controller reports coupled angles"
    return replace(data, columns=columns, notes=[*data.notes, note])


def with_joints_mapped(columns: Mapping[str, Array], matrix: Array) -> dict[str, Array]:
    """`columns` with the commanded and the read-back joint angles of each row multiplied by `matrix` (n, n).

    Joints that `matrix` does not change need no columns: passive ones have none.
    """
    mapped = dict(columns)
    apart = matrix != np.eye(len(matrix))
    mixed = np.flatnonzero(apart.any(axis=0) | apart.any(axis=1))
    for stem in ("q", "qr"):
        names = [f"{stem}{k + 1}" for k in mixed]
        if names and all(name in columns for name in names):
            angles = np.column_stack([columns[name] for name in names]) @ matrix[np.ix_(mixed, mixed)].T
            mapped |= {name: angles[:, k] for k, name in enumerate(names)}
    return mapped


def in_file_order(data: Dataset) -> Dataset:
    """`data` with its entries in the order of the file, from which `sort_by: time` may have moved them."""
    return data.take(np.argsort(data.rows, kind="stable"))


def fixed_targets(data: Dataset) -> list[int]:
    """Codes of the reflectors that do not move with the arm: those fixed to base or floor."""
    if "target" not in data.columns or not data.has_positions:
        return []
    codes = data.columns["target"].astype(np.int64)
    fixed = []
    for code in np.unique(codes):
        rows = codes == code
        span = float(np.linalg.norm(np.ptp(data.positions_m[rows], axis=0)))
        turned = float(np.ptp(data.joints[rows], axis=0).max())
        if np.count_nonzero(rows) >= 2 and span < _FIXED_SPAN_M and turned > _ARM_MOVED:
            fixed.append(int(code))
    return fixed


def without_copies(data: Dataset) -> Dataset:
    """`data` without rows that equal an earlier one in all columns, and a note that says so.

    Rows of a file that was appended twice are no repeats: taken for repeats, they would show zero noise. Real repeats
    of a pose differ in time or in the measured values.
    """
    table = np.column_stack(list(data.columns.values()))
    first: dict[bytes, int] = {}
    for entry, row in enumerate(table):
        first.setdefault(row.tobytes(), entry)
    copies = data.count - len(first)
    if not copies:
        return data
    rows = "row that equals an earlier one" if copies == 1 else "rows that equal earlier ones"
    note = f"left out {copies} {rows} in every column: copies are no measurements"
    return data.take(np.array(list(first.values()))).noting(note)


def with_travels(data: Dataset) -> Dataset:
    """`data` with the columns `travel1…traveln` derived from the order of its rows, and a note that says so."""
    # Directions derived from the order of rows cannot confirm that the arm moved from row to row.
    found = {} if data.derived else travels(data.columns)
    if not found:
        return data
    joints = sorted(int(name.removeprefix("travel")) for name in found)
    note = (
        f"{span('travel', joints)}, the travel of a joint since its last reversal, is derived from "
        "the order of the rows, with which dir agrees"
    )
    return data.noting(note, columns=data.columns | found, derived=frozenset(found))


def _without_unrecorded(data: Dataset) -> Dataset:
    """`data` without columns of a joint's motion that are 0 in every row although the joint moves, and a note on it.

    A controller that does not log directions often writes 0. Taken for measurements, such columns would count as
    recorded and keep the effects that read them from being named as untestable.
    """
    moves = np.flatnonzero(np.ptp(data.joints, axis=0)) + 1
    for stem in ("dir", "travel", "duty"):
        joints = [int(k) for k in moves if not np.any(data.columns.get(f"{stem}{k}", 1.0))]
        if joints:
            names = {f"{stem}{k}" for k in joints}
            columns = {name: values for name, values in data.columns.items() if name not in names}
            data = data.noting(
                f"{_unrecorded(stem, joints)} 0 in all rows: taken as not recorded", columns=columns
            )
    return data


def _unrecorded(stem: str, joints: list[int]) -> str:
    return f"{span(stem, joints)} {'is' if len(joints) == 1 else 'are'}"


def without_fixed_targets(data: Dataset) -> Dataset:
    """`data` without the rows of reflectors that are not mounted on the arm, and a note that says so."""
    fixed = fixed_targets(data)
    if not fixed:
        return data
    codes = data.columns["target"].astype(np.int64)
    keep = ~np.isin(codes, fixed)
    kept = data.take(keep)
    # Codes are renumbered without gaps, as the fitter estimates a tool for each code.
    left, recoded = np.unique(codes[keep], return_inverse=True)
    columns = {**kept.columns, "target": recoded.astype(np.float64)}
    names = data.labels["target"]
    labels = {**data.labels, "target": [names[code] for code in left]}
    words = ", ".join(f"'{names[code]}'" for code in fixed)
    gone = int((~keep).sum())
    are = "is" if gone == 1 else "are"
    note = (
        f"target {words} does not move with the arm; its {plural(gone, 'row')} {are} left out "
        "(armtrue check says whether it drifted)"
    )
    return kept.noting(note, columns=columns, labels=labels)


def _require_columns(layout: Layout, path: Path, robot: Robot, need_position: bool) -> None:
    names = layout.names()
    required = [*(f"q{k}" for k in robot.motors), *(POSITION if need_position else ())]
    for name in required:
        if name not in names:
            present = [own for own in required if own in names and (own in POSITION) == (name in POSITION)]
            others = f" beside {', '.join(present)}" if present else ""
            near = did_you_mean(name, layout.unused)
            found = f"{path}: found no column '{name}'{'' if near else others}, expected it{near}"
            # A file that has the others under their names is in the contract's form, and only lacks this one.
            if path != layout.file or (others and not near):
                raise InputError(found)
            raise foreign(found, path, robot)
    for group in (QUATERNION, POSITION):
        missing = [name for name in group if name not in names]
        if missing and len(missing) < len(group):
            raise InputError(
                f"{path}: found no column '{missing[0]}', expected all of {', '.join(group)} or none"
            )


def _variables_of_others(layout: Layout, names: ColumnNames) -> dict[str, str]:
    """Columns outside the contract whose names are valid in an expression: name → header."""
    reserved = {*state_names(names.robot), *layout.names(), *names.all(), *EXPRESSION_WORDS}
    result: dict[str, str] = {}
    for header in layout.unused:
        name = contract_name(header)
        if name.isidentifier() and name.isascii() and name not in reserved and name not in result:
            result[name] = header
    return result


def _numbers(texts: list[str]) -> NDArray[np.float64] | None:
    """Texts as finite numbers, or None if one of them is not a finite number."""
    try:
        values = np.array([float(text) for text in texts])
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def _assemble(path: Path, layout: Layout, names: ColumnNames, skipped: dict[int, str]) -> Dataset:
    number_headers = {source.header for source in layout.numbers.values()}
    if layout.rotation:
        number_headers |= set(layout.rotation.headers)
    text_headers = set(layout.texts.values()) | set(layout.rows.where)
    if layout.time and layout.time.header:
        text_headers.add(layout.time.header)
    others = _variables_of_others(layout, names)
    directions_of = {
        name: source.header
        for name, source in layout.numbers.items()
        if name.startswith("dir") and names.kind(name)
    }
    raw = read_columns(
        layout.file,
        layout.dialect,
        sorted(number_headers),
        sorted(text_headers | set(others.values())),
        {*skipped, *layout.rows.skip},
        may_be_empty=set(directions_of.values()),
    )
    raw = _filtered(raw, layout)
    columns = {
        name: raw.numbers[source.header] * source.factor + source.added
        for name, source in layout.numbers.items()
        if source.header in raw.numbers
    }
    columns |= {name: np.full(raw.rows.size, value) for name, value in layout.constants.items()}
    variables = {
        name: values for name, header in others.items() if (values := _numbers(raw.texts[header])) is not None
    }
    columns |= variables
    taken = {others[name] for name in variables}
    notes = [
        f"{layout.file.name}: column '{header}' {_why_apart(header, header in taken, raw, names, layout)}"
        for header in layout.unused
        if not (names.of_one_effect(header) and header in taken)
    ]
    if empty := sorted(int(name[3:]) for name in directions_of if name not in columns):
        notes.append(
            f"{layout.file.name}: {_unrecorded('dir', empty)} empty in all rows: taken as not recorded"
        )
    notes += [f"left out: {why}" for why in skipped.values()]
    if layout.time:
        columns["time"] = _times(layout.time, raw, layout, notes)
    if layout.rotation:
        columns |= dict(zip(QUATERNION, _quaternions(layout.rotation, raw).T, strict=True))
    labels: dict[str, list[str]] = {}
    for name, header in layout.texts.items():
        texts = _named(name, header, raw, layout)
        if texts:
            number: dict[str, int] = {}
            columns[name] = np.array(
                [number.setdefault(text, len(number)) for text in texts], dtype=np.float64
            )
            labels[name] = list(number)
    turns = None
    if layout.rotation and layout.rotation.form == "euler":
        turns = _rotation_values(layout.rotation, raw)
    data = Dataset(path, layout.file, columns, raw.rows, labels, notes, layout.rotation, turns, dict(skipped))
    if layout.sort_by == "time":
        order = np.argsort(columns["time"], kind="stable")
        if not np.array_equal(order, np.arange(order.size)):
            data = data.take(order).noting("rows were not in order of time and are sorted by it")
    if "dir" in layout.from_order:
        data.columns.update(directions(data.columns))
    return data


def _why_apart(header: str, taken: bool, raw: RawColumns, names: ColumnNames, layout: Layout) -> str:
    """The words of the note on a column that is not one of the contract's."""
    if names.of_one_effect(header):
        return (
            f"holds more than numbers, expected them in all rows, and is not used: {_no_number(header, raw)}"
        )
    why = "" if taken else _why_unused(header, raw, names)
    use = f"not used: {why}" if why else "a variable for custom effects and the search"
    absent = [name for name in names.all() if name not in layout.names()]
    # Strict, as short names share half their letters with many words.
    likely = [
        name for name in absent if SequenceMatcher(None, header.lower(), name.lower()).ratio() >= _ALIKE
    ]
    return f"is not one of the contract's and is {use}{did_you_mean(header, likely)}"


def _why_unused(header: str, raw: RawColumns, names: ColumnNames) -> str:
    """Why a column that is not the contract's cannot be a variable of expressions either."""
    name = contract_name(header)
    if name in EXPRESSION_WORDS:
        return f"'{name}' is a word of expressions, expected a name of its own"
    if name in state_names(names.robot):
        return f"'{name}' is a state variable, expected a name of its own"
    if not (name.isidentifier() and name.isascii()):
        return "expressions have no such name, expected letters, digits and underscores"
    if header in raw.texts and (found := _no_number(header, raw)):
        return f"{found}, expected numbers in all rows"
    return f"'{name}' stands for another column already"


def _no_number(header: str, raw: RawColumns) -> str:
    """The first row of column `header` without a number and its content, in words; empty if all hold numbers."""
    for text, row in zip(raw.texts.get(header, []), raw.rows, strict=False):
        if _numbers([text]) is None:
            return f"row {row} holds {shorten(text) if text else 'nothing'}"
    return ""


def _filtered(raw: RawColumns, layout: Layout) -> RawColumns:
    wanted = layout.rows
    keep = (raw.rows >= wanted.first) & (raw.rows <= wanted.last) & ~np.isin(raw.rows, list(wanted.skip))
    for header, value in wanted.where.items():
        keep &= np.array([text == value for text in raw.texts[header]], dtype=bool)
    if keep.all():
        return raw
    kept = np.flatnonzero(keep)
    return RawColumns(
        {name: values[kept] for name, values in raw.numbers.items()},
        {name: [texts[i] for i in kept] for name, texts in raw.texts.items()},
        raw.rows[kept],
    )


def _named(name: str, header: str, raw: RawColumns, layout: Layout) -> list[str]:
    """The texts of a text column, none if all cells are empty. A row without `repeat` gets a name of its own."""
    texts = raw.texts[header]
    if all(texts) or not any(texts):
        return texts if any(texts) else []
    if name == "repeat":
        return [text or f"row {row}" for text, row in zip(texts, raw.rows, strict=True)]
    row = int(raw.rows[texts.index("")])
    raise RowError(
        row, f"{layout.file} row {row} column {header}: found nothing, expected the reflector's name"
    )


def _times(source: TimeSource, raw: RawColumns, layout: Layout, notes: list[str]) -> Array:
    """Seconds: since `origin` where it is given, else since the earliest row."""
    if source.header is None or source.pattern is None:
        return np.arange(raw.rows.size, dtype=np.float64) * source.seconds_per_row
    stamps = [
        _timestamp(text, source.pattern, f"{layout.file} row {row} column {source.header}", int(row))
        for text, row in zip(raw.texts[source.header], raw.rows, strict=True)
    ]
    if not stamps:
        return np.empty(0)
    if source.origin is not None:
        origin = _timestamp(source.origin, source.pattern, "time.origin", None)
    else:
        origin = min(stamps)
        notes.append(f"{layout.file.name}: time counts from the earliest row, {origin}")
    return np.array([(stamp - origin).total_seconds() for stamp in stamps])


def _timestamp(text: str, pattern: str, place: str, row: int | None) -> datetime.datetime:
    """The time written in `text`; `row`: its row of the file, None if it is not from the file."""
    try:
        return read_stamp(text, pattern)
    except (ValueError, OverflowError):
        message = f"{place}: found {shorten(text)}, expected a time in the format {pattern}"
        raise (InputError(message) if row is None else RowError(row, message)) from None
    except Exception as error:  # strptime builds a regular expression of the pattern, which may not compile
        raise InputError(
            f"{place}: found time format {pattern!r}, expected a strptime pattern ({error})"
        ) from None


def _quaternions(source: RotationSource, raw: RawColumns) -> Array:
    """Quaternions (N, 4), w first, not yet normalised where the file has quaternions."""
    values = _rotation_values(source, raw)
    if source.form == "quaternion":
        return values if source.scalar_first else values[:, [3, 0, 1, 2]]
    if source.form == "euler":
        matrices = rotation.matrix_from_euler(values, source.sequence, source.intrinsic)
    elif source.form == "rotation_vector":
        matrices = rotation.matrix_from_rotation_vector(values)
    else:
        matrices = values.reshape(-1, 3, 3)
    return rotation.quaternion_from_matrix(matrices)


def _rotation_values(source: RotationSource, raw: RawColumns) -> Array:
    return np.column_stack([raw.numbers[header] for header in source.headers]) * source.factor


def _check_values(data: Dataset) -> None:
    """Refuse values that a column cannot hold, whatever the arm; bring quaternions to unit length."""
    columns = data.columns

    def refuse(place: str, values: Array, bad: NDArray[np.bool_], expected: str) -> None:
        if bad.any():
            at = int(np.argmax(bad))
            row = int(data.rows[at])
            message = f"{data.file} row {row} {place}{values[at]:.6g}, expected {expected}"
            raise RowError(row, message)

    for name, values in columns.items():
        found = f"column {name}: found "
        if name not in TEXT_COLUMNS:
            extreme = ~np.isfinite(values) | (np.abs(values) > 1e12)
            refuse(found, values, extreme, "a finite number of an ordinary size")
        if name.startswith("dir"):
            refuse(found, values, ~np.isin(values, (-1.0, 0.0, 1.0)), "-1, 0 or 1")
        if name == "sigma":
            refuse(found, values, values <= 0.0, "a standard deviation above 0")
        if name == "payload":
            refuse(found, values, values < 0.0, "kilograms, not negative")
    if "qw" in columns:
        quaternions = np.column_stack([columns[name] for name in QUATERNION])
        lengths = np.linalg.norm(quaternions, axis=1)
        wrong = np.abs(lengths - 1.0) > _QUATERNION_LENGTH_TOLERANCE
        refuse("columns qw, qx, qy, qz: found length ", lengths, wrong, "a unit quaternion")
        columns.update(zip(QUATERNION, (quaternions / lengths[:, None]).T, strict=True))
