"""Rows whose position belongs to the joints of a row near by (a reading was lost), or to another reflector.

Base and tools are found from rows that follow the arm. Each position is then compared with the prediction from the
joints of its own row, from those of a row near by, and from its own joints with the tool of another reflector.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.checking.alignment import NOMINAL_ERROR_PER_REACH, Alignment, Columns, align, evenly
from armtrue.checking.motion import name_rows
from armtrue.checking.placement import Reading, lower_bounds
from armtrue.checking.report import Finding, Severity
from armtrue.checking.residuals import gross_limit_m
from armtrue.io.columns import POSITION
from armtrue.io.dataset import Dataset
from armtrue.io.robot import Robot
from armtrue.tables.chain import flanges, pose
from armtrue.units import plural

Mask = NDArray[np.bool_]
CODES = ("rows_shifted", "reflectors_exchanged")

# Each lost reading shifts the rest of the file by one row; with more than three the log has to be paired anew.
_LAGS = (1, -1, 2, -2, 3, -3)
# One row that fits a neighbour may be chance, and two may have been exchanged.
_FEWEST_ROWS = 3
# A fit excludes gross errors up to a tenth of all rows, and more only if they exceed the errors of any arm. Half of a
# tenth leaves room for other gross errors beside the block.
_SPOILS_A_FIT = 0.05
# If fewer rows are explained, something else is wrong as well, which the search over conventions may find.
_EXPLAINED = 0.75
# More runs of rows than this are named row by row.
_MOST_RUNS = 3
# Number of rows that are aligned: 60 determine base and tool to millimetres.
_ROWS = 60
# Shares of the file that are tried as a start if base and tool cannot be found from all rows.
_SHARES = (1 / 8, 1 / 3)
_PASSES = 3


@dataclass(frozen=True)
class _Placed:
    """Distances [m] between measured and predicted positions, with one base and one set of tools.

    `own`: (N,) with the joints and the reflector of the same row. `shifted`: lag → (N,), with the joints that many rows
    further down. `renamed`: (reflectors, N), with the row's joints and each reflector. Infinite without a prediction: a
    reflector that no row follows has no known place on the arm, so its rows cannot be judged.
    `limit_m`: a larger distance is a gross error.
    """

    own: Array
    shifted: dict[int, Array]
    renamed: Array
    limit_m: float

    def explained(self) -> Mask:
        """Rows that follow the arm with some lag or reflector."""
        least = np.min([self.own, *self.shifted.values(), self.renamed.min(axis=0)], axis=0)
        return np.asarray(least <= self.limit_m)

    def best_lag(self) -> NDArray[np.int64]:
        """For each row the lag with the smallest distance; 0 if the row's own joints are within the limit."""
        lags = np.array([0, *self.shifted])
        nearest = lags[np.argmin([self.own, *self.shifted.values()], axis=0)]
        return np.where(self.own <= self.limit_m, 0, nearest)

    def best_target(self, own: NDArray[np.int64]) -> NDArray[np.int64]:
        """For each row the reflector with the smallest distance; that in `own` if the row is within the limit."""
        return np.where(self.own <= self.limit_m, own, np.argmin(self.renamed, axis=0))


def find(data: Dataset, measured: Columns, robot: Robot) -> tuple[list[Finding], Mask]:
    """Findings on blocks of rows with the positions of other rows or reflectors, and a mask (N,) of their rows.

    `measured`: the rows of `data` in SI units, in their order. An error where the block is large enough to spoil a fit,
    else a warning. A shift of the whole file by one row is left to the search for conventions.
    """
    nothing = np.zeros(data.count, dtype=bool)
    if "station" in measured:
        # Each set-up of the tracker has its own base, which this search does not model.
        return [], nothing
    # Base and tools that explain most rows by some lag or reflector.
    search = _Search(measured, robot)
    all_placed = (search.placed(lag, chosen) for lag, chosen in search.starts())
    placed = next((one for one in all_placed if one and one.explained().mean() >= _EXPLAINED), None)
    if placed is None:
        return [], nothing
    findings: list[Finding] = []
    rows = nothing.copy()
    for found, block in _shifts(data, placed):
        findings.append(found)
        rows |= block
    # If both reflectors are measured at each pose, the position in the next row is also that of the other reflector.
    for found, block in _exchanges(data, placed, ~rows):
        findings.append(found)
        rows |= block
    return findings, rows


