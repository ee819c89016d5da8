"""Runs `armtrue` commands for tests, on a simulated arm with a fit."""

from __future__ import annotations

import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from pkgutil import iter_modules

import armtrue_sim
import pytest
import yaml

from armtrue import cli

SCENARIO = Path(__file__).resolve().parents[3] / "sim" / "scenarios" / "kr30-eccentric-gear.yaml"
FIT = ("fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml")


# Importing the libraries takes longer than most commands. So a server imports them once, and every command is a
# process forked from it. (Tests of the start itself, and campaigns, run `armtrue` in a new interpreter.)
_forks = multiprocessing.get_context("forkserver")
_forks.set_forkserver_preload(
    ["armtrue._core", "armtrue.report"]
    + [
        f"armtrue.cli.{m.name}"
        for m in iter_modules(cli.__path__)
        if not m.name.startswith(("test_", "conf"))
    ]
)


def _begin(
    arguments: tuple[str, ...], cwd: Path | str, environment: dict[str, str], said: tuple[str, str]
) -> None:
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    for stream, path in enumerate((os.devnull, *said)):
        os.dup2(os.open(path, os.O_RDWR), stream)
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115 (open until the process ends)
    sys.argv = ["armtrue", *arguments]
    cli.main()


def run_forked(
    *arguments: str, cwd: Path | str = ".", timeout: float = 120.0
) -> subprocess.CompletedProcess[str]:
    """Run `armtrue ARGUMENTS` in the folder `cwd`; raises subprocess.TimeoutExpired after `timeout` seconds."""
    with tempfile.NamedTemporaryFile("r") as out, tempfile.NamedTemporaryFile("r") as err:
        process = _forks.Process(target=_begin, args=(arguments, cwd, dict(os.environ), (out.name, err.name)))
        process.start()
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            raise subprocess.TimeoutExpired(("armtrue", *arguments), timeout)
        return subprocess.CompletedProcess(arguments, process.exitcode, out.read(), err.read())


def armtrue(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command as a user does; a traceback fails the test."""
    run = run_forked(*arguments, cwd=cwd)
    assert "Traceback" not in run.stderr, run.stderr
    return run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of an arm with an eccentric gear, and fit.json of its model.yaml."""
    made = tmp_path_factory.mktemp("campaign")
    armtrue_sim.cli_simulate(SCENARIO, made)
    run = armtrue(*FIT, "--out", "fit.json", cwd=made)
    assert run.returncode == 0, run.stderr
    return made


def urdf_of(robot: Path, length: float = 1.0) -> str:
    """A URDF of the arm in `robot` (a modified DH table), with all lengths multiplied by `length`."""
    joints = yaml.safe_load(robot.read_text())["kinematics"]["joints"]
    parts = ['<robot name="arm"><link name="base"/>']
    parent, turned = "base", 0.0
    for k, row in enumerate(joints, start=1):
        # The offset of the previous joint turns everything after that joint about its z axis.
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
