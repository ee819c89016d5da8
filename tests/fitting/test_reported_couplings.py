"""A serial arm whose controller reports coupled joint angles: effects act at the angles of the drives."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from armtrue.cli.conftest import run_forked

MODEL = {
    "effects": [
        *("base_frame", "tool_offset", "joint_offset", "link_geometry"),
        {"effect": "joint_compliance", "joints": [2, 3]},
        {"effect": "gear_harmonics", "joints": [3], "orders": [1]},
    ]
}
COUPLING = [{"joint": 3, "driving": 2, "ratio": -1.0, "kind": "controller"}]


def run(*arguments: object) -> None:
    done = run_forked(*map(str, arguments))
    assert done.returncode == 0, done.stderr


def table(path: Path) -> tuple[list[str], np.ndarray]:
    head, *rows = list(csv.reader(path.open()))
    return head, np.array(rows, dtype=float)


def reported(path: Path, out: Path, sign: float = 1.0) -> None:
    """Write the poses as such a controller reports them: q3 = drive 3 + q2."""
    head, rows = table(path)
    rows[:, head.index("q3")] += sign * rows[:, head.index("q2")]
    out.write_text("\n".join([",".join(head), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n")


@pytest.fixture
def folders(campaign, tmp_path: Path) -> tuple[Path, Path]:
    """The same measurements with the angles of the drives, and with those that the controller reports."""
    campaign(hidden=["joint_compliance"], poses=150)
    plain, coupled = tmp_path / "plain", tmp_path / "coupled"
    for folder in (plain, coupled):
        folder.mkdir()
        (folder / "model.yaml").write_text(json.dumps(MODEL))
    robot = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    assert "coupling" not in robot
    (plain / "robot.yaml").write_text(yaml.safe_dump(robot))
    (coupled / "robot.yaml").write_text(yaml.safe_dump({**robot, "coupling": COUPLING}))
    reported(tmp_path / "data.csv", plain / "data.csv", 0.0)
    reported(tmp_path / "data.csv", coupled / "data.csv")
    for folder in (plain, coupled):
        files = [folder / name for name in ("data.csv", "robot.yaml", "model.yaml", "fit.json")]
        run("fit", files[0], "--robot", files[1], "--model", files[2], "--out", files[3])
    return plain, coupled


def test_coupled_angles_give_the_same_fit_as_drive_angles(folders: tuple[Path, Path]) -> None:
    found = []
    for folder in folders:
        run("predict", folder / "fit.json", folder / "data.csv", "--out", folder / "p.csv")
        found.append(table(folder / "p.csv")[1])
    assert found[1] == pytest.approx(found[0], abs=1e-9)
    springs = [
        [
            p["value"]
            for p in json.loads((folder / "fit.json").read_text())["parameters"]
            if "compl" in p["effect"]
        ]
        for folder in folders
    ]
    assert springs[1] == pytest.approx(springs[0], rel=1e-6)


@pytest.mark.full
@pytest.mark.parametrize("engine", ["fixed", "double"])
def test_corrected_commands_are_controller_angles(folders: tuple[Path, Path], engine: str) -> None:
    plain, coupled = folders
    for folder in folders:
        run("export", folder / "fit.json", "--out", folder / "t.bin")
        run(
            "compensate", folder / "t.bin", folder / "data.csv", "--engine", engine, "--out", folder / "c.csv"
        )
    reported(plain / "c.csv", plain / "as_reported.csv")
    assert table(coupled / "c.csv")[1] == pytest.approx(table(plain / "as_reported.csv")[1], abs=2e-8)