class _Search:
    """The search for base and tools of `measured`, where some rows may have another row's position or reflector."""

    def __init__(self, measured: Columns, robot: Robot) -> None:
        self._measured = measured
        self._robot = robot
        self._flange = flanges(measured, robot.spec)
        self._points = np.column_stack([measured[name] for name in POSITION])
        self._count = len(self._points)
        codes = measured.get("target", np.zeros(self._count)).astype(np.int64)
        self._names, self._target = np.unique(codes, return_inverse=True)
        self._widest_m = NOMINAL_ERROR_PER_REACH * robot.reach_m

    def starts(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Lags (M,) and rows (M,) to start from: the whole file with lag 0, then parts with a single lag.

        If a shift begins half way, no base fits all rows, but one fits any part before or after that row.
        """
        whole = np.arange(self._count)
        yield np.zeros(self._count, dtype=np.int64), whole
        # The relaxed problem has 12 unknowns and 3 a tool; four equations for each leave degrees of freedom.
        fewest = 16 + 4 * len(self._names)
        for share in _SHARES:
            size = max(fewest, int(share * self._count))
            if size >= self._count:
                continue
            windows = [whole[first : first + size] for first in range(0, self._count - size + 1, size // 2)]
            tried = [
                (lag, window)
                for window in windows
                for lag in (0, *_LAGS)
                if window[0] + lag >= 0 and window[-1] + lag < self._count
            ]
            readings = []
            for lag, window in tried:
                rows = window[evenly(size, _ROWS)]
                readings.append(Reading(self._paired(np.full(len(rows), lag), rows), self._robot.spec))
            # Only parts with the most reflectors compete: they predict the most rows and have equally many unknowns.
            reflectors = [len(np.unique(reading.columns.get("target", 0))) for reading in readings]
            most = [at for at, number in enumerate(reflectors) if number == max(reflectors)]
            bounds = lower_bounds([readings[at] for at in most])
            lag, window = tried[most[int(np.argmin(bounds))]]
            yield np.full(size, lag), window

    def _paired(
        self, lag: NDArray[np.int64], rows: NDArray[np.int64], target: NDArray[np.int64] | None = None
    ) -> Columns:
        """The columns of `rows`: positions with the joints `lag` rows further down, reflectors renumbered from 0."""
        paired = {
            name: values[rows if name in POSITION else rows + lag] for name, values in self._measured.items()
        }
        if "target" in paired:
            codes = self._target[rows + lag] if target is None else target
            paired["target"] = np.unique(codes, return_inverse=True)[1].astype(np.float64)
        return paired

    def placed(self, lag: NDArray[np.int64], rows: NDArray[np.int64]) -> _Placed | None:
        """Distances with base and tools from `rows` read with `lag`, then from all rows that these explain."""
        target = self._target[rows + lag]
        limit = self._widest_m
        for _ in range(_PASSES):
            if rows.size < _FEWEST_ROWS + 4:
                return None
            chosen = evenly(rows.size, _ROWS)
            aligned = align(self._paired(lag[chosen], rows[chosen], target[chosen]), self._robot)
            placed = self._distances(aligned, target[chosen], limit)
            rows = np.flatnonzero(placed.explained())
            lag = placed.best_lag()[rows]
            target = placed.best_target(self._target)[rows]
            target = np.where(lag == 0, target, self._target[rows + lag])
            as_they_stand = placed.own[placed.own <= self._widest_m]
            if as_they_stand.size:
                limit = min(self._widest_m, gross_limit_m(as_they_stand))
        return placed

    def _distances(self, aligned: Alignment, target: NDArray[np.int64], limit_m: float) -> _Placed:
        tools = aligned.flange_from_tool
        predicted = np.full((len(self._names), self._count, 3), np.inf)
        from_flange = pose(dict(aligned.measuring_from_base)) @ self._flange
        for place, code in enumerate(np.unique(target)):
            # With a single tool, its key in `tools` is not a number.
            tool = np.array(tools.get(str(place), next(iter(tools.values())))["xyz"])
            predicted[code] = from_flange[:, :3, :3] @ tool + from_flange[:, :3, 3]
        renamed = np.linalg.norm(predicted - self._points, axis=2)
        every = np.arange(self._count)
        return _Placed(
            renamed[self._target, every],
            {lag: self._shifted(lag, predicted) for lag in _LAGS},
            renamed,
            limit_m,
        )

    def _shifted(self, lag: int, predicted: Array) -> Array:
        """Distances (N,) from the point of the joints `lag` rows further down.

        The name of the reflector may belong to the joints or to the position: the smaller distance is taken.
        """
        rows = np.arange(max(0, -lag), min(self._count, self._count - lag))
        result = np.full(self._count, np.inf)
        for target in (self._target[rows + lag], self._target[rows]):
            off = np.linalg.norm(predicted[target, rows + lag] - self._points[rows], axis=1)
            result[rows] = np.minimum(result[rows], off)
        return result


def _blocks(marked: Mask, contradicts: Mask) -> Iterator[slice]:
    """Runs of rows that begin and end with a marked row and contain no contradicting one."""
    # Rows with the same number of contradictions before them can belong to one run.
    piece = np.cumsum(contradicts)
    for number in np.unique(piece[marked]):
        rows = np.flatnonzero(marked & (piece == number))
        if rows.size >= _FEWEST_ROWS:
            yield slice(int(rows[0]), int(rows[-1]) + 1)


def _shifts(data: Dataset, placed: _Placed) -> Iterator[tuple[Finding, Mask]]:
    limit = placed.limit_m
    for lag, distance in placed.shifted.items():
        others = [placed.own, *(values for other, values in placed.shifted.items() if other != lag)]
        nearest = np.min(others, axis=0)
        marked = (distance <= limit) & (nearest > limit) & np.isfinite(placed.own)
        # A row at the end of the file has no partner that many rows further on, which is no evidence against the lag.
        contradicts = np.isfinite(distance) & (distance > limit) & (nearest <= limit)
        for block in _blocks(marked, contradicts):
            first, last = data.rows[[block.start, block.stop - 1]]
            where = f"in rows {first} to {last}"
            if not contradicts[block.stop :].any():
                where = f"from row {first} on" if contradicts[: block.start].any() else "in all rows"
            if where == "in all rows" and abs(lag) == 1:
                continue
            inside = np.zeros(data.count, dtype=bool)
            inside[block] = True
            yield _shift(data, placed, lag, inside, where), inside


def _shift(data: Dataset, placed: _Placed, lag: int, inside: Mask, where: str) -> Finding:
    """`where`: its rows in words."""
    first, last = (int(row) for row in data.rows[inside][[0, -1]])
    by = plural(abs(lag), "row")
    far = f"{by} further {'down' if lag > 0 else 'up'}"
    whose = {1: "of the next row", -1: "of the row before"}.get(lag, far)
    figures = _figures(placed.own[inside], placed.shifted[lag][inside])
    if lag > 0:
        cause = "as if the tracker had lost a reading and the next ones had moved up"
        remedy = (
            f"Move x, y, z (and target, where the tracker names it) of these rows down by {by} and leave out the rows "
            "that then have no position, or pair joints and positions again from the logs, by their times."
        )
    else:
        cause = "as if the tracker had measured once too often or a row of joints had been lost"
        remedy = (
            f"Move x, y, z (and target, where the tracker names it) of these rows up by {by}, over the "
            "surplus readings, or pair joints and positions again from the logs, by their times."
        )
    return Finding(
        "rows_shifted",
        _severity(data, inside),
        f"{where}, each position belongs to the joints {whose}, {cause}: {figures}",
        {
            "first_row": first,
            "last_row": last,
            "rows": data.rows[inside].tolist(),
            "lag": lag,
            "median_m": float(np.median(placed.own[inside])),
            "median_m_if_changed": float(np.median(placed.shifted[lag][inside])),
        },
        remedy,
    )


def _exchanges(data: Dataset, placed: _Placed, among: Mask) -> Iterator[tuple[Finding, Mask]]:
    names = data.labels.get("target", [])
    if "target" not in data.columns:
        return
    codes, target = np.unique(data.columns["target"].astype(np.int64), return_inverse=True)
    known = np.flatnonzero(np.isfinite(placed.renamed).all(axis=1))
    for one, other in itertools.combinations(known.tolist(), 2):
        partner = np.where(target == one, other, one)
        of_pair = among & ((target == one) | (target == other))
        distance = placed.renamed[partner, np.arange(data.count)]
        marked = of_pair & (distance <= placed.limit_m) & (placed.own > placed.limit_m)
        contradicts = of_pair & (distance > placed.limit_m) & (placed.own <= placed.limit_m)
        if marked.sum() > contradicts.sum():
            # Base and tools were found from rows with exchanged names: the larger part is taken as right.
            marked, contradicts = contradicts, marked
        if np.count_nonzero(marked) >= _FEWEST_ROWS:
            distances = np.sort([placed.own[marked], distance[marked]], axis=0)
            where = _in_rows(data, marked, contradicts)
            yield _exchange(data, names[codes[one]], names[codes[other]], marked, where, distances), marked


def _in_rows(data: Dataset, marked: Mask, contradicts: Mask) -> str:
    """`in rows 62 to 91` if the rows `marked` form few runs, else the number of each row."""
    piece = np.cumsum(contradicts)
    runs = [data.rows[marked & (piece == number)] for number in np.unique(piece[marked])]
    if len(runs) > _MOST_RUNS:
        return f"in {name_rows(data, marked)}"
    return "in rows " + " and ".join(f"{run[0]} to {run[-1]}" for run in runs)


def _exchange(data: Dataset, one: str, other: str, inside: Mask, where: str, distances: Array) -> Finding:
    """`where`: its rows in words. `distances` (2, rows) [m]: with the right reflector and with the wrong one."""
    said = sorted({data.labels["target"][int(code)] for code in data.columns["target"][inside]})
    if len(said) == 2:
        words = f"{where} the names of the reflectors '{one}' and '{other}' are exchanged"
        remedy = f"Exchange '{one}' and '{other}' in the column target of these rows, or leave the rows out."
    else:
        fits = other if said == [one] else one
        words = f"{where} the positions that the file assigns to reflector '{said[0]}' are those of '{fits}'"
        remedy = f"Write '{fits}' into the column target of these rows, or leave the rows out."
    return Finding(
        "reflectors_exchanged",
        _severity(data, inside),
        f"{words}: {_figures(distances[1], distances[0])}",
        {
            "rows": data.rows[inside].tolist(),
            "targets": [one, other],
            "median_m": float(np.median(distances[1])),
            "median_m_if_changed": float(np.median(distances[0])),
        },
        remedy,
    )


def _severity(data: Dataset, inside: Mask) -> Severity:
    return "error" if np.count_nonzero(inside) > _SPOILS_A_FIT * data.count else "warning"


def _figures(before: Array, after: Array) -> str:
    return (
        f"the positions in these rows are {np.median(before) * 1000:.0f} mm from the arm's with the file as it is, and "
        f"{np.median(after) * 1000:.1f} mm with this correction (medians)"
    )
