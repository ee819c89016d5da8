"""Calibration: how often a statement with a given probability is true."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

# Bins of stated probability; the outer ones are narrow, because most statements are there.
EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.99, 1.0)
Said = tuple[float, bool]


def bins(said: Iterable[Said]) -> list[tuple[int, float, float]]:
    """(count, mean stated probability, share true) of each bin of EDGES that is not empty."""
    pairs = list(said)
    probability = np.array([p for p, _ in pairs])
    true = np.array([t for _, t in pairs], dtype=float)
    where = np.clip(np.searchsorted(EDGES, probability, side="right") - 1, 0, len(EDGES) - 2)
    found = []
    for i in range(len(EDGES) - 1):
        inside = where == i
        if inside.any():
            found.append((int(inside.sum()), float(probability[inside].mean()), float(true[inside].mean())))
    return found


def expected_calibration_error(said: Sequence[Said]) -> float:
    """Mean distance of stated probability and share true over the bins, weighted by their counts."""
    return sum(count * abs(p - t) for count, p, t in bins(said)) / max(len(said), 1)


def table(said: Sequence[Said]) -> str:
    """Markdown; one sentence if no probability was stated."""
    if not said:
        return "This build's JSON has no `probability`: nothing to hold against what is true.\n"
    lines = ["| said | how often | true |", "|---|---|---|"]
    lines += [f"| {p:.3f} | {count} | {t:.3f} |" for count, p, t in bins(said)]
    sure = [true for p, true in said if p >= 0.9]
    lines += [
        "",
        f"Expected calibration error {expected_calibration_error(said):.3f}; of {len(sure)} said with 0.9 ",
    ]
    lines[-1] += f"or more, {sum(sure)} are true."
    return "\n".join(lines) + "\n"
