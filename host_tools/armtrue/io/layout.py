"""Layout of a file of measurements: the contract's CSV, or as a dataset.yaml describes it (docs/files.md)."""

from __future__ import annotations

import datetime
import re
import shlex
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from armtrue.errors import ForeignError, InputError, did_you_mean
from armtrue.io.columns import POSITION, QUATERNION, UNITS, ColumnNames, contract_name
from armtrue.io.delimited import Dialect, read_header
from armtrue.io.files import named_in
from armtrue.io.model import EXPRESSION_WORDS, state_names
from armtrue.io.robot import Robot
from armtrue.io.yamlfile import Section, load_yaml

SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " ", "pipe": "|"}
ROTATION_FORMS = {"quaternion": 4, "euler": 3, "rotation_vector": 3, "matrix": 9}
TURNS = [a + b + c for a in "xyz" for b in "xyz" for c in "xyz" if a != b != c]
# Some programs write units of 100 ns; strptime reads no more than microseconds.
_BEYOND_MICROSECONDS = re.compile(r"(:\d\d[.,]\d{6})\d+")


@dataclass(frozen=True)
class NumberSource:
    """A column of numbers: SI value = cell × factor + added."""

    header: str
    factor: float = 1.0
    added: float = 0.0


@dataclass(frozen=True)
class TimeSource:
    """`header` with a strptime `pattern`, or, without a header, the order of rows at `seconds_per_row`."""

    header: str | None
    pattern: str | None = None
    origin: str | None = None
    seconds_per_row: float = 1.0


def read_stamp(text: str, pattern: str) -> datetime.datetime:
    """The time that `text` gives in a strptime `pattern`; in UTC if it has a time zone.

    If the pattern has a fraction of a second, the text may lack it, as programs leave `.000` out. Errors: ValueError if
    `text` does not match the pattern.
    """
    if "%f" in pattern:
        text = _BEYOND_MICROSECONDS.sub(r"\1", text)
    try:
        stamp = datetime.datetime.strptime(text, pattern)
    except ValueError:
        whole = pattern.replace(".%f", "").replace(",%f", "")
        if whole == pattern:
            raise
        stamp = datetime.datetime.strptime(text, whole)
    return stamp if stamp.tzinfo is None else stamp.astimezone(datetime.UTC).replace(tzinfo=None)


@dataclass(frozen=True)
class RotationSource:
    """Columns of the rotation of measuring_from_tool, with their form (`ROTATION_FORMS`) and its conventions."""

    headers: list[str]
    form: str
    factor: float = 1.0
    sequence: str = "xyz"
    intrinsic: bool = True
    scalar_first: bool = True


@dataclass(frozen=True)
class RowFilter:
    """File rows to read: `first` to `last`, without `skip`, and only those with the texts `where` (header → text)."""

    first: int = 1
    last: int = 2**62
    skip: frozenset[int] = frozenset()
    where: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Layout:
    """Everything that turns one file into the contract's columns."""

    file: Path
    dialect: Dialect
    numbers: dict[str, NumberSource]
    texts: dict[str, str]
    constants: dict[str, float] = field(default_factory=dict)
    time: TimeSource | None = None
    rotation: RotationSource | None = None
    sort_by: str | None = None
    # Which of `dir` and `travel` are to be derived from the order of the rows.
    from_order: frozenset[str] = frozenset()
    rows: RowFilter = field(default_factory=RowFilter)
    # Columns of the file that are not the contract's.
    unused: list[str] = field(default_factory=list)

    def without_measurements(self) -> Layout:
        """This layout without the columns that the instrument measured: their content is not read."""
        measured = (*POSITION, *QUATERNION, "sigma", "repeat")
        return replace(
            self,
            numbers={name: source for name, source in self.numbers.items() if name not in measured},
            texts={name: header for name, header in self.texts.items() if name not in measured},
            constants={name: value for name, value in self.constants.items() if name not in measured},
            rotation=None,
        )

    def names(self) -> set[str]:
        """The contract's columns that this file yields, derived ones left out."""
        rotation = QUATERNION if self.rotation else ()
        time = ("time",) if self.time else ()
        return {*self.numbers, *self.texts, *self.constants, *rotation, *time}


def foreign(found: str, path: Path, robot: Robot) -> ForeignError:
    """The error for a file that is not in the contract's form, with the shell command that reads it."""
    arm = shlex.quote(str(robot.path or "robot.yaml"))
    folder = shlex.quote(str(path.with_suffix("")))
    return ForeignError(found, f"armtrue init {shlex.quote(str(path))} --robot {arm} --out {folder}")


