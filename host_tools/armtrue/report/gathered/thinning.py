"""Selection of the points to draw, so that a page stays small."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def spread_rows(count: int, most: int, keep: NDArray[np.intp] | None = None) -> NDArray[np.intp]:
    """At most `most` of `count` rows, evenly through the file, and those of `keep` among them in any case."""
    if count <= most:
        return np.arange(count)
    kept = np.zeros(0, dtype=np.intp) if keep is None else keep[:most]
    even = np.linspace(0, count - 1, most - kept.size).round().astype(np.intp)
    return np.union1d(even, kept)


def loudest(values: NDArray[np.float64], most: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Split a curve into at most `most` stretches: the index of each stretch's highest value, and of its first."""
    starts = np.unique(np.linspace(0, values.size, min(most, values.size) + 1).astype(np.intp))[:-1]
    ends = np.append(starts[1:], values.size)
    peaks = np.array(
        [a + int(np.argmax(values[a:b])) for a, b in zip(starts, ends, strict=True)], dtype=np.intp
    )
    return peaks, starts
