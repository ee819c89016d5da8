"""The UR10 of shared/datasets: errors on poses held out of the fit, of series C at random and of series A by time.

`./dev ur10` writes the table into docs/results.md. The measurements (MIT) are not part of this repository.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import armtrue
import numpy as np
from armtrue.fitting import with_effects
from armtrue.io import Dataset, Robot
from armtrue.io.model import check_effect
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "ur10-leica"
MEASUREMENTS = ROOT.parent / "shared" / "datasets" / "ur10-leica"

GEOMETRY: list[Any] = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]
TABLES: list[Any] = [*GEOMETRY, "transmission_pwl"]
SPRINGS: list[Any] = [*TABLES, "joint_compliance"]
THREE_DEGREES: list[Any] = [
    *GEOMETRY,
    {"effect": "transmission_pwl", "spacing": math.radians(3.0)},
    "joint_compliance",
]
MODELS = {
    "geometry": GEOMETRY,
    "and tables": TABLES,
    "and springs": SPRINGS,
    "geometry, tables of 3°, springs": THREE_DEGREES,
}


# Effects of the contract that came after the first unified model.
LATER = {
    *(
        "mass_parameters",
        "gravity_direction",
        "axis_wobble",
        "cross_compliance",
        "hysteresis",
        "coupling_harmonics",
    ),
    *(
        "thermal_gradient",
        "self_heating",
        "balancer_state",
        "axis_straightness",
        "tracker_scale",
        "tracker_angles",
    ),
    *("station", "nest"),
}


@dataclass
class Split:
    """Measurements to fit, and those to judge by."""

    train: Dataset
    held_out: Dataset


def robot() -> Robot:
    """The UR10 as its maker publishes it."""
    return armtrue.load_robot(EXAMPLE / "robot.yaml")


def random_split(data: Dataset, held_out: float = 0.3, seed: int = 0) -> Split:
    """Hold a share of the poses out at random."""
    chosen = np.zeros(data.count, dtype=bool)
    order = np.random.default_rng(seed).permutation(data.count)
    chosen[order[: round(held_out * data.count)]] = True
    return Split(data.take(~chosen), data.take(chosen))


def time_split(data: Dataset, first: float = 0.7) -> Split:
    """Fit the first share of the poses in order of time, judge by those that came after them."""
    order = np.argsort(data.columns["time"], kind="stable")
    early = round(first * data.count)
    return Split(data.take(order[:early]), data.take(order[early:]))


def model_of(effects: list[Any], arm: Robot) -> armtrue.Model:
    """The model of `effects`, checked as one from model.yaml."""
    entries = [e if isinstance(e, dict) else {"effect": e} for e in effects]
    return armtrue.Model([check_effect(entry, arm, "ur10") for entry in entries])


def error_mm(fit: armtrue.Fit, data: Dataset) -> NDArray[np.float64]:
    """Position error (N,) [mm]."""
    result: NDArray[np.float64] = 1e3 * np.linalg.norm(fit.predict(data) - data.positions_m, axis=1)
    return result


def rms(values: NDArray[np.float64]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def words(effects: list[dict[str, Any]]) -> str:
    """Effects beyond geometry, as one line of text."""
    added = [e for e in effects if e["effect"] not in GEOMETRY]
    return ", ".join(e["effect"] + (f" {e['joints']}" if e.get("joints") else "") for e in added) or "none"


def print_rows(name: str, split: Split, refined: bool) -> None:
    """Lines of the table for one split; what a refinement did goes to stderr."""
    arm = robot()
    for label, effects in MODELS.items():
        begin = time.perf_counter()
        fit = armtrue.fit(split.train, arm, model_of(effects, arm))
        print_row(name, label, fit, split, time.perf_counter() - begin)
    if refined:
        base = armtrue.fit(split.train, arm, model_of(GEOMETRY, arm))
        begin = time.perf_counter()
        final, story = armtrue.refine(base)
        print_row(name, "`refine` from geometry", final, split, time.perf_counter() - begin)
        for entry in final.effects:
            if entry["effect"] in LATER:
                begin = time.perf_counter()
                less = with_effects(final, [other for other in final.effects if other != entry])
                label = f"the same without {words([entry])}"
                print_row(name, label, less, split, time.perf_counter() - begin)
        for step in story["steps"]:
            added = step["added"]
            print(added and (added["effect"], added["joints"]), step["error"]["held_out"], file=sys.stderr)
        print("refine ends with", words(final.effects), file=sys.stderr)


def print_row(name: str, label: str, fit: armtrue.Fit, split: Split, seconds: float) -> None:
    """One fit as a line of the table."""
    train, held_out = error_mm(fit, split.train), error_mm(fit, split.held_out)
    print(
        f"| {name} | {label} | {len(fit.document['parameters'])} | {rms(train):.4f} | {rms(held_out):.4f} "
        f"| {held_out.mean():.4f} | {np.quantile(held_out, 0.95):.4f} | {held_out.max():.3f} | {seconds:.1f} |",
        flush=True,
    )


def splits() -> dict[str, Split]:
    """The two splits of the issue: series C random 30 %, series A first 70 % of the time."""
    arm = robot()
    c = armtrue.load_data(EXAMPLE / "series_c.yaml", arm)
    a = armtrue.load_data(EXAMPLE / "series_a.yaml", arm)
    return {"C": random_split(c), "A": time_split(a)}


def main() -> None:
    """Print the table line by line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="splits whose name has this")
    parser.add_argument("--no-refine", action="store_true")
    arguments = parser.parse_args()
    if not MEASUREMENTS.is_dir():
        raise SystemExit(f"ur10: no measurements at {MEASUREMENTS}")
    print("| series | model | parameters | train RMS [mm] | held-out RMS [mm] | mean | 95 % | max | s |")
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    for name, split in splits().items():
        if arguments.only in name:
            print_rows(name, split, not arguments.no_refine)


if __name__ == "__main__":
    main()
