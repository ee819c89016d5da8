"""The command line as its tests run it, and a simulated arm with a fit to run it on."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import armtrue_sim
import pytest
import yaml

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


def urdf_of(robot: Path, length: float = 1.0) -> str:
    """The arm in `robot`, a table in modified DH, as a URDF; lengths times `length`."""
    joints = yaml.safe_load(robot.read_text())["kinematics"]["joints"]
    parts = ['<robot name="arm"><link name="base"/>']
    parent, turned = "base", 0.0
    for k, row in enumerate(joints, start=1):
        # The offset of the joint before turns all that follows it about its z.
        c, s = math.cos(turned), math.sin(turned)
        ca, sa = math.cos(row["alpha"]), math.sin(row["alpha"])
        x, y, z = row["a"], -sa * row["d"], ca * row["d"]
        place = " ".join(f"{length * value}" for value in (c * x - s * y, s * x + c * y, z))
        parts.append(
            f'<link name="l{k}"/><joint name="j{k}" type="continuous"><parent link="{parent}"/><child link="l{k}"/>'
            f'<origin xyz="{place}" rpy="{row["alpha"]} 0 {turned}"/><axis xyz="0 0 1"/></joint>'
        )
        parent, turned = f"l{k}", row.get("offset", 0.0)
    parts.append(
        '<link name="tool0"/><joint name="end" type="fixed"><parent link="l6"/><child link="tool0"/>'
        f'<origin xyz="0 0 0" rpy="0 0 {turned}"/></joint></robot>'
    )
    return "".join(parts)
