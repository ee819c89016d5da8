"""The UR10 of shared/datasets: errors on poses that took no part in the fit, series C at random and series A in time.

`./dev ur10` writes the table into docs/results.md. The measurements (MIT) are not part of this repository.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import armtrue
import numpy as np
from armtrue.io import Dataset, Robot
from armtrue.io.model import check_effect
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "ur10-leica"
MEASUREMENTS = ROOT.parent / "shared" / "datasets" / "ur10-leica"
BEGIN, END = "<!-- ur10: begin -->", "<!-- ur10: end -->"

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
    """model.yaml without the file."""
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
    """Effects beyond geometry, as a person lists them."""
    added = [e for e in effects if e["effect"] not in GEOMETRY]
    return ", ".join(e["effect"] + (f" {e['joints']}" if e.get("joints") else "") for e in added) or "none"


def rows(name: str, split: Split, refined: bool) -> Iterator[str]:
    """Lines of the table for one split."""
    arm = robot()
    for label, effects in MODELS.items():
        begin = time.perf_counter()
        fit = armtrue.fit(split.train, arm, model_of(effects, arm))
        yield line(name, label, fit, split, time.perf_counter() - begin)
    if refined:
        base = armtrue.fit(split.train, arm, model_of(GEOMETRY, arm))
        begin = time.perf_counter()
        final, story = armtrue.refine(base)
        took = time.perf_counter() - begin
        yield line(name, "`refine` from geometry", final, split, took)
        for step in story["steps"]:
            added = step["added"]
            print(name, added and (added["effect"], added["joints"]), step["error"]["held_out"], flush=True)
        print(name, "refine ends with", words(final.effects), flush=True)


def line(name: str, label: str, fit: armtrue.Fit, split: Split, seconds: float) -> str:
    """One fit as a line of the table, printed as it comes."""
    train, held_out = error_mm(fit, split.train), error_mm(fit, split.held_out)
    text = (
        f"| {name} | {label} | {len(fit.document['parameters'])} | {rms(train):.4f} | {rms(held_out):.4f} "
        f"| {held_out.mean():.4f} | {np.quantile(held_out, 0.95):.4f} | {held_out.max():.3f} | {seconds:.1f} |"
    )
    print(text, flush=True)
    return text


def splits() -> dict[str, Split]:
    """The two of the issue: series C random 30 %, series A first 70 % of the time."""
    arm = robot()
    c = armtrue.load_data(EXAMPLE / "series_c.yaml", arm)
    a = armtrue.load_data(EXAMPLE / "series_a.yaml", arm)
    return {"C, random 30 %": random_split(c), "A, last 30 % of the time": time_split(a)}


def main() -> None:
    """Print the table, and keep it where --write says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--only", default="", help="splits whose name has this")
    parser.add_argument("--no-refine", action="store_true")
    arguments = parser.parse_args()
    if not MEASUREMENTS.is_dir():
        raise SystemExit(f"ur10: no measurements at {MEASUREMENTS}")
    table = [
        "| held out | model | parameters | train RMS [mm] | held-out RMS [mm] | mean | 95 % | max | s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, split in splits().items():
        if arguments.only in name:
            table += rows(name, split, not arguments.no_refine)
    if arguments.write:
        text = arguments.write.read_text()
        before, after = text.split(BEGIN)[0], text.split(END)[1]
        arguments.write.write_text(before + BEGIN + "\n" + "\n".join(table) + "\n" + END + after)


if __name__ == "__main__":
    main()
