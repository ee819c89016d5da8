"""Foreign files as tables of cells: separator, decimal mark, encoding, header and row of units are detected."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.io.columns import UNITS
from armtrue.io.delimited import is_number
from armtrue.io.files import LARGEST_TEXT_BYTES, read_bytes

SEPARATORS = {";": "semicolon", "\t": "tab", ",": "comma", "|": "pipe"}
_COMMENTS = ("#", "%", "//", "!")
_THOUSANDS = {
    ",": re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d*)?$"),
    ".": re.compile(r"[-+]?\d{1,3}(\.\d{3})+(,\d*)?$"),
}
# Units in brackets, after a slash, or as a last word of their own.
_UNIT = re.compile(
    r"[\[(<{]\s*([^\])>}]+?)\s*[\])>}]\s*$|/\s*([A-Za-z°µ]+)\s*$|"
    r"[_ ](mm|cm|um|µm|in|inch|rad|deg|degC|degF|K|ms|kg|lb|Nm)$"
)
# A cell with its unit behind the number: 12.345deg.
_QUANTITY = re.compile(r"([-+]?[\d.,]*\d[.,]?(?:[eE][-+]?\d+)?)\s*([A-Za-z°µ]+)$")
# A column has its unit in the cells if at least this share of them has.
_MOST_CELLS = 0.9
_UNIT_COMMENT = re.compile(r"\b(?:units?|einheit(?:en)?)\s*[:=]\s*(\S+)", re.IGNORECASE)
# What SpatialAnalyzer writes of a point, by default without a header.
_SPATIALANALYZER = ["Collection", "Group", "Target", "X", "Y", "Z"]
# Units as dataset.yaml names them, and how files write them.
_WRITTEN_AS = {
    "m": "m meter metre meters", "mm": "mm millimeter millimeters", "cm": "cm", "um": "um µm", "in": 'in inch inches "',
    "ft": "ft foot feet",
    "rad": "rad radian radians", "mrad": "mrad", "deg": "deg degree degrees ° grad", "degC": "°c c degc celsius",
    "K": "k kelvin", "degF": "°f f degf", "kg": "kg", "g": "g", "lb": "lb", "Nm": "nm n·m", "s": "s sec seconds",
    "ms": "ms", "min": "min", "h": "h",
}  # fmt: skip
_UNIT_WORDS = {word: unit for unit, words in _WRITTEN_AS.items() for word in words.split()}


@dataclass(frozen=True)
class Sheet:
    """One file's table: `header` names, `units` where the file states them, `rows` of cells, and how it is written.

    `numbers`: the file's line of each row. `direct`: True where a dataset.yaml can describe the file as it is.
    `thousands`: True where marks between thousands were taken out of the cells. `sources`: header → what states its
    unit, where that is not the header. `length_unit`: as a comment states it for the whole file. `note`: where the
    header comes from, if that is not the line above the rows.
    """

    path: Path
    header: list[str]
    units: dict[str, str]
    rows: list[list[str]]
    numbers: list[int]
    header_row: int
    decimal: str
    separator: str = ""
    encoding: str = ""
    direct: bool = False
    thousands: bool = False
    sources: dict[str, str] = field(default_factory=dict)
    length_unit: str | None = None
    note: str = ""

    @property
    def has_header(self) -> bool:
        """False where columns have no names but their numbers."""
        return self.header != _numbered(len(self.header))

    def cells(self, name: str) -> list[str]:
        """The cells of one column."""
        at = self.header.index(name)
        return [row[at] for row in self.rows]

    def is_numeric(self, name: str) -> bool:
        """True where every cell of a column is a number."""
        return all(is_number(cell, self.decimal) for cell in self.cells(name))

    def figures(self, name: str) -> Array:
        """The numbers of a column for which `is_numeric` is true."""
        return np.array([to_float(cell, self.decimal) for cell in self.cells(name)])

    def written(self, figures: Array) -> list[str]:
        """Figures as cells of this sheet."""
        return [f"{figure:.12g}".replace(".", self.decimal) for figure in figures]

    def with_columns(self, columns: dict[str, Sequence[str]], **changed: Any) -> Sheet:
        """This sheet with other columns: a dataset.yaml then cannot describe the file as it is."""
        rows = [list(row) for row in zip(*columns.values(), strict=True)]
        return replace(self, header=list(columns), rows=rows, direct=False, **changed)

    @property
    def columns(self) -> dict[str, Sequence[str]]:
        """The cells of each column."""
        return {name: self.cells(name) for name in self.header}


def read_sheet(path: Path) -> Sheet:
    """Read the table in `path`: CSV and its relatives, or XLSX. Errors: InputError where there is none."""
    if path.suffix.lower() in (".xlsx", ".xlsm"):
        cells = _workbook(path)
        return _sheet(path, cells, list(range(1, len(cells) + 1)), ".")[0]
    text, encoding = _text(path)
    lines = [(n, line) for n, line in enumerate(text.splitlines(), start=1) if line.strip()]
    comments = [(n, line.lstrip()) for n, line in lines if line.lstrip().startswith(_COMMENTS)]
    kept = [(n, line) for n, line in lines if not line.lstrip().startswith(_COMMENTS)]
    if not kept:
        raise InputError(f"{path}: found no rows, expected a table of measurements")
    separator = _separator([line for _, line in kept])
    cells = _split([line for _, line in kept], separator)
    if len(cells) != len(kept):
        raise InputError(f"{path}: found a line break within quotes, expected one row a line")
    bare, units = _without_units(cells)
    plain = _without_thousands(bare, separator)
    decimal = _decimal(plain, separator)
    sheet, whole = _sheet(path, plain, [n for n, _ in kept], decimal)
    direct = whole and separator != " " and not comments and plain == cells
    sheet = replace(sheet, separator=separator, encoding=encoding, direct=direct)
    if not sheet.has_header:
        sheet = _named_by_comment(sheet, [(n, line) for n, line in comments if n < kept[0][0]])
    if not sheet.has_header:
        sheet = _as_spatialanalyzer(sheet)
    in_cells = {sheet.header[at]: unit for at, unit in units.items()}
    return replace(
        sheet,
        thousands=plain != bare,
        units=sheet.units | in_cells,
        sources=dict.fromkeys(in_cells, "as its cells say"),
        length_unit=_length_unit([line for _, line in comments]),
    )


def to_float(cell: str, decimal: str) -> float:
    """The number in `cell`, for which `is_number` is true."""
    return float(cell.replace(",", ".") if decimal == "," else cell)


def split_unit(name: str) -> tuple[str, str | None]:
    """`("q1", "rad")` for `q1 [rad]`; the unit is None where the name has none that is known."""
    match = _UNIT.search(name)
    unit = unit_of(next(group for group in match.groups() if group)) if match else None
    return (name[: match.start()].strip(), unit) if match and unit else (name, None)


def unit_of(word: str) -> str | None:
    """The unit that `word` writes, as dataset.yaml names it."""
    return _UNIT_WORDS.get(word.strip().strip("[]()").lower())


def _text(path: Path) -> tuple[str, str]:
    content = read_bytes(path, largest_bytes=LARGEST_TEXT_BYTES)
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace"), "utf-16"
    # UTF-16 without a byte-order mark: every other byte of the header's plain letters is zero.
    for encoding, zeros in (("utf-16-le", content[1:64:2]), ("utf-16-be", content[0:64:2])):
        if zeros and not any(zeros):
            return content.decode(encoding, errors="replace"), encoding
    if b"\0" in content[:4096]:
        raise InputError(f"{path}: found bytes that are no text, expected a CSV, its relatives, or an XLSX")
    try:
        return content.decode("utf-8-sig"), "utf-8"
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace"), "cp1252"


def _separator(lines: list[str]) -> str:
    """The mark that gives the largest share of numbers, among those that cut most lines into equally many cells."""
    sample = lines[-200:]

    def score(mark: str) -> tuple[float, int]:
        rows = _split(sample, mark)
        width, count = Counter(len(row) for row in rows).most_common(1)[0]
        if width < 2 or count < 0.8 * len(rows):
            return (0.0, 0)
        cells = [cell for row in rows for cell in row if cell]
        numbers = sum(any(is_number(cell, decimal) for decimal in ".,") for cell in cells)
        numbers += sum(any(pattern.match(cell) for pattern in _THOUSANDS.values()) for cell in cells)
        numbers += sum(_quantity(cell) is not None for cell in cells)
        # If commas are decimal marks, splitting at commas cuts numbers in two: the comma is the last choice.
        return (numbers / max(1, len(cells)), -len(SEPARATORS) if mark == "," else 0)

    return max([*SEPARATORS, " "], key=score)


def _split(lines: list[str], separator: str) -> list[list[str]]:
    if separator == " ":
        return [line.split() for line in lines]
    return [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=separator)]


def _quantity(cell: str) -> tuple[str, str] | None:
    """`("12.345", "deg")` for `12.345deg`; None where the cell is anything else."""
    match = _QUANTITY.match(cell)
    unit = unit_of(match[2]) if match else None
    return (match[1], unit) if match and unit else None


def _without_units(cells: list[list[str]]) -> tuple[list[list[str]], dict[int, str]]:
    """`cells` without the units behind their numbers, and the unit of each column (by its place) that had some.

    Rows of the first half may be titles, so the second half tells.
    """
    width = Counter(len(row) for row in cells).most_common(1)[0][0]
    rows = [row for row in cells[len(cells) // 2 :] if len(row) == width]
    units = {}
    for at in range(width):
        found = Counter(quantity[1] for row in rows if (quantity := _quantity(row[at])))
        for unit, count in found.most_common(1):
            if count >= _MOST_CELLS * len(rows):
                units[at] = unit
    if not units:
        return cells, {}

    def bare(at: int, cell: str) -> str:
        quantity = _quantity(cell) if at in units else None
        return quantity[0] if quantity and quantity[1] == units[at] else cell

    return [[bare(at, cell) for at, cell in enumerate(row)] for row in cells], units


def _without_thousands(cells: list[list[str]], separator: str) -> list[list[str]]:
    """`cells` without marks between thousands, if they are unambiguous: `1,234.5`, `1.234,5`.

    In a file with comma as the separator, a comma within a cell can be nothing else.
    """
    flat = [cell for row in cells for cell in row]
    for mark, pattern in _THOUSANDS.items():
        marked = [cell for cell in flat if pattern.match(cell)]
        if any(separator == mark or ("." in cell and "," in cell) for cell in marked):
            return [
                [cell.replace(mark, "") if pattern.match(cell) else cell for cell in row] for row in cells
            ]
    return cells


def _decimal(cells: list[list[str]], separator: str) -> str:
    if separator == ",":
        return "."
    flat = [cell for row in cells[1:200] for cell in row if cell]
    with_comma = sum("," in cell and is_number(cell, ",") for cell in flat)
    with_point = sum("." in cell and is_number(cell, ".") for cell in flat)
    return "," if with_comma > with_point else "."


def _sheet(path: Path, cells: list[list[str]], numbers: list[int], decimal: str) -> tuple[Sheet, bool]:
    """The table in `cells`, and whether it is all that follows a single line of names."""
    width = Counter(len(row) for row in cells).most_common(1)[0][0]
    # Cells that hold numbers; rows of None are of another width than the table.
    counts = [sum(is_number(cell, decimal) for cell in row) if len(row) == width else None for row in cells]
    # Half of the cells, or of those that are numbers in most rows: many exports have more words than numbers.
    usual = sorted(count for count in counts if count is not None)
    least = max(1.0, 0.5 * usual[len(usual) // 2])
    first = next((at for at, count in enumerate(counts) if count is not None and count >= least), None)
    if first is None:
        raise InputError(f"{path}: found no row of numbers, expected a table of measurements")
    header, units, header_row, plain = _header(path, cells[:first], numbers, width)
    rows = [(row, n) for row, n in zip(cells[first:], numbers[first:], strict=True) if len(row) == width]
    sheet = Sheet(path, header, units, [row for row, _ in rows], [n for _, n in rows], header_row, decimal)
    return sheet, plain and len(rows) == len(cells) - first


def _header(
    path: Path, above: list[list[str]], numbers: list[int], width: int
) -> tuple[list[str], dict[str, str], int, bool]:
    """Names of the columns, their units, the file's line of the names, and whether that line holds all of these.

    `above`: the rows before the first row of numbers.
    """
    wide = [at for at, row in enumerate(above) if len(row) >= width - 1]
    if not wide:
        return _numbered(width), {}, 0, True
    with_units = len(wide) > 1 and all(not cell or unit_of(cell) or cell == "-" for cell in above[wide[-1]])
    at = wide[-2] if with_units else wide[-1]
    header = _filled(above[at], width)
    plain = not with_units
    if at > 0 and _repeated(header):
        header, plain = _grouped(_filled(above[at - 1], width), header), False
    header = [name or f"column {k}" for k, name in enumerate(header, start=1)]
    if repeated := _repeated(header):
        raise InputError(f"{path} header: found column '{repeated}' a second time, expected it once")
    stated = [unit_of(cell) for cell in _filled(above[wide[-1]], width)] if with_units else []
    units = {name: unit for name, unit in zip(header, stated, strict=False) if unit}
    units |= {name: unit for name in header if (unit := split_unit(name)[1]) and name not in units}
    return header, units, numbers[at], plain


def _numbered(width: int) -> list[str]:
    """Names of columns that have none."""
    return [str(k) for k in range(1, width + 1)]


def _named_by_comment(sheet: Sheet, comments: list[tuple[int, str]]) -> Sheet:
    """`sheet` with the names of the last of `comments` (line, text) above it that has one for each column."""
    for number, line in reversed(comments):
        text = line.lstrip("".join(_COMMENTS))
        names = text.split() if sheet.separator == " " else text.split(sheet.separator)
        names = [name.strip().strip('"') for name in names]
        words = [name for name in names if name and not is_number(name, sheet.decimal)]
        if len(names) == len(set(words)) == len(sheet.header):
            units = {name: unit for name in names if (unit := split_unit(name)[1])}
            note = f"the header is read from a comment, line {number}"
            return replace(sheet, header=names, units=units, header_row=number, direct=False, note=note)
    return sheet


def _as_spatialanalyzer(sheet: Sheet) -> Sheet:
    """`sheet` under the names of SpatialAnalyzer's points, if its first columns can be nothing else.

    These are two of words, a name or whole number, and three of numbers.
    """
    if sheet.separator == " " or len(sheet.header) < len(_SPATIALANALYZER):
        return sheet
    names, more = sheet.header[: len(_SPATIALANALYZER)], sheet.header[len(_SPATIALANALYZER) :]
    collection, group, target = (
        [is_number(c, sheet.decimal) for c in sheet.cells(name)] for name in names[:3]
    )
    whole = all(cell.isdigit() for cell, figure in zip(sheet.cells(names[2]), target, strict=True) if figure)
    if any(collection) or any(group) or not whole or not all(map(sheet.is_numeric, names[3:])):
        return sheet
    header = [*_SPATIALANALYZER, *more]
    note = f"no header: columns are taken as {', '.join(_SPATIALANALYZER)}, as SpatialAnalyzer writes points"
    return replace(sheet, header=header, direct=False, note=note)


def _length_unit(comments: list[str]) -> str | None:
    """The unit of length that one of the comments states: `Units: Millimeters`."""
    for line in comments:
        match = _UNIT_COMMENT.search(line)
        unit = unit_of(match[1].rstrip(",;.")) if match else None
        if unit and UNITS[unit][0] == "length":
            return unit
    return None


def _filled(row: list[str], width: int) -> list[str]:
    return [*row, *[""] * width][:width]


def _repeated(header: list[str]) -> str | None:
    return next((name for name, count in Counter(header).items() if name and count > 1), None)


def _grouped(groups: list[str], header: list[str]) -> list[str]:
    """Header names that occur more than once get the group's title in front, as spreadsheets print it: `Ball 1 X`.

    `groups`: the row above the header, where each title stands only above the first of its columns.
    """
    often = {name for name, count in Counter(header).items() if count > 1}
    found, group = [], ""
    for word, name in zip(groups, header, strict=True):
        group = word or group
        found.append(f"{group} {name}".strip() if name in often and name else name)
    return found


def _workbook(path: Path) -> list[list[str]]:
    try:
        import openpyxl
    except ImportError:
        how = "pip install openpyxl, or export the sheet as CSV"
        raise InputError(f"{path}: found an XLSX, expected openpyxl to read it with: {how}") from None
    read_bytes(path, largest_bytes=LARGEST_TEXT_BYTES)
    try:
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        sheets = [list(sheet.iter_rows(values_only=True)) for sheet in book.worksheets]
    except Exception as error:
        raise InputError(f"{path}: cannot be read as an XLSX ({error})") from None
    texts = [[["" if cell is None else str(cell) for cell in row] for row in rows] for rows in sheets]
    return max(([row for row in rows if any(row)] for rows in texts), key=len) or [[""]]
