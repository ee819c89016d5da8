"""Results of the fitter for small simulated campaigns: fits, predictions with covariance, diagnoses and plans.

Each key of a result's JSON is summarised in a few figures. `./dev record` writes them to recorded.json, and
test_recorded.py compares. A change that is meant to alter a result is committed with the new file, whose diff shows
what else it alters.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import armtrue
import numpy as np
from armtrue.uncertainty import position_covariance
from armtrue_sim import simulate
from armtrue_sim.campaign import Campaign, csv_text
from armtrue_sim.cases import hidden_cases
from armtrue_sim.foreign import TRUTHS
from armtrue_sim.kinds import KINDS

RECORDED = Path(__file__).with_name("recorded.json")
_DIGITS = re.compile(r"[-+]?\d[\d.,]*(?:e[-+]?\d+)?")
# In a list of numbers, smaller ones than this share of their RMS count as equally small.
_SMALL = 1e-5
_FEW = {"poses": 70, "repeats": {"poses": 3, "times": 3}, "test_poses": 20}
_GEOMETRY = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]

# Circumstances that no kind of hidden case has; `model` replaces model.yaml.
SCENARIOS: dict[str, dict[str, Any]] = {
    "full poses": {"arm": "lbr", "columns": {"add": ["orientation", "sigma"]}, "model": _GEOMETRY},
    "reflectors and torques": {
        "arm": "cobot",
        "targets": {"names": ["A", "B", "C"], "order": "each_pose"},
        "columns": {"add": ["tau", "qr"]},
        "poses": 150,
        "model": [*_GEOMETRY, "joint_compliance", "command_readback"],
    },
    "tables": {
        "arm": "kr30",
        "poses": 200,
        "hidden": [{"effect": "gear_harmonics", "joints": [2]}],
        "model": [*_GEOMETRY, {"effect": "transmission_pwl", "joints": [1, 2]}, "joint_compliance"],
    },
    "grid and custom terms": {
        "arm": "scara",
        "payloads": [0.0, 2.0],
        "poses": 120,
        "model": [
            *_GEOMETRY,
            "residual_grid",
            {
                "effect": "custom",
                "name": "ripple",
                "coordinate": "motor1",
                "expression": "sin(n*q1) * hat(q2, -1, 0, 1)",
                "parameters": {"n": 3.0},
            },
        ],
    },
    "palletiser": {"arm": "palletiser", "hidden": [{"effect": "joint_compliance", "joints": [4]}]},
    "rail": {"arm": "rail", "hidden": [{"effect": "axis_straightness", "joints": [1]}]},
}


def campaigns() -> dict[str, Callable[[], Campaign]]:
    """Makers of campaigns by name: each kind of hidden case, on the arms in turn, SCENARIOS, and each foreign truth."""
    made: dict[str, Callable[[], Campaign]] = {}
    for number, (kind, given) in enumerate(KINDS.items()):
        arm = given.arms[number % len(given.arms)]
        made[f"{kind} {arm}"] = lambda kind=kind, arm=arm: hidden_cases(kind, arm, 1).campaign
    foreign = {name: {"arm": "kr30", "hidden": [name], "poses": 240, **TRUTHS[name].plan} for name in TRUTHS}
    for name, scenario in {**SCENARIOS, **foreign}.items():
        plan = {**_FEW, "seed": 5, **scenario}
        plan.pop("model", None)
        made[name] = lambda plan=plan: simulate(plan)
    return made


def summary(name: str) -> dict[str, Any]:
    """Summary (`summarised`) of all that is said of a campaign."""
    campaign = campaigns()[name]()
    if model := SCENARIOS.get(name, {}).get("model"):
        campaign.model["effects"] = list(model)
    with tempfile.TemporaryDirectory() as folder:
        return dict(summarised(_said(name, campaign, Path(folder))))


def _said(name: str, campaign: Campaign, folder: Path) -> dict[str, Any]:
    campaign.write(folder)
    (folder / "true.yaml").write_text(json.dumps(campaign.true_model))
    robot = armtrue.load_robot(folder / "robot.yaml")
    data = armtrue.load_data(folder / "data.csv", robot)
    believed = armtrue.fit(data, robot, armtrue.load_model(folder / "model.yaml", robot))
    diagnosis = armtrue.diagnose(believed)
    said: dict[str, Any] = {"believed": believed.document, "diagnosis": diagnosis}
    del diagnosis["error"]  # that of the fit
    fits = [believed]
    if not name.startswith(("foreign_truth", *SCENARIOS, *TRUTHS)):
        fits.append(armtrue.fit(data, robot, armtrue.load_model(folder / "true.yaml", robot)))
        said["true"] = fits[-1].document
    fresh = {key: values for key, values in campaign.test.items() if key not in ("x", "y", "z")}
    (folder / "fresh.csv").write_text(csv_text(fresh))
    asked = armtrue.load_data(folder / "fresh.csv", robot, need_position=False)
    said["predicted"] = [fit.predict(asked).tolist() for fit in fits]
    said["covariance"] = [position_covariance(fit, asked).tolist() for fit in fits]
    # Planning takes as long as all else: of every third campaign.
    if zlib.crc32(name.encode()) % 3 == 0:
        said["plan"] = armtrue.plan(fits[-1], 4, rivals=[], candidates=150).figures
    return said


def summarised(document: Any) -> Iterator[tuple[str, Any]]:
    """Path and summary of every entry: [count, mean, RMS, mean of the logarithm] of numbers, a checksum of texts.

    A path has the keys; all elements of lists are summarised together. Texts count without their numbers.
    """
    numbers: dict[str, list[float]] = {}
    texts: dict[str, list[str]] = {}
    for path, value in _leaves(document, ""):
        if isinstance(value, str):
            texts.setdefault(path, []).append(_DIGITS.sub("#", value))
        else:
            number = math.nan if value is None else float(value)
            # A search by sampling knows small probabilities badly, and an eigenvector has no sign.
            if "probability" in path:
                number = round(number, 3)
            elif path.endswith("/component"):
                number = abs(number)
            numbers.setdefault(path, []).append(number)
    for path, values in sorted(numbers.items()):
        known = np.array([value for value in values if math.isfinite(value)])
        rms = float(np.sqrt(np.mean(known**2))) if known.size else 0.0
        logs = np.log10(np.maximum(np.abs(known), _SMALL * rms)) if rms > 0.0 else np.zeros(1)
        mean = float(known.mean()) if known.size else 0.0
        yield path, [len(values), *(float(f"{figure:.6g}") for figure in (mean, rms, float(logs.mean())))]
    for path, words in sorted(texts.items()):
        yield f"{path} (text)", [len(words), zlib.crc32("\n".join(sorted(words)).encode())]


# Entries that repeat the input or another entry, or that rounding decides.
_LEFT_OUT = frozenset(
    {
        *("robot", "format", "version", "data", "options", "priors", "cross_validation"),
        *("p95_um", "n", "folds", "seed", "iterations"),
    }
)


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in _LEFT_OUT:
                yield from _leaves(inner, f"{path}/{key}")
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _leaves(inner, path)
    else:
        yield path, value


def write() -> None:
    """Record all campaigns anew."""
    recorded = {name: summary(name) for name in campaigns()}
    lines = [
        f"{json.dumps(name)}: {{\n"
        + ",\n".join(f"{json.dumps(path)}: {json.dumps(figures)}" for path, figures in said.items())
        + "\n}"
        for name, said in recorded.items()
    ]
    RECORDED.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    write()
