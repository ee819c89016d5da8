"""Readings that no thermometer on an arm gives: the sensor was off or had stopped, or the unit is wrong."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.checking.motion import name_rows
from armtrue.checking.report import Finding
from armtrue.errors import did_you_mean
from armtrue.io.dataset import Dataset
from armtrue.io.plausible import HOTTEST_C
from armtrue.io.robot import Robot

# A sensor that is off reads a constant that is at least this far from its other readings [K]. Columns with no more than
# this many other figures are not checked: somebody may have written down a few states by hand.
_APART_K = 10.0
_LEAST_OTHERS = 6
# Figures of thermometers that are starting or not connected (DS18B20 and its like).
_ERROR_VALUES = (85.0, 0.0)
# No campaign is measured on an arm this hot throughout [°C]; in Fahrenheit a cool room reads more.
_HOTTEST_ROOM = 50.0
# A stretch of equal readings is reported from this share of all rows and this number of rows on.
_STILL_SHARE = 0.2
_STILL_ROWS = 10
# A sensor with fine steps repeats its reading in at most this share of the rows.
_FINE_REPEATS = 0.05
# A sensor with coarse steps may be constant in a steady room. A sensor that had stopped jumps by at least this many of
# its steps between two rows, without a pause (this many usual intervals) in which the arm could have cooled.
_LEAP_STEPS = 5.0
_PAUSE_INTERVALS = 5.0
# Change of another thermometer during the stretch that is reported [K].
_TOLD_K = 0.2


def find(data: Dataset) -> list[Finding]:
    """Warnings about the columns temp_*."""
    return [finding for name in _thermometers(data) for finding in _of_column(data, name)]


def without_columns(data: Dataset, robot: Robot) -> Iterator[Finding]:
    """A warning for each sensor of robot.yaml without a column in the file; a note if the file has no such column."""
    columns = _thermometers(data)
    for sensor in robot.sensors:
        if f"temp_{sensor}" not in columns:
            yield Finding(
                "sensor_not_recorded",
                "warning" if columns else "note",
                f"temperature.sensors of robot.yaml: found '{sensor}', expected a column temp_{sensor} of it in "
                f"{data.file.name}{did_you_mean(f'temp_{sensor}', columns)}",
                {"sensor": sensor},
                "Name the sensor as its column, record it, or take it out of robot.yaml.",
            )


def _thermometers(data: Dataset) -> list[str]:
    return sorted(name for name in data.columns if name.startswith("temp_"))


def _of_column(data: Dataset, name: str) -> Iterator[Finding]:
    column = f"{data.file.name} column {name}"
    values = data.columns[name]
    distinct = np.unique(values)
    if _HOTTEST_ROOM < distinct[0] < HOTTEST_C:
        yield Finding(
            "temperature_unit",
            "warning",
            f"{column}: found {distinct[0]:.1f} °C or more at all poses (this looks like Fahrenheit)",
            {"column": name, "least_celsius": float(distinct[0])},
            f"Give it its unit in dataset.yaml, as in '{name}: {{column: {name}, unit: degF}}'.",
        )
    if distinct.size <= _LEAST_OTHERS:
        return
    order = np.argsort(data.clock, kind="stable")
    off = np.zeros(data.count, dtype=np.bool_)
    wide = np.diff(distinct, prepend=-np.inf, append=np.inf) >= _APART_K
    for value in distinct[wide[:-1] & wide[1:]]:
        rows = values == value
        if np.count_nonzero(rows) < 2 and value not in _ERROR_VALUES and not _is_spike(values[order], value):
            continue
        off |= rows
        yield Finding(
            "temperature_off",
            "warning",
            f"{column}: found {value:.1f} °C in {name_rows(data, rows)}, and no other reading within "
            f"{_APART_K:.0f} K of it",
            {"column": name, "rows": data.rows[rows].tolist()},
            "A disconnected sensor gives such readings. Write the temperature of the neighbouring rows, or remove "
            "these rows: thermal effects are fitted to this column.",
        )
    yield from _still(data, name, order[~off[order]])


def _is_spike(values: Array, value: float) -> bool:
    """True if the rows before and after the single row with `value` agree within `_APART_K`."""
    at = int(np.argmax(values == value))
    return 0 < at < values.size - 1 and abs(values[at + 1] - values[at - 1]) < _APART_K


def _still(data: Dataset, name: str, order: NDArray[np.intp]) -> Iterator[Finding]:
    """A warning if the thermometer stood still over a stretch of the rows `order`, which are in order of time."""
    values = data.columns[name][order]
    first, last = _longest_stretch(values)
    if last - first + 1 < max(_STILL_ROWS, _STILL_SHARE * data.count):
        return
    steps = np.abs(np.diff(values))
    elsewhere = np.concatenate([steps[:first], steps[last:]])
    if not elsewhere.any():
        return
    time = data.columns["time"][order] if "time" in data.columns else np.arange(order.size, dtype=np.float64)
    is_fine = np.mean(elsewhere == 0.0) <= _FINE_REPEATS
    if time[last] <= time[first] or not (is_fine or _leaps(steps, elsewhere, time, first, last)):
        return
    stretch = order[first : last + 1]
    seconds = float(time[last] - time[first])
    took = f", {seconds / 3600.0:.1f} h" if seconds >= 7200.0 else f", {seconds / 60.0:.0f} min"
    took = took if "time" in data.columns else ""
    rows = f"row {data.rows[stretch[0]]} to row {data.rows[stretch[-1]]}"
    yield Finding(
        "temperature_stands",
        "warning",
        f"{data.file.name} column {name}: found {values[first]:.2f} °C unchanged from {rows} ({stretch.size} of "
        f"{data.count} rows{took}){_others(data, name, stretch)}: the thermometer stopped updating",
        {"column": name, "rows": data.rows[stretch].tolist(), "celsius": float(values[first])},
        "Remove these rows or the column: otherwise thermal errors in these rows are attributed to other causes, "
        "such as warm_up, time_drift or another thermometer's column.",
    )


def _longest_stretch(values: Array) -> tuple[int, int]:
    """First and last entry of the longest stretch of equal values."""
    begins = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0]))
    lengths = np.diff(np.append(begins, values.size))
    longest = int(np.argmax(lengths))
    return int(begins[longest]), int(begins[longest] + lengths[longest] - 1)


def _leaps(steps: Array, elsewhere: Array, time: Array, first: int, last: int) -> bool:
    """True if the reading jumps by many usual steps, and without a pause, at the start or end of the stretch."""
    intervals = np.diff(time)
    usual = _PAUSE_INTERVALS * float(np.median(intervals))
    large = _LEAP_STEPS * float(np.median(elsewhere[elsewhere > 0.0]))
    edges = [edge for edge in (first - 1, last) if 0 <= edge < steps.size]
    return any(steps[edge] >= large and intervals[edge] <= usual for edge in edges)


def _others(data: Dataset, name: str, stretch: NDArray[np.intp]) -> str:
    """How much the other thermometers changed during the stretch, in words."""
    others = (other for other in _thermometers(data) if other != name)
    spans = {other: float(np.ptp(data.columns[other][stretch])) for other in others}
    told = [f"{other} changed by {span:.1f} K" for other, span in spans.items() if span >= _TOLD_K]
    return f", while {' and '.join(told)}" if told else ""
