"""Time of a diagnosis (catalogue and spectra) by number of poses, and of a refinement with three hidden effects."""

from __future__ import annotations

import json
import statistics
import time
from typing import Any

import numpy as np
from armtrue import _core
from armtrue_sim import simulate
from armtrue_sim.campaign import Campaign
from armtrue_sim.cases import hidden_cases
from armtrue_sim.kinds import ARMS

BELIEVED = ["base_frame", "tool_offset", "joint_offset", "link_geometry", "joint_compliance"]
SEEDS = 5


def fit_of(c: Campaign) -> Any:
    """Fit the believed model."""
    columns = {name: np.ascontiguousarray(v, dtype=float) for name, v in c.data.items()}
    return _core.fit(json.dumps(c.robot), columns, json.dumps(c.model), "{}")


def timed(action: Any, times: int) -> tuple[float, float, Any]:
    """Least wall and processor seconds of some runs, and the result of the last."""
    wall, cpu, result = [], [], None
    for _ in range(times):
        w, p = time.perf_counter(), time.process_time()
        result = action()
        wall.append(time.perf_counter() - w)
        cpu.append(time.process_time() - p)
    return min(wall), min(cpu), result


def catalogue() -> None:
    """Print the time of a diagnosis over the number of poses."""
    print("`diagnose` of an arm with one hidden effect\n")
    print("| poses | wall [s] | processor [s] | ms a pose |\n|---|---|---|---|")
    for poses in (300, 1000, 3000, 10000):
        scenario = {
            "arm": "kr30",
            "seed": 3,
            "poses": poses,
            "test_poses": 10,
            "believed": BELIEVED,
            "hidden": [{"effect": "gear_harmonics", "joints": [3]}],
        }
        fit = fit_of(simulate(scenario))
        wall, cpu, _ = timed(lambda fit=fit: _core.diagnose(fit), 5 if poses < 1000 else 1)
        print(f"| {poses} | {wall:.2f} | {cpu:.2f} | {1e3 * cpu / poses:.2f} |", flush=True)


def refinements() -> None:
    """Print the time of refinements."""
    walls, cpus = [], []
    for arm in ARMS:
        for seed in range(SEEDS):
            fit = fit_of(hidden_cases("three_hidden", arm, seed).campaign)
            wall, cpu, _ = timed(lambda fit=fit: _core.refine(fit, lambda *_: None), 1)
            walls.append(wall)
            cpus.append(cpu)
    print(f"\n`refine` with three hidden effects, 240 poses, {len(walls)} cases\n")
    print("| | median | 90 % | worst |\n|---|---|---|---|")
    for name, values in (("wall [s]", walls), ("processor [s]", cpus)):
        print(
            f"| {name} | {statistics.median(values):.2f} | {np.quantile(values, 0.9):.2f} | {max(values):.2f} |"
        )


if __name__ == "__main__":
    catalogue()
    refinements()
