"""The four campaigns in ../shared/examples, made by another generator than ours, through the command line."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from harness import effects_named

EXAMPLES = Path(__file__).resolve().parents[3] / "shared" / "examples"
ARMTRUE = str(Path(sys.executable).with_name("armtrue"))
# Largest error on fresh exact poses, relative to a fit that includes the hidden effects from the start.
AS_GOOD = 1.1
# The examples' README gives 2.4 to 3.2 µm for a fit that includes the hidden effects.
FRESH_POSES_M = 3.5e-6

pytestmark = pytest.mark.skipif(not EXAMPLES.is_dir(), reason="../shared/examples is not here")


def run(*arguments: object) -> None:
    done = subprocess.run([ARMTRUE, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.quick("cobot-two-effects")
@pytest.mark.parametrize(
    "name",
    [
        "cobot-two-effects",
        "irb2400-parallelogram",
        "kr30-eccentric-gear",
        "kr30-nothing-hidden",
    ],
)
def test_hidden_effects_are_found_and_fresh_poses_predicted(name: str, tmp_path: Path) -> None:
    given = EXAMPLES / name
    fit, best, document, predicted = (
        tmp_path / part for part in ("fit.json", "best.json", "out.json", "p.csv")
    )
    run(
        "fit",
        given / "data.csv",
        "--robot",
        given / "robot.yaml",
        "--model",
        given / "model.yaml",
        "--out",
        fit,
    )
    run("refine", fit, "--out", best, "--json", document)
    told = json.loads(document.read_text())
    hidden = effects_named(json.loads((given / "hidden.json").read_text())) - {"none"}
    assert hidden <= effects_named(told["effects"])
    # The contract: a probability for each effect that refine added, and none for effects of the initial model.
    stood = told["steps"][0]["effects"]
    for entry in told["effects"]:
        probability = entry.pop("probability", None)
        assert (probability is None) == (entry in stood), entry
        assert probability is None or 0.9 < probability <= 1.0, entry
    assert told["steps"][-1]["verdict"] == "nothing_missing"
    model = yaml.safe_load((given / "model.yaml").read_text())
    model["effects"] += [
        entry for entry in json.loads((given / "hidden.json").read_text()) if entry["effect"] != "none"
    ]
    (tmp_path / "handed.yaml").write_text(yaml.safe_dump(model))
    run(
        "fit",
        given / "data.csv",
        "--robot",
        given / "robot.yaml",
        "--model",
        tmp_path / "handed.yaml",
        "--out",
        fit,
    )
    handed = error(fit, given, tmp_path)
    assert handed < FRESH_POSES_M
    assert error(best, given, tmp_path) < AS_GOOD * handed


def error(fit: Path, given: Path, folder: Path) -> float:
    """Mean distance [m] of prediction and exact position at the fresh poses."""
    run("predict", fit, given / "test.csv", "--out", folder / "p.csv")
    found, exact = (points(path) for path in (folder / "p.csv", given / "test.csv"))
    return float(np.linalg.norm(found - exact, axis=1).mean())


def points(path: Path) -> np.ndarray:
    with path.open(newline="") as file:
        return np.array([[float(row[axis]) for axis in "xyz"] for row in csv.DictReader(file)])
