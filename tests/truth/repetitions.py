"""Repeated noise on one arm: do the estimates scatter about the truth as each fit states?"""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, sqrt
from typing import Any

import numpy as np
from known_arm import GEOMETRY, KnownArm

REPETITIONS = 200
CASES: list[tuple[str, list[Any]]] = [
    ("kr30", ["joint_compliance", "joint_scale"]),
    ("irb2400", ["joint_compliance"]),
    ("stanford", []),
    ("cobot", ["joint_compliance", "gear_harmonics", "backlash"]),
]


@dataclass
class Scatter:
    """Estimate minus truth over stated sigma, over repetitions and parameters.

    mean_square: of all (1 if sigmas are right). worst_chi2, worst_p: the parameter whose sum of squares is least
    likely, and its two-sided probability. worst_mean, largest_mean: the parameter whose mean is furthest from zero.
    """

    repetitions: int
    parameters: int
    mean_square: float
    worst_chi2: str
    worst_p: float
    worst_mean: str
    largest_mean: float


def scatter(arm: str, hidden: list[Any], repetitions: int, pretend: float = 1.0) -> Scatter:
    """Fit `repetitions` times with fresh noise. `pretend`: factor on the stated sigmas, to see it detected."""
    known = KnownArm.of({"arm": arm, "seed": 21, "believed": GEOMETRY, "hidden": hidden}, poses=120)
    rows: list[dict[str, float]] = []
    for seed in range(repetitions):
        fit = known.fit(seed)
        rows.append({p["name"]: z / pretend for p, z in zip(fit.kept, fit.deviations(), strict=True)})
    names = sorted(set.intersection(*(set(row) for row in rows)))
    z = np.array([[row[name] for name in names] for row in rows])
    p = np.array([chi2_two_sided(float(v), repetitions) for v in np.sum(z**2, axis=0)])
    means = z.mean(axis=0)
    furthest = int(np.argmax(np.abs(means)))
    return Scatter(
        repetitions,
        len(names),
        float(np.mean(z**2)),
        names[int(np.argmin(p))],
        float(p.min()),
        names[furthest],
        float(means[furthest]),
    )


def chi2_two_sided(value: float, freedom: int) -> float:
    """Two-sided probability of a chi-square, by Wilson and Hilferty's cube root."""
    cube = (value / freedom) ** (1.0 / 3.0)
    spread = 2.0 / (9.0 * freedom)
    return erfc(abs(cube - (1.0 - spread)) / sqrt(spread) / sqrt(2.0))


def main() -> None:
    """Print the table of 200 repetitions."""
    print(
        "| arm | hidden | parameters | mean square of (estimate − truth)/σ | least likely χ² (p times parameters) |"
    )
    print("|---|---|---|---|---|")
    for arm, hidden in CASES:
        s = scatter(arm, hidden, REPETITIONS)
        words = ", ".join(h if isinstance(h, str) else h["effect"] for h in hidden) or "geometry alone"
        corrected = min(1.0, s.worst_p * s.parameters)
        print(
            f"| {arm} | {words} | {s.parameters} | {s.mean_square:.3f} | {s.worst_chi2} ({corrected:.2f}) |",
            flush=True,
        )


if __name__ == "__main__":
    main()
