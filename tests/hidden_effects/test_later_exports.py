"""A fit with any of the later effects exports to a table; effects that a device cannot know are listed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from armtrue_sim.cases import hidden_cases
from armtrue_sim.kinds import KINDS
from harness import known_to_the_model

ARMTRUE = str(Path(sys.executable).with_name("armtrue"))


def run(*arguments: object) -> None:
    done = subprocess.run([ARMTRUE, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.full
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.startswith("later")])
def test_fit_with_a_later_effect_exports_to_a_table(kind: str, tmp_path: Path) -> None:
    case = hidden_cases(kind, KINDS[kind].arms[0], 20000)
    case.campaign.write(tmp_path)
    (tmp_path / "true.yaml").write_text(yaml.safe_dump(known_to_the_model(case.true_model)))
    files = [
        tmp_path / name
        for name in ("data.csv", "robot.yaml", "true.yaml", "fit.json", "t.bin", "c.csv", "e.json")
    ]
    data, robot, model, fit, image, corrected, told = files
    run("fit", data, "--robot", robot, "--model", model, "--out", fit)
    run("export", fit, "--out", image, "--json", told)
    run("compensate", image, tmp_path / "test.csv", "--engine", "fixed", "--out", corrected)
    behind = json.loads(told.read_text())["stays_behind"]
    assert set(behind) == {"later_hysteresis": {"hysteresis"}, "later_self_heating": {"self_heating"}}.get(
        kind, set()
    )