def _refuse_foreign_bytes(path: Path, robot: Robot) -> None:
    try:
        with path.open("rb") as stream:
            begins = stream.read(4)
    except (OSError, ValueError):
        return  # `read_header` reports the error
    if begins in (b"PK\x03\x04", b"\xd0\xcf\x11\xe0"):
        raise foreign(f"{path}: found a spreadsheet, expected a CSV", path, robot)
    # Letters of a header as UTF-16 have a zero in every other byte.
    if begins[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0\0" in (begins[::2], begins[1::2]):
        raise foreign(f"{path}: found UTF-16 text, expected UTF-8", path, robot)
    if b"\0" in begins:
        raise InputError(f"{path}: found bytes that are no text, expected a CSV")


def contract_layout(path: Path, robot: Robot) -> Layout:
    """Layout of a CSV in the contract's own form, from its header.

    Errors: InputError for a joint beyond the arm, or a header that is not the contract's separator.
    """
    dialect = Dialect()
    if path.is_file():
        _refuse_foreign_bytes(path, robot)
    header = read_header(path, dialect)
    names = ColumnNames(robot)
    if len(header) == 1 and any(mark in header[0] for mark in ";\t|"):
        raise foreign(f"{path} header: found no comma, expected columns separated by commas", path, robot)
    numbers: dict[str, NumberSource] = {}
    texts: dict[str, str] = {}
    unused: list[str] = []
    for own in header:
        name = contract_name(own)
        kind = names.kind(name)
        if name in numbers:
            raise InputError(
                f"{path} header: found column '{own}', which reads as {name} a second time, expected it once"
            )
        if names.joint_beyond_arm(name):
            raise InputError(
                f"{path} header: found column '{name}', expected joints 1 to {robot.joint_count}: take the column out, "
                "or name the arm that has this joint"
            )
        if kind is None or names.of_one_effect(name):
            unused.append(own)
        elif kind == "text":
            texts[name] = own
        else:
            numbers[name] = NumberSource(own)
    return Layout(path, dialect, numbers, texts, unused=unused)


def yaml_layout(path: Path, robot: Robot) -> Layout:
    """Layout of the file that the dataset.yaml at `path` describes.

    Errors: InputError naming the key.
    """
    top = load_yaml(path)
    names = ColumnNames(robot)
    file = named_in(path, top.text("file", expected="the name of a CSV file"))
    columns = _Columns(top.section("columns"), names)
    layout = Layout(
        file=file,
        dialect=_dialect(top),
        numbers=columns.numbers | _variables(top, names),
        texts=columns.texts,
        constants=columns.constants,
        time=_time(top),
        rotation=_rotation(top),
        sort_by=top.choice("sort_by", ["time", "row"], default="row"),
        from_order=_from_order(top),
        rows=_row_filter(top),
    )
    top.finish()
    if layout.sort_by == "time" and "time" not in layout.names():
        raise top.fail("sort_by", "'row', as no time is given")
    if layout.time and "time" in columns.numbers:
        raise InputError(f"{top.place('time')}: found beside columns.time, expected the time once")
    return layout


def _variables(top: Section, names: ColumnNames) -> dict[str, NumberSource]:
    """The key `variables`: the user's own names for expressions, and the headers of their columns."""
    section = top.optional("variables")
    taken = {*EXPRESSION_WORDS, *state_names(names.robot), *names.all()}
    for name in section:
        if not (name.isidentifier() and name.isascii()) or names.kind(name) is not None or name in taken:
            raise InputError(
                f"{section.place(name)}: found '{name}', expected a name of letters, digits and underscores that is "
                "not taken by a column, a state variable or a function"
            )
    return {name: NumberSource(section.text(name, expected="the header of a column")) for name in section}


def _dialect(top: Section) -> Dialect:
    expected = "one character, or comma, semicolon, tab, space or pipe"
    separator = top.text("separator", default=",", expected=expected)
    separator = SEPARATORS.get(separator, separator)
    if len(separator) != 1 or separator in '\r\n"':
        raise top.fail("separator", expected)
    decimal = top.choice("decimal", [".", ","], default=".")
    if decimal == separator:
        raise top.fail("decimal", "a mark other than the separator")
    row = "a row number, or 0 for none"
    header_row = top.number("header_row", default=1.0, minimum=0.0, expected=row)
    if header_row != int(header_row) or header_row > 1e6:
        raise top.fail("header_row", row)
    return Dialect(separator, decimal, top.text("encoding", default="utf-8"), int(header_row))


class _Columns:
    """The section `columns`: contract name → header, or {column, unit, scale, offset}, or {constant}."""

    def __init__(self, section: Section, names: ColumnNames) -> None:
        self.numbers: dict[str, NumberSource] = {}
        self.texts: dict[str, str] = {}
        self.constants: dict[str, float] = {}
        for name in section:
            kind = names.kind(name)
            if names.joint_beyond_arm(name):
                raise InputError(
                    f"{section.place(name)}: found a joint that the arm has not, expected joints "
                    f"1 to {names.robot.joint_count}"
                )
            if kind is None:
                hint = did_you_mean(name, names.all())
                raise InputError(
                    f"{section.place(name)}: found '{name}', expected a column of the contract{hint}"
                )
            if kind == "text":
                self.texts[name] = section.text(name, expected="the header of a column")
            elif isinstance(section.raw(name), dict):
                self._read_entry(name, kind, section.section(name))
            else:
                self.numbers[name] = NumberSource(section.text(name, expected="the header of a column"))

    def _read_entry(self, name: str, kind: str, entry: Section) -> None:
        if entry.has("constant"):
            factor, added = _unit(entry, kind)
            self.constants[name] = entry.number("constant") * factor + added
        else:
            header = entry.text("column", expected="the header of a column, or 'constant'")
            factor, added = _unit(entry, kind)
            scale = entry.number("scale", default=1.0)
            self.numbers[name] = NumberSource(
                header, factor * scale, added * scale + entry.number("offset", default=0.0)
            )


def _unit(section: Section, kind: str) -> tuple[float, float]:
    """Factor and addend of the key `unit`; left out, the column is in the contract's own unit."""
    fitting = [unit for unit, (of_kind, _, _) in UNITS.items() if of_kind == kind]
    if not section.has("unit"):
        return 1.0, 0.0
    if not fitting:
        raise section.fail("unit", "no unit, as this column has none")
    _, factor, added = UNITS[section.choice("unit", fitting)]
    return factor, added


def _time(top: Section) -> TimeSource | None:
    if not top.has("time"):
        return None
    section = top.section("time")
    if section.has("from"):
        section.choice("from", ["rows"])
        step = section.number("seconds_per_row", default=1.0, above=0.0, expected="a time in seconds above 0")
        return TimeSource(None, seconds_per_row=step)
    header = section.text("column", expected="the header of a column, or 'from: rows'")
    pattern = section.text("format", expected="a strptime pattern such as %Y-%m-%d %H:%M:%S")
    return TimeSource(header, pattern, section.text("origin") if section.has("origin") else None)


def _rotation(top: Section) -> RotationSource | None:
    if not top.has("rotation"):
        return None
    section = top.section("rotation")
    form = section.choice("form", list(ROTATION_FORMS))
    count = ROTATION_FORMS[form]
    headers = section.texts("columns", f"a list of {count} headers")
    if len(headers) != count:
        raise section.fail("columns", f"a list of {count} headers")
    options: dict[str, Any] = {}
    if form in ("euler", "rotation_vector"):
        options["factor"] = UNITS[section.choice("unit", ["rad", "deg", "mrad"], default="rad")][1]
    if form == "euler":
        sequence = section.text("sequence", expected="three axes such as XYZ")
        if sequence.lower() not in TURNS:
            raise section.fail("sequence", "three axes such as XYZ, no two neighbours alike")
        options["sequence"] = sequence.lower()
        options["intrinsic"] = section.choice("axes", ["intrinsic", "extrinsic"]) == "intrinsic"
    if form == "quaternion":
        options["scalar_first"] = section.choice("order", ["wxyz", "xyzw"]) == "wxyz"
    return RotationSource(headers, form, **options)


def _from_order(top: Section) -> frozenset[str]:
    if not top.has("derive"):
        return frozenset()
    section: Section = top.section("derive")
    found = frozenset(name for name in ("dir", "travel") if section.has(name))
    for name in found or ("dir",):
        section.choice(name, ["from_order"])
    return found


def _row_filter(top: Section) -> RowFilter:
    section = top.optional("rows")
    row = "a row number of the file, the header's being 1"
    first = section.number("from", default=1.0, minimum=1.0, expected=row)
    last = section.number("to", default=float(2**62), minimum=first, expected=row + ", not before 'from'")
    skip = section.numbers("skip", None, "a list of row numbers of the file", default=[])
    conditions = section.optional("where")
    where = {header: conditions.text(header) for header in conditions}
    return RowFilter(int(first), int(last), frozenset(map(int, skip)), where)
