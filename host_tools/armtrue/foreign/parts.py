"""One foreign file with the meaning of its columns, as numbers in SI units."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from armtrue.arrays import Array
from armtrue.errors import RowError
from armtrue.foreign.clocks import Clock
from armtrue.foreign.headers import Meaning
from armtrue.foreign.sheets import Sheet, to_float
from armtrue.io.columns import UNITS
from armtrue.io.delimited import is_number

# Columns whose cells may be words.
_TEXTS = ("time", "target", "repeat", "station", "nest")

# Absolute zero in Fahrenheit, and a figure above any temperature on an arm, even in kelvin.
_COLDEST, _HOTTEST = -459.68, 990.0


def in_si(values: Array, unit: str | None) -> Array:
    """`values` in SI units; without a unit they already are."""
    _, factor, added = UNITS[unit] if unit else ("", 1.0, 0.0)
    return values * factor + added


def point_axis(name: str, axis: str) -> str:
    """The key in `Part.units` of one axis of the points `name`."""
    return f"point {name} {axis}"


@dataclass
class Part:
    """One file with its meaning. `units`: contract name → unit as stated or guessed; `notes`: the reasons.

    `clock`: how the column of time is read, where there is one. `skipped`: the file's lines of rows left out.
    """

    sheet: Sheet
    meaning: Meaning
    units: dict[str, str] = field(default_factory=dict)
    clock: Clock | None = None
    notes: list[str] = field(default_factory=list)
    skipped: list[int] = field(default_factory=list)

    def leave_out_bad_rows(self) -> None:
        """Leave out the rows that cannot be read, with a note on each; `skipped` has their lines of the file.

        Errors: RowError where most of a column cannot be read.
        """
        numeric = [*self.meaning.joints.values()]
        numeric += [header for headers in self.meaning.rotations.values() for header in headers]
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
                numbered = zip(self.sheet.rows, self.sheet.numbers, strict=True)
                kept = [(row, number) for row, number in numbered if number != error.row]
                if not kept:
                    raise
                self.skipped.append(error.row)
                self.notes.append(f"left out: {str(error).removeprefix(f'{self.sheet.path} ')}")
                self.sheet = replace(self.sheet, rows=[r for r, _ in kept], numbers=[n for _, n in kept])

    def leave_out_dead_sensors(self) -> None:
        """Leave out temperature columns that hold a mark for a missing value in most rows."""
        for name, header in list(self.meaning.others.items()):
            cells = self.sheet.cells(header)
            marks = [cell for cell in cells if name.startswith("temp_") and self._is_mark(cell)]
            if 2 * len(marks) > len(cells):
                del self.meaning.others[name]
                self.meaning.left[header] = (
                    f"it holds {marks[0]}, a mark for a missing value, in {len(marks)} of {len(cells)} rows"
                )

    def _is_mark(self, cell: str) -> bool:
        """True for -999 and its like, which no thermometer on an arm shows in any unit."""
        if not is_number(cell, self.sheet.decimal):
            return False
        return not _COLDEST < to_float(cell, self.sheet.decimal) < _HOTTEST

    def numbers(self, header: str) -> Array:
        """One column as numbers. Errors: RowError naming the first cell with no number, or a mark for a missing one."""
        sheet = self.sheet
        cells = sheet.cells(header)
        thermometer = any(own.startswith("temp_") for own, of in self.meaning.others.items() if of == header)
        for cell, row in zip(cells, sheet.numbers, strict=True):
            if not is_number(cell, sheet.decimal):
                found = f"'{cell}'" if cell else "nothing"
                raise RowError(
                    row, f"{sheet.path} row {row} column {header}: found {found}, expected a number"
                )
            if thermometer and self._is_mark(cell):
                raise RowError(
                    row,
                    f"{sheet.path} row {row} column {header}: found {cell}, a mark for a missing value, expected a "
                    "temperature",
                )
        return sheet.figures(header)

    def in_si(self, name: str, header: str) -> Array:
        """One column in SI units by the unit that was found for `name`."""
        return in_si(self.numbers(header), self.units.get(name))

    def seconds(self) -> Array:
        """Seconds of each row of a sheet that has a clock."""
        assert self.clock is not None
        return self.clock.seconds(self.sheet, self.meaning.others["time"])

    def points_m(self, name: str) -> Array:
        """The points (N, 3) of one set."""
        axes = zip("xyz", self.meaning.points[name], strict=True)
        return np.column_stack([self.in_si(point_axis(name, axis), header) for axis, header in axes])
