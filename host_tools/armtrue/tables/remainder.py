"""The remaining error of the tool in corrected rows, by the fit in double precision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.tables.fitted import FittedArm
from armtrue.tables.reference import Reference, Surroundings

# A row is reported if it keeps more than both of these: what a tracker can resolve, and a relevant share of its error.
_TOLD_UM = 20.0
_TOLD_SHARE = 0.05
# Rows that are computed at a time, some kilobytes each; a row takes about ten microseconds.
_CHUNK = 10_000


@dataclass(frozen=True)
class Remainder:
    """Distance of each row's tool point from the intended one [µm], corrected and uncorrected, (N,) each.

    `rows`: their numbers in the file. NaN where the fit has no value, as for the logarithm of a negative number.
    """

    rows: NDArray[np.int64]
    left_um: Array
    uncorrected_um: Array

    def words(self) -> str:
        """Rows that keep much of their error, and the farthest of them; empty where none does."""
        told = (self.left_um > _TOLD_UM) & (self.left_um > _TOLD_SHARE * self.uncorrected_um)
        count = int(told.sum())
        if not count:
            return ""
        farthest = int(np.argmax(np.where(told, self.left_um, -1.0)))
        worse = int((told & (self.left_um > self.uncorrected_um)).sum())
        than_before = (
            f"{worse} of them {'is' if worse == 1 else 'are'} farther off than uncorrected; " if worse else ""
        )
        return (
            f"{count} of {len(self.rows)} rows keep more than {_TOLD_UM:g} µm and {100 * _TOLD_SHARE:g} % of their "
            f"error, by the fit: at most {self.left_um[farthest]:.1f} µm of {self.uncorrected_um[farthest]:.1f} µm, "
            f"in row {self.rows[farthest]}; {than_before}all rows {np.nanmean(self.left_um):.1f} µm on average"
        )

    def figures(self) -> dict[str, Any]:
        """Mean, largest with its row, and every row in the order of the file; None where the fit has no value."""
        known = np.flatnonzero(np.isfinite(self.left_um))
        largest = int(known[np.argmax(self.left_um[known])]) if known.size else None
        rows = _rounded(self.left_um)
        return {
            "mean_um": round(float(self.left_um[known].mean()), 3) if known.size else None,
            "max_um": None if largest is None else rows[largest],
            "max_row": None if largest is None else int(self.rows[largest]),
            "rows_um": rows,
            "uncorrected_rows_um": _rounded(self.uncorrected_um),
        }


def remainder(
    arm: FittedArm,
    rows: NDArray[np.int64],
    commands: tuple[Array, Array],
    around: Surroundings,
    tool: NDArray[np.uint8],
) -> Remainder:
    """`commands`: requested and corrected motor-side joints, (N, n) each. `tool`: number of each row's tool."""
    asked, corrected = commands
    left_um, uncorrected_um = np.empty(len(asked)), np.empty(len(asked))
    for number, name in enumerate(arm.flange_from_tool):
        reference = Reference(arm, name)
        for first in range(0, len(asked), _CHUNK):
            chunk = np.zeros(len(asked), dtype=np.bool_)
            chunk[first : first + _CHUNK] = tool[first : first + _CHUNK] == number
            if chunk.any():
                here = around.of(chunk)
                left_um[chunk] = 1e6 * reference.distances(corrected[chunk], asked[chunk], here)
                uncorrected_um[chunk] = 1e6 * reference.distances(asked[chunk], asked[chunk], here)
    return Remainder(rows, left_um, uncorrected_um)


def _rounded(values: Array) -> list[float | None]:
    """Rounded to nanometres, for JSON; None where not finite."""
    return [round(value, 3) if np.isfinite(value) else None for value in values.tolist()]
