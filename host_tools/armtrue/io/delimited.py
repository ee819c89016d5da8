"""Delimited text, streamed into float64 columns; errors name the row and column of the wrong cell."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError, RowError, did_you_mean, shorten
from armtrue.io.files import reading
from armtrue.units import plural

# Rows held as text at a time; limits the memory, as text takes about ten times as much as its numbers.
_ROWS_AT_A_TIME = 4096
_LARGEST_CELL_CHARACTERS = 200
_LONGEST_LINE = 1_000_000


@dataclass(frozen=True)
class Dialect:
    """How the file is written. `header_row` counts from 1; 0: no header, columns are then named 1, 2, 3…"""

    separator: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    header_row: int = 1


@dataclass(frozen=True)
class RawColumns:
    """Result of `read_columns`: numbers and texts by header, and the file row of each entry."""

    numbers: dict[str, Array]
    texts: dict[str, list[str]]
    rows: NDArray[np.int64]


def read_header(path: Path, dialect: Dialect) -> list[str]:
    """Return the header's names, trailing empty ones dropped.

    Errors: InputError when the file is missing, empty, or names a column twice.
    """
    with _opened(path, dialect) as rows:
        return rows.header


def read_columns(
    path: Path,
    dialect: Dialect,
    numbers: list[str],
    texts: list[str],
    without: Container[int] = (),
    may_be_empty: Container[str] = (),
) -> RawColumns:
    """Read the columns `numbers` as finite float64 and `texts` as stripped text; other columns are ignored.

    `without`: file rows that are not read. `may_be_empty`: those of `numbers` that are left out of the result if all
    their cells are empty. Errors: RowError naming row and column of the first wrong cell, or a ragged row; InputError
    for a name not in the header.
    """
    with _opened(path, dialect, without) as rows:
        index = {name: rows.index(name) for name in [*numbers, *texts]}
        empty = {name for name in numbers if name in may_be_empty}
        # Left to right, so that the first wrong cell of a row is the one named.
        numbers = sorted(numbers, key=index.__getitem__)
        number_parts: dict[str, list[Array]] = {name: [] for name in numbers}
        text_parts: dict[str, list[str]] = {name: [] for name in texts}
        row_numbers: list[int] = []
        for block, at in rows.blocks():
            columns = list(zip(*block, strict=True))
            for name in numbers:
                cells, places = columns[index[name]], at
                if name in empty:
                    if not "".join(cells).strip():
                        continue
                    empty.remove(name)
                    if row_numbers:
                        # The column was empty in all earlier blocks: its first cell is the wrong one.
                        cells, places = ("", *cells), [row_numbers[0], *at]
                number_parts[name].append(_to_floats(cells, places, name, path, dialect))
            for name in texts:
                text_parts[name].extend(cell.strip() for cell in columns[index[name]])
            row_numbers.extend(at)
    nothing = np.empty(0)
    if not row_numbers:
        empty.clear()
    return RawColumns(
        {
            name: np.concatenate(parts) if parts else nothing
            for name, parts in number_parts.items()
            if name not in empty
        },
        text_parts,
        np.array(row_numbers, dtype=np.int64),
    )


@contextmanager
def _opened(path: Path, dialect: Dialect, without: Container[int] = ()) -> Iterator[_Rows]:
    if path.is_dir():
        raise InputError(f"{path}: found a folder, expected a file of measurements")
    # utf-8-sig drops the byte order mark that spreadsheets write first.
    encoding = "utf-8-sig" if dialect.encoding.lower() in ("utf-8", "utf8") else dialect.encoding
    try:
        with reading(path):
            stream = path.open(newline="", encoding=encoding)
    except LookupError:
        raise InputError(
            f"{path}: found encoding '{dialect.encoding}', expected one that Python knows"
        ) from None
    with stream:
        yield _Rows(path, dialect, without, stream)


class _Rows:
    """The open file: header first, then blocks of rows of equal length with their numbers."""

    def __init__(self, path: Path, dialect: Dialect, without: Container[int], stream: TextIO) -> None:
        self._path = path
        self._dialect = dialect
        self._without = without
        self._stream = stream
        self._reader = csv.reader(self._lines(), delimiter=dialect.separator)
        self.header = self._read_header()

    def index(self, name: str) -> int:
        if name not in self.header:
            hint = did_you_mean(name, self.header) or f" (found: {shorten(', '.join(self.header), 120)})"
            raise InputError(f"{self._path}: found no column '{name}'{hint}")
        return self.header.index(name)

    def _read_header(self) -> list[str]:
        for _ in range(self._dialect.header_row - 1):
            next(self._cells(), None)
        if self._dialect.header_row == 0:
            first = next(self._cells(), [])
            self._stream.seek(0)
            self._reader = csv.reader(self._lines(), delimiter=self._dialect.separator)
            header = [str(number) for number in range(1, len(first) + 1)]
        else:
            header = [name.strip() for name in next(self._cells(), [])]
            while header and not header[-1]:
                header.pop()
        if any("\0" in name for name in header):
            raise InputError(
                f"{self._path}: found UTF-16 text, expected {self._dialect.encoding}: "
                "write 'encoding: utf-16-le' into its dataset.yaml"
            )
        if not header:
            raise InputError(f"{self._path}: found no header row, expected the names of the columns")
        for number, name in enumerate(header, start=1):
            if name in header[: number - 1]:
                raise InputError(
                    f"{self._path} header: found column '{name}' a second time, expected it once"
                )
        return header

    def _lines(self) -> Iterator[str]:
        """Lines, limited in length so that a file without line breaks is not read into memory whole."""
        while line := self._stream.readline(_LONGEST_LINE + 1):
            if len(line) > _LONGEST_LINE:
                raise InputError(
                    f"{self._path}: found a line of more than {_LONGEST_LINE} characters, expected rows of a table"
                )
            yield line

    def _cells(self) -> Iterator[list[str]]:
        """Rows as lists of cells; errors of the CSV reader become InputErrors that name the row."""
        while True:
            try:
                yield next(self._reader)
            except StopIteration:
                return
            except csv.Error as error:
                raise InputError(
                    f"{self._path} row {self._reader.line_num}: found no readable row ({error})"
                ) from None
            except UnicodeDecodeError as error:
                # Text is decoded in blocks, each after all lines before it were read.
                row = self._reader.line_num + 1 + error.object.count(b"\n", 0, error.start)
                raise InputError(
                    f"{self._path} row {row}: found byte 0x{error.object[error.start]:02x}, "
                    f"expected {self._dialect.encoding} text: say what it is in a dataset.yaml, as in "
                    "'encoding: latin-1', or let 'armtrue init' write one"
                ) from None
            except UnicodeError as error:
                raise InputError(f"{self._path}: found no {self._dialect.encoding} text ({error})") from None

    def _even_rows(self) -> Iterator[tuple[list[str], int]]:
        width = len(self.header)
        for cells in self._cells():
            if self._reader.line_num in self._without or not "".join(cells).strip():
                continue
            while len(cells) > width and not cells[-1].strip():
                cells.pop()
            if len(cells) != width:
                raise RowError(
                    self._reader.line_num,
                    f"{self._path} row {self._reader.line_num}: found {plural(len(cells), 'cell')}, "
                    f"expected {width} as in the header",
                )
            yield cells, self._reader.line_num

    def blocks(self) -> Iterator[tuple[list[list[str]], list[int]]]:
        rows = self._even_rows()
        while block := list(itertools.islice(rows, _ROWS_AT_A_TIME)):
            yield [cells for cells, _ in block], [number for _, number in block]


def _to_floats(cells: tuple[str, ...], at: list[int], name: str, path: Path, dialect: Dialect) -> Array:
    comma = dialect.decimal == ","
    try:
        text = [cell.replace(".", "?").replace(",", ".") for cell in cells] if comma else cells
        values = np.array(list(map(float, text)))
        if np.isfinite(values).all() and "_" not in "".join(cells):
            return values
    except ValueError:
        pass
    # The fast conversion failed: find the cell to report.
    for cell, row in zip(cells, at, strict=True):
        if not is_number(cell, dialect.decimal):
            found = shorten(cell.strip()) if cell.strip() else "nothing"
            kind = "a number with a decimal comma" if comma else "a number"
            if len(cells) > 1 and not any(is_number(other, dialect.decimal) for other in cells):
                raise InputError(
                    f"{path} row {row} column {name}: found {found}, expected {kind}, and no other row has one: say in "
                    "a dataset.yaml how it is written, as by 'decimal' or the 'format' of a time, or let 'armtrue "
                    "init' write one"
                )
            raise RowError(row, f"{path} row {row} column {name}: found {found}, expected {kind}")
    raise AssertionError("a block that does not convert holds a cell that is no number")


def is_number(cell: str, decimal: str) -> bool:
    """True where `cell` is one finite number written with the mark `decimal`."""
    if "_" in cell or len(cell) > _LARGEST_CELL_CHARACTERS or (decimal == "," and "." in cell):
        return False
    try:
        return bool(np.isfinite(float(cell.replace(",", ".") if decimal == "," else cell)))
    except ValueError:
        return False
