"""Temperatures that no thermometer on an arm reads: of one that was off, and in another unit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armtrue.arrays import Array
from armtrue.checking.motion import name_rows
from armtrue.checking.report import Finding
from armtrue.io.dataset import Dataset

# A sensor that is off reads one figure, so far from what it reads otherwise [K]; of two states that were written down
# by hand, the others are no more than a few figures.
_APART_K = 10.0
_LEAST_OTHERS = 6
# Nobody measures a whole campaign on an arm so hot [°C]; in Fahrenheit a cool room is warmer.
_HOTTEST_ROOM = 50.0


def find(data: Dataset) -> list[Finding]:
    """Warnings about the columns temp_*."""
    return [
        finding
        for name, values in sorted(data.columns.items())
        if name.startswith("temp_")
        for finding in _of_column(data, name, values)
    ]


def _of_column(data: Dataset, name: str, values: Array) -> Iterator[Finding]:
    column = f"{data.file.name} column {name}"
    distinct = np.unique(values)
    if distinct[0] > _HOTTEST_ROOM:
        yield Finding(
            "temperature_unit",
            "warning",
            f"{column}: found {distinct[0]:.1f} °C and more at all poses (this looks like Fahrenheit)",
            {"column": name, "least_celsius": float(distinct[0])},
            f"Give it its unit in dataset.yaml, as in '{name}: {{column: {name}, unit: degF}}'.",
        )
    if distinct.size <= _LEAST_OTHERS:
        return
    for off, nearest in ((distinct[0], distinct[1]), (distinct[-1], distinct[-2])):
        rows = values == off
        if abs(off - nearest) < _APART_K or np.count_nonzero(rows) < 2:
            continue
        yield Finding(
            "temperature_off",
            "warning",
            f"{column}: found {off:.1f} °C in {name_rows(data, rows)}, and nothing else within "
            f"{_APART_K:.0f} K of it",
            {"column": name, "rows": data.rows[rows].tolist()},
            "A sensor that is off reads so. Write what the rows around it have, or take these rows out: heat is "
            "sought by this column.",
        )
