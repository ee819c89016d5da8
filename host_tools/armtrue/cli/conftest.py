"""The command line as its tests run it, and a simulated arm with a fit to run it on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import armtrue_sim
import pytest

SCENARIO = Path(__file__).resolve().parents[3] / "sim" / "scenarios" / "kr30-eccentric-gear.yaml"
FIT = ("fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml")


def armtrue(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command as a person does; a traceback is never right."""
    command = [sys.executable, "-m", "armtrue", *arguments]
    run = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)
    assert "Traceback" not in run.stderr, run.stderr
    return run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of an arm with an eccentric gear, and fit.json of what its owner believes in."""
    made = tmp_path_factory.mktemp("campaign")
    armtrue_sim.cli_simulate(SCENARIO, made)
    run = armtrue(*FIT, "--out", "fit.json", cwd=made)
    assert run.returncode == 0, run.stderr
    return made
