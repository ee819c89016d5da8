"""Rows of two files that belong together: by the numbers of poses, by their clocks, or by their order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.foreign.parts import Part
from armtrue.io.delimited import is_number
from armtrue.units import plural

Rows = NDArray[np.int64]

# Clocks match the rows of two files if this share of the shorter file's rows find a partner …
_LEAST_SHARE = 0.9
# … and no other offset of the second clock gives more than this share of those pairs.
_MOST_OF_OTHER = 0.8
# Largest difference of paired times as a share of the typical time from row to row: the least that suffices is used.
_NEAR = tuple(2.0**-k for k in range(8, 1, -1))
# Most clocks write whole seconds.
_CLOCK_STEP_S = 1.0
# A file with this many times more rows is a record of the whole motion; the clocks must then agree without an offset.
_RECORD = 10
_MOST_DIFFERENCES = 20_000_000


def row_names(joints: Part, points: Part) -> tuple[str, str] | None:
    """The header in each of the two files under which rows are named alike; None where there is none.

    Rows of points may share a name under a header such as `Point`: readings of one pose. Under any other header the
    names must be unique in both files, and nearly all of the shorter file must be in the other.
    """
    one, other = joints.meaning.key, points.meaning.key
    if one is not None and other is not None:
        names, keys = joints.sheet.cells(one), points.sheet.cells(other)
        if len(set(names)) == len(names) and len(set(names) & set(keys)) >= 0.5 * len(keys):
            return one, other
    rows = _unique(joints), _unique(points)
    pairs = [
        (a, b)
        for a, own in rows[0].items()
        for b, foreign in rows[1].items()
        if len(own & foreign) >= _LEAST_SHARE * min(len(own), len(foreign))
    ]
    # Numbers may agree by chance: they count under the same header only.
    alike = [(a, b) for a, b in pairs if a.casefold() == b.casefold()]
    words = [(a, b) for a, b in pairs if not any(is_number(cell, ".") for cell in rows[0][a])]
    return next(iter([*alike, *words]), None)


def _unique(part: Part) -> dict[str, set[str]]:
    """Cells of the columns with another value in every row, except joints, points, orientations and times."""
    found = part.meaning
    taken = {*found.joints.values(), *found.others.values()}
    taken |= {name for sets in (found.points, found.rotations) for own in sets.values() for name in own}
    columns = {name: set(part.sheet.cells(name)) for name in part.sheet.header if name not in taken}
    return {name: cells for name, cells in columns.items() if len(cells) == len(part.sheet.rows)}


def match_rows(joints: Part, points: Part) -> tuple[Rows, Rows, str]:
    """The matching rows of the two files, and how they were matched. Errors: InputError if they cannot be."""
    names = row_names(joints, points)
    if names is not None:
        one, other = names
        place = {key: at for at, key in enumerate(joints.sheet.cells(one))}
        pairs = [(place[key], at) for at, key in enumerate(points.sheet.cells(other)) if key in place]
        left, right = zip(*pairs, strict=True)
        return np.array(left), np.array(right), f"by {one} and {other}"
    why = "one of them has no clock"
    if joints.clock is not None and points.clock is not None:
        dated = joints.clock.kind == points.clock.kind != "seconds"
        found = by_clocks(joints.seconds(), points.seconds(), dated)
        if isinstance(found, Pairs):
            return found.left, found.right, _said(joints, points, found)
        why = found
    count = len(joints.sheet.rows)
    if count != len(points.sheet.rows):
        raise InputError(
            f"{points.sheet.path}: found {plural(len(points.sheet.rows), 'row')} where {joints.sheet.path} has "
            f"{count}, expected as many, a column in both that names each row (Point, Name, Nr, ID, or any header that "
            "is the same in both files, with a value in every row that no other row has), or clocks that tell which "
            f"rows belong together ({why})"
        )
    rows = np.arange(count, dtype=np.int64)
    both = joints.clock is not None and points.clock is not None
    return rows, rows, f"row by row, as {why}" if both else "row by row"


def _said(joints: Part, points: Part, found: Pairs) -> str:
    """How the rows were paired, and which have no partner, in words."""
    same = found.left.size == len(joints.sheet.rows) == len(points.sheet.rows)
    in_order = same and bool(np.array_equal(found.left, found.right))
    words = f"by their clocks {joints.meaning.others['time']} and {points.meaning.others['time']}"
    if in_order:
        words = f"row by row, and {words}"
    if found.ahead_s:
        side = "ahead" if found.ahead_s > 0.0 else "behind"
        words += f", that of {points.sheet.path.name} taken as {_seconds(abs(found.ahead_s))} {side}"
    words += f"; pairs are up to {found.apart_s:.2g} s apart"
    for part, rows in ((joints, found.left), (points, found.right)):
        left = sorted(set(range(len(part.sheet.rows))) - set(rows.tolist()))
        if left and len(left) < _RECORD * rows.size:
            numbers = ", ".join(str(part.sheet.numbers[at]) for at in left[:5])
            more = f" and {len(left) - 5} more" if len(left) > 5 else ""
            words += f"; left out: row {numbers}{more} of {part.sheet.path.name}, without a partner"
    return words


def _seconds(value: float) -> str:
    if value < 600.0:
        return f"{value:.3g} s"
    return f"{value / 3600.0:.4g} h" if value < 1e6 else f"{value / 86400.0:.5g} days"


@dataclass(frozen=True)
class Pairs:
    """Paired rows of the two files, how far the second clock is ahead [s], and the largest difference of a pair [s]."""

    left: Rows
    right: Rows
    ahead_s: float
    apart_s: float


def by_clocks(one: Array, other: Array, dated: bool) -> Pairs | str:
    """Pair times `one` and `other` [s] of clocks with the same rate and perhaps an offset, or return why that fails.

    `dated`: both give the time of day, so that equal times are no chance. Counts of seconds have an arbitrary start.
    """
    gap = float(np.median(np.diff(np.sort(one)))) if one.size > 1 else 0.0
    if gap <= 0.0:
        return "the clock of the joints has several rows at one time"
    if len(one) >= _RECORD * len(other):
        found = _nearest(one, other, 0.0, gap / 2.0)
        return found if _enough(found, one, other) else "the points' times are not among those of the joints"
    agree = _nearest(one, other, 0.0, min(_CLOCK_STEP_S, gap / 4.0))
    if dated and _enough(agree, one, other):
        return agree
    if len(one) * len(other) > _MOST_DIFFERENCES:
        return "their clocks do not agree"
    return _set_apart(one, other, gap)


def _enough(found: Pairs, one: Array, other: Array) -> bool:
    """True where nearly all rows of the shorter file have a partner."""
    share = max(found.right.size / len(other), np.unique(found.left).size / len(one))
    return share >= _LEAST_SHARE


def _set_apart(one: Array, other: Array, gap: float) -> Pairs | str:
    """Pair times of clocks with an offset: the most frequent difference of their times."""
    least = _LEAST_SHARE * min(len(one), len(other))
    differences = np.sort((other[:, None] - one[None, :]).ravel())
    for near in _NEAR:
        window = max(2.0 * near * gap, 1e-3)
        last = np.searchsorted(differences, differences + window, side="right")
        counts = last - np.arange(len(differences))
        best = int(np.argmax(counts))
        if counts[best] < least:
            continue
        ahead = float(np.median(differences[best : last[best]]))
        elsewhere = np.abs(differences + window / 2.0 - ahead) > window
        rival = int(counts[elsewhere].max(initial=0))
        if rival > _MOST_OF_OTHER * counts[best]:
            return "their clocks fit one another in more than one way"
        found = _nearest(one, other, ahead, window)
        if _enough(found, one, other):
            return found
    return "the times from row to row differ between their clocks"


def _nearest(one: Array, other: Array, ahead: float, limit: float) -> Pairs:
    """The pairs of times within `limit` of one another, with the second clock set back by `ahead`.

    Several readings of a pose may share one row of joints. If the readings are a record of the whole motion, only the
    nearest one to each row of joints is taken.
    """
    order = np.argsort(one, kind="stable")
    ranked = one[order]
    sought = other - ahead
    place = np.clip(np.searchsorted(ranked, sought), 1, len(ranked) - 1)
    place -= (sought - ranked[place - 1]) <= (ranked[place] - sought)
    apart = np.abs(ranked[place] - sought)
    right = np.flatnonzero(apart <= limit)
    if len(other) >= _RECORD * len(one):
        nearest = right[np.argsort(apart[right], kind="stable")]
        right = np.sort(nearest[np.unique(place[nearest], return_index=True)[1]])
    widest = float(apart[right].max()) if right.size else 0.0
    return Pairs(order[place[right]].astype(np.int64), right.astype(np.int64), ahead, widest)
