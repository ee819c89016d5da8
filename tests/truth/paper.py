"""The unified-calibration paper's experiment on the simulated KR30: geometry alone, the unified model, and `refine`.

`./dev bench campaigns` writes the table into docs/results.md.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from armtrue import _core
from armtrue_sim import simulate

SCENARIO = Path(__file__).resolve().parents[2] / "sim" / "scenarios" / "kr30-paper.yaml"
GEOMETRY: list[Any] = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]
UNIFIED: list[Any] = [*GEOMETRY, "joint_compliance", "thermal_expansion", "transmission_pwl"]
# Mean errors that the paper reports [um].
PAPER = {"geometry": 102.3, "unified": 26.8}


def figures(refined: bool) -> list[dict[str, Any]]:
    """Mean errors [um] of each model: in training, held out in time, at fresh exact poses; and the noise floor."""
    c = simulate(yaml.safe_load(SCENARIO.read_text()))
    columns = {name: np.ascontiguousarray(v, dtype=float) for name, v in c.data.items()}
    test = {name: np.ascontiguousarray(v, dtype=float) for name, v in c.test.items()}
    exact = np.stack([test[axis] for axis in "xyz"], axis=1)
    robot = json.dumps(c.robot)
    fits = {
        name: _core.fit(robot, columns, json.dumps({"effects": effects}), "{}")
        for name, effects in (("geometry", GEOMETRY), ("unified", UNIFIED))
    }
    if refined:
        fits["refine from geometry"] = _core.refine(fits["geometry"], lambda *_: None)[0]
    rows = []
    for name, fit in fits.items():
        document = json.loads(fit.document())
        predicted = np.asarray(_core.predict(json.dumps({**document, "robot": c.robot}), test))
        rows.append(
            {
                "model": name,
                "train": document["error"]["train"]["mean_um"],
                "held_out_in_time": document["error"]["held_out_by"]["time"]["mean_um"],
                "fresh": 1e6 * float(np.mean(np.linalg.norm(predicted - exact, axis=1))),
                "noise_floor": document["noise_floor"]["um"],
                "paper": PAPER.get(name),
            }
        )
    return rows


def main() -> None:
    """Print the table."""
    print(
        "| model | training [um] | held out in time [um] | fresh exact poses [um] | noise floor [um] | paper [um] |"
    )
    print("|---|---|---|---|---|---|")
    for row in figures(refined=True):
        paper = "" if row["paper"] is None else f"{row['paper']:.1f}"
        print(
            f"| {row['model']} | {row['train']:.1f} | {row['held_out_in_time']:.1f} | {row['fresh']:.1f} | "
            f"{row['noise_floor']:.1f} | {paper} |"
        )


if __name__ == "__main__":
    main()
