"""Clocks of foreign files: time stamps in many formats, and numbers that count seconds, milliseconds or days."""

from __future__ import annotations

import datetime
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.foreign.sheets import Sheet
from armtrue.io.columns import UNITS
from armtrue.io.layout import read_stamp
from armtrue.units import plural

# Origin of all clocks with a date, so that the clocks of several files can be compared.
_BEGIN = datetime.datetime(2000, 1, 1)
_UNIX_BEGIN = (datetime.datetime(1970, 1, 1) - _BEGIN).total_seconds()
_EXCEL_BEGIN = (datetime.datetime(1899, 12, 30) - _BEGIN).total_seconds()
_YEARS = (1970, 2100)
_DAY_S = 86400.0
_STAMP = re.compile(
    r"(?P<date>\d{1,4}[-./]\d{1,2}[-./]\d{1,4}|\d{1,2}[- ][A-Za-z]{3}[- ]\d{4}|\d{8})?"
    r"(?P<between>(?<=\d)(?:T|,? +))?"
    r"(?P<time>\d{1,2}:\d{2}(?P<second>:\d{2}(?P<fraction>[.,]\d+)?)?)?"
    r"(?P<half> ?[AaPp][Mm])?(?P<zone> ?(?:[Zz]|[+-]\d{2}:?\d{2}))?"
)
_FRACTION = re.compile(r":\d{2}[.,]\d")
_MIDNIGHT = re.compile(r"[T ]00:00(?::00(?:\.0+)?)?$")
_DATE_WORDS = re.compile(r"date|datum|\btag\b|\bday\b", re.IGNORECASE)
_TIME_WORDS = re.compile(r"time|zeit|uhr|clock", re.IGNORECASE)
# Units of Unix clocks [s], and the range of Unix seconds between 2005 and 2100.
_UNIX = ((1.0, "seconds"), (1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds"))
_UNIX_RANGE = (1.1e9, 4.1e9)
# Excel's day numbers from the year 2000 to 2100.
_EXCEL_RANGE = (36526.0, 73051.0)
# No arm is measured at two poses a second: numbers that are closer than this count a unit longer than seconds.
_CLOSEST_POSES_S = 0.5
# Least fraction of a day: counts of hours or days begin earlier, and would be taken for a session at night.
_EARLIEST_OF_DAY = 0.2
_SECOND_TOLERANCE = 2e-3


@dataclass(frozen=True)
class Clock:
    """How one column gives the time; `words`: what was guessed and why.

    `pattern`: strptime pattern of texts; None for numbers, in units of `factor` seconds. `kind`: plain "seconds", a
    time of "day", or a time with a "date"; numbers then count from `zero` seconds after the start of the year 2000.
    Times of different kinds cannot be compared.
    """

    words: str
    kind: str
    pattern: str | None = None
    factor: float = 1.0
    zero: float = 0.0

    def seconds(self, sheet: Sheet, header: str) -> Array:
        """Seconds of each cell of the column `header`, from the same origin for all clocks of one kind."""
        if self.pattern is not None:
            stamps = [read_stamp(cell, self.pattern) for cell in sheet.cells(header)]
            return np.array([(stamp - _BEGIN).total_seconds() for stamp in stamps])
        return sheet.figures(header) * self.factor + self.zero

    def entry(self, sheet: Sheet, header: str) -> tuple[str, Any]:
        """The section of dataset.yaml for this clock of the column `header`, "time" or "columns", and its entry."""
        if self.pattern is not None:
            return "time", {"column": header, "format": self.pattern}
        unit = next((unit for unit in ("s", "ms", "min", "h") if UNITS[unit][1] == self.factor), None)
        column: dict[str, Any] = {"column": header}
        if unit not in (None, "s"):
            column["unit"] = unit
        elif unit is None:
            column["scale"] = self.factor
        if self.kind != "seconds":
            column["offset"] = -float(sheet.figures(header).min()) * self.factor
        return "columns", column if len(column) > 1 else header


def read_clock(sheet: Sheet, header: str) -> Clock | None:
    """The clock in the column `header`; None if it is no clock."""
    cells = sheet.cells(header)
    if sheet.is_numeric(header) and not _digits(cells):
        return _of_figures(sheet.figures(header), sheet.units.get(header))
    return _of_texts(cells)


def kind_of_texts(cells: list[str]) -> str | None:
    """The kind of the clock in `cells` if they are texts that tell a time of day, "date" or "day", else None."""
    found = _of_texts(cells) if ":" in cells[0] else None
    return found.kind if found else None


def why_no_clock(cells: list[str], rows: list[int]) -> str:
    """Why `cells`, from these `rows` of the file, are no clock."""
    if all(_is_date(cell) for cell in cells):
        return "found dates without a time of day, which are equal for all rows of one day"
    model = max(cells, key=lambda cell: bool(_patterns(cell)))
    for pattern in _patterns(model):
        for cell, row in zip(cells, rows, strict=True):
            if _parsed(cell, pattern) is None:
                return f"found '{cell}' in row {row}, expected a time as in the other rows, {pattern}"
    return f"found no time in '{cells[0]}', expected a date and time, a time of day, or a count of seconds"


def join_date_and_time(sheet: Sheet) -> tuple[Sheet, str | None]:
    """`sheet` with separate columns of date and time of day joined into one, and a note (None: nothing to join)."""
    texts = {name: kind_of_texts(sheet.cells(name)) for name in sheet.header}
    if any(kind == "date" and not _all_dates(sheet, name) for name, kind in texts.items()):
        return sheet, None
    day = next((name for name in sheet.header if _all_dates(sheet, name)), None)
    if day is None:
        return sheet, None
    in_numbers = sheet.is_numeric(day)
    times = [name for name in sheet.header if name != day]
    if in_numbers:
        times = [name for name in times if _TIME_WORDS.search(name) and sheet.is_numeric(name)]
        times = [name for name in times if _within(sheet.figures(name), (0.0, 1.0))]
    else:
        times = [name for name in times if texts[name] == "day"]
    if not times:
        return sheet, None
    time = times[0]
    if in_numbers:
        sums = sheet.figures(day) + sheet.figures(time)
        cells = [repr(float(both)).replace(".", sheet.decimal) for both in sums]
    else:
        pairs = zip(sheet.cells(day), sheet.cells(time), strict=True)
        cells = [f"{_MIDNIGHT.sub('', date)} {of_day}" for date, of_day in pairs]
    columns = {own: old for own, old in sheet.columns.items() if own != day}
    columns = {
        f"{day} {time}" if own == time else own: cells if own == time else columns[own] for own in columns
    }
    units = {own: unit for own, unit in sheet.units.items() if own not in (day, time)}
    return sheet.with_columns(columns, units=units), f"{day}, {time}: date and time of day are joined"


def _all_dates(sheet: Sheet, name: str) -> bool:
    if _DATE_WORDS.search(name) and sheet.is_numeric(name):
        days = sheet.figures(name)
        if np.array_equal(days, np.round(days)) and _within(days, _EXCEL_RANGE):
            return True
    return all(map(_is_date, sheet.cells(name)))


def _is_date(cell: str) -> bool:
    whole = _STAMP.fullmatch(_MIDNIGHT.sub("", cell))
    return bool(whole and whole["date"] and not whole["time"] and not cell.isdigit())


def _digits(cells: list[str]) -> bool:
    """True where all of `cells` are fourteen digits from the year to the second."""
    return all(len(cell) == 14 and cell.isdigit() and _parsed(cell, "%Y%m%d%H%M%S") for cell in cells)


def _of_texts(cells: list[str]) -> Clock | None:
    model = max(cells, key=lambda cell: (bool(_FRACTION.search(cell)), len(cell)))
    patterns = ["%Y%m%d%H%M%S"] if _digits(cells) else _patterns(model)
    read = {pattern: [_parsed(cell, pattern) for cell in cells] for pattern in patterns}
    stamps = {
        pattern: np.array([(stamp - _BEGIN).total_seconds() for stamp in found if stamp is not None])
        for pattern, found in read.items()
        if all(found)
    }
    if not stamps:
        return None
    kind = "date" if "%Y" in patterns[0] or "%y" in patterns[0] else "day"
    chosen, why = _chosen(stamps, patterns)
    return Clock(f"time as {chosen}{why}", kind, chosen)


def _chosen(stamps: dict[str, Array], patterns: list[str]) -> tuple[str, str]:
    """The pattern with the likelier order of day and month, and the reason in words."""
    (first, one), *more = stamps.items()
    if not more:
        refused = [pattern for pattern in patterns if pattern != first]
        return first, ", as the month would be above 12 in the other order" if refused else ""
    ((second, other),) = more

    def says(pattern: str) -> str:
        return "day before month" if pattern.startswith("%d") else "month before day"

    back = {first: int(np.sum(np.diff(one) < 0.0)), second: int(np.sum(np.diff(other) < 0.0))}
    days = {first: float(np.ptp(one)) / _DAY_S, second: float(np.ptp(other)) / _DAY_S}
    best, worse = sorted(stamps, key=lambda pattern: (back[pattern], days[pattern]))
    if back[best] < back[worse]:
        why = f"the rows are then in order of time, which goes back {plural(back[worse], 'time')} with the other order"
        if back[best]:
            why = (
                f"the time then goes back {plural(back[best], 'time')} from row to row, "
                f"with the other order {back[worse]}"
            )
    elif days[best] < days[worse]:
        why = f"the rows then last {days[best]:.3g} days, with the other order {days[worse]:.3g}"
    else:
        best = second if "%p" in first else first
        why = "the common order: the rows do not decide, and both orders give the same seconds"
        return best, f", {says(best)}, {why}"
    return best, f", {says(best)}, as {why}"


def _patterns(cell: str) -> list[str]:
    """The strptime patterns that a cell may have: two if day and month can be exchanged."""
    whole = _STAMP.fullmatch(cell)
    if whole is None or not whole["time"]:
        return []
    time = "%I:%M" if whole["half"] else "%H:%M"
    time += ":%S" if whole["second"] else ""
    time += f"{whole['fraction'][0]}%f" if whole["fraction"] else ""
    for part, token in (("half", "%p"), ("zone", "%z")):
        if whole[part]:
            time += " " * whole[part].startswith(" ") + token
    if not whole["date"]:
        return [time]
    between = re.sub(" +", " ", whole["between"] or "")
    return [f"{date}{between}{time}" for date in _date_patterns(whole["date"])] if between else []


def _date_patterns(date: str) -> list[str]:
    marks = re.sub(r"[0-9A-Za-z]", "", date)
    if not marks:
        return ["%Y%m%d"]
    if marks[0] != marks[1]:
        return []
    mark = marks[0]
    first, middle, last = date.split(mark)
    if middle.isalpha():
        return [f"%d{mark}%b{mark}%Y"]
    if len(first) == 4:
        return [f"%Y{mark}%m{mark}%d"]
    year = {4: "%Y", 2: "%y"}.get(len(last))
    if year is None or len(first) > 2:
        return []
    orders = [("%d", "%m")] if mark == "." else [("%d", "%m"), ("%m", "%d")]
    return [mark.join([*order, year]) for order in orders]


def _parsed(cell: str, pattern: str) -> datetime.datetime | None:
    try:
        stamp = read_stamp(cell, pattern)
    except (ValueError, OverflowError):
        return None
    dated = "%Y" in pattern or "%y" in pattern
    return stamp if not dated or _YEARS[0] <= stamp.year <= _YEARS[1] else None


def _of_figures(figures: Array, stated: str | None) -> Clock:
    unit = stated if stated in ("s", "ms", "min", "h") else None
    for factor, words in _UNIX:
        if _within(figures * factor, _UNIX_RANGE) and (unit is None or UNITS[unit][1] == factor):
            date = datetime.datetime.fromtimestamp(float(figures[0]) * factor, datetime.UTC)
            words = f"time in {words} since 1970, as its first is then {date:%Y-%m-%d %H:%M:%S}"
            return Clock(words, "date", factor=factor, zero=_UNIX_BEGIN)
    if unit is not None:
        return Clock(f"time in {unit}, as its header says", "seconds", factor=UNITS[unit][1])
    apart = float(np.ptp(figures)) / max(1, len(figures) - 1)
    if apart < _CLOSEST_POSES_S and _within(figures, _EXCEL_RANGE):
        date = _BEGIN + datetime.timedelta(seconds=float(figures[0]) * _DAY_S + _EXCEL_BEGIN)
        words = f"time in days as Excel counts them, as its first is then {date:%Y-%m-%d %H:%M:%S}"
        return Clock(words, "date", factor=_DAY_S, zero=_EXCEL_BEGIN)
    seconds = figures * _DAY_S
    if (
        apart < _CLOSEST_POSES_S
        and _within(figures, (_EARLIEST_OF_DAY, 1.0))
        and float(np.abs(seconds - np.round(seconds)).max()) < _SECOND_TOLERANCE
    ):
        words = "time in fractions of a day as Excel writes them, as its figures are then whole seconds"
        return Clock(words, "day", factor=_DAY_S)
    return Clock("time in s, as its header states no unit", "seconds")


def _within(figures: Array, between: tuple[float, float]) -> bool:
    return bool(figures.min() >= between[0] and figures.max() < between[1])
