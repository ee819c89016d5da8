"""Two sessions with a night between: a tracker that was moved meanwhile, and one that drifts all the time.

The moved tracker was named `time_drift`, with more than 99 %: a line through two sessions explains a step between them.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from armtrue import fit, load_data, load_model, load_robot, refine
from armtrue_sim import simulate

NIGHT_S = 14 * 3600.0


def story_of(
    folder: Path, moved_m: Callable[[np.ndarray], np.ndarray], pauses: int = 1, pause_s: float = NIGHT_S
) -> dict[str, Any]:
    """Refinement of a campaign measured in sessions of equal size, with `pauses` pauses between them.

    `moved_m`: how far the points are displaced along x, as a function of time [s].
    """
    simulate({"arm": "kr30", "seed": 5, "poses": 160, "gross_errors": {"count": 0}}, folder)
    with (folder / "data.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    time = np.array([float(row["time"]) for row in rows])
    time += np.arange(len(rows)) * (pauses + 1) // len(rows) * pause_s
    for row, at, by in zip(rows, time, moved_m(time), strict=True):
        row["time"] = f"{at:.1f}"
        row["x"] = f"{float(row['x']) + by:.9f}"
    with (folder / "data.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    robot = load_robot(folder / "robot.yaml")
    first = fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))
    return refine(first)[1]


def test_tracker_moved_in_the_night_is_not_called_a_drift(tmp_path: Path) -> None:
    last = story_of(tmp_path, lambda time: np.where(time > NIGHT_S, 1e-4, 0.0))["steps"][-1]
    assert last["verdict"] == "unexplained_structure"
    assert last["unexplained"][0]["variables"] == ["time"]
    assert not any(entry["effect"] == "time_drift" for entry in last["effects"])
    assert any("in a column station" in line for line in last["advice"])


def test_drift_that_goes_on_in_both_sessions_is_named(tmp_path: Path) -> None:
    last = story_of(tmp_path, lambda time: 5e-5 * time / 3600.0)["steps"][-1]
    (drift,) = (entry for entry in last["effects"] if entry["effect"] == "time_drift")
    assert drift["probability"] > 0.9
    assert last["verdict"] == "nothing_missing"


def test_step_in_one_of_many_pauses_is_found(tmp_path: Path) -> None:
    # With more than six pauses no pause is a change of the set-up by itself, but a step is a step.
    last = story_of(tmp_path, lambda time: np.where(time > 15000.0, 1e-4, 0.0), pauses=7, pause_s=4000.0)[
        "steps"
    ][-1]
    assert last["verdict"] == "unexplained_structure"
    assert any("was knocked" in line for line in last["advice"])
