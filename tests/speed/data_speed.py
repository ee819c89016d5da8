"""The time of a simulated campaign in memory, and of reading a large one from a CSV."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from armtrue import load_data, load_robot
from armtrue_sim import simulate

ROWS, COLUMNS, RUNS = 100_000, 28, 5


def row(what: str, action: Callable[[int], object], runs: int) -> None:
    """Print the least and the median time of some runs; `action` is given the run's number."""
    times = []
    for number in range(runs):
        begin = time.perf_counter()
        action(number)
        times.append(1e3 * (time.perf_counter() - begin))
    print(f"| {what} | {min(times):.0f} | {statistics.median(times):.0f} |", flush=True)


def main() -> None:
    """Print the table."""
    print("| | least [ms] | median [ms] |\n|---|---|---|")
    scenario = {"arm": "kr30", "hidden": ["gear_harmonics", "thermal_expansion"]}
    row(
        "240 poses simulated in memory, two hidden effects",
        lambda seed: simulate({**scenario, "seed": seed}),
        20,
    )
    with tempfile.TemporaryDirectory() as folder:
        simulate({**scenario, "seed": 0, "poses": 60}).write(folder)
        robot = load_robot(Path(folder, "robot.yaml"))
        names = [*(f"q{k}" for k in range(1, 7)), *"xyz"]
        names += [f"extra{k}" for k in range(COLUMNS - len(names))]
        numbers = np.random.default_rng(1).uniform(-1.0, 1.0, (ROWS, COLUMNS))
        path = Path(folder, "large.csv")
        np.savetxt(path, numbers, fmt="%.9f", delimiter=",", header=",".join(names), comments="")
        row(f"{ROWS} rows of {COLUMNS} columns read", lambda _: load_data(path, robot), RUNS)


if __name__ == "__main__":
    main()
