"""The effect that docs/adding-an-effect.md writes is built, found, exported and compensated."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from armtrue_sim import simulate
from armtrue_sim.campaign import Campaign, csv_text

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "release"
PACKAGE = ROOT / "host_tools" / "armtrue"
GUIDE = ROOT / "docs" / "adding-an-effect.md"

Armtrue = Callable[..., str]


def build_commands() -> list[list[str]]:
    """The commands that make `_core`, as CMake wrote them for ninja, the link last."""
    said = subprocess.run(
        ["ninja", "-C", str(BUILD), "-t", "commands", "armtrue_core_python"],
        capture_output=True,
        text=True,
        check=True,
    )
    return [shlex.split(line) for line in said.stdout.splitlines()]


def build_core_with(source: Path, to: Path) -> None:
    """Compile one more effect as the fitter's own are, and link it into a copy of the library."""
    commands = build_commands()
    of_the_fitter = [c for c in commands if c[-2:-1] == ["-c"] and "armtrue_fitter.dir/Unity" in c[-1]]
    built = str(source.with_suffix(".o"))
    compiler = of_the_fitter[0]
    without_dependencies = compiler[: compiler.index("-MD")]
    subprocess.run([*without_dependencies, "-O1", "-o", built, "-c", str(source)], cwd=BUILD, check=True)
    link = [word for word in commands[-1] if word not in (":", "&&")]
    place = link.index("-o")
    library = to / Path(link[place + 1]).name
    link[place + 1] = str(library)
    subprocess.run([*link[: place + 2], built, *link[place + 2 :]], cwd=BUILD, check=True)


@pytest.fixture(scope="module")
def armtrue(tmp_path_factory: pytest.TempPathFactory) -> Armtrue:
    """The command of a copy of the package whose library has the guide's effect."""
    folder = tmp_path_factory.mktemp("built")
    (text,) = re.findall(r"```cpp\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    (folder / "belt_stretch.cc").write_text(text)
    shutil.copytree(PACKAGE, folder / "armtrue", ignore=shutil.ignore_patterns("_core*.so", "__pycache__"))
    build_core_with(folder / "belt_stretch.cc", folder / "armtrue")
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONSAFEPATH": "1"}

    def run(*arguments: str, cwd: Path) -> str:
        ran = subprocess.run(
            [sys.executable, "-m", "armtrue", *arguments],
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ran.returncode == 0, ran.stdout + ran.stderr
        return ran.stdout

    return run


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Path]:
    folder = tmp_path_factory.mktemp("campaign")
    belt = {"effect": "custom", "name": "belt", "coordinate": "motor2", "expression": "tau3", "value": 6e-7}
    believed = ["base_frame", "tool_offset", "joint_offset", "link_geometry", "joint_compliance"]
    scenario = {"arm": "kr30", "seed": 31, "poses": 300, "test_poses": 60, "believed": believed}
    return simulate({**scenario, "hidden": [belt]}, folder), folder


def table(path: Path, names: list[str]) -> np.ndarray:
    rows = np.genfromtxt(path, delimiter=",", names=True)
    return np.column_stack([rows[name] for name in names])


@pytest.mark.full
def test_effect_of_the_guide_is_found_exported_and_compensated(
    armtrue: Armtrue, campaign: tuple[Campaign, Path]
) -> None:
    simulated, folder = campaign
    armtrue(
        "fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml", "--out", "fit.json", cwd=folder
    )
    armtrue("refine", "fit.json", "--out", "best.json", cwd=folder)
    before, after = (json.loads((folder / name).read_text()) for name in ("fit.json", "best.json"))
    added = [e for e in after["model"]["effects"] if e not in before["model"]["effects"]]
    assert [(e["effect"], e["joints"]) for e in added] == [("belt_stretch", [2])]
    (belt,) = (p for p in after["parameters"] if p["effect"] == "belt_stretch")
    assert abs(belt["value"] - 6e-7) < 4.0 * belt["sigma"]

    fresh = {name: values for name, values in simulated.test.items() if name not in ("x", "y", "z")}
    (folder / "poses.csv").write_text(csv_text(fresh))
    joints = [f"q{k}" for k in range(1, simulated.arm.chain.n + 1)]
    missed_um = {}
    for name in ("fit", "best"):
        armtrue("export", f"{name}.json", "--out", "tables.bin", cwd=folder)
        armtrue("compensate", "tables.bin", "poses.csv", "--engine", "fixed", "--out", "c.csv", cwd=folder)
        reached = simulated.arm.true_position(
            table(folder / "c.csv", joints), fresh, measurement_effects=False
        )
        missed = np.linalg.norm(reached - table(folder / "c.csv", ["tx", "ty", "tz"]), axis=1)
        missed_um[name] = 1e6 * float(np.median(missed))
    # The remaining error: uncertainty of a fit to 300 noisy poses, and the tables' resolution.
    assert missed_um["best"] < 15.0
    assert missed_um["fit"] > 3.0 * missed_um["best"]
