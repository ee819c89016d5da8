"""A URDF whose flange is kept level by mimic joints: a controller's file has columns for the motors only."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import yaml
from armtrue import check, load_data, load_robot
from armtrue.foreign import init
from armtrue_sim import simulate

DEGREE = math.pi / 180.0


def urdf_of(joints: list[dict]) -> str:
    """The palletiser of the simulator: two mimic joints on one axis undo the rotations of A2 and A3."""
    parts, parent, turned = ['<robot name="pal"><link name="base"/>'], "base", 0.0

    def add(name: str, place: str, more: str) -> None:
        nonlocal parent
        parts.append(
            f'<link name="{name}_link"/><joint name="{name}" type="continuous"><parent link="{parent}"/>'
            f'<child link="{name}_link"/>{place}<axis xyz="0 0 1"/>{more}</joint>'
        )
        parent = f"{name}_link"

    for row in joints:
        c, s = math.cos(turned), math.sin(turned)
        ca, sa = math.cos(row["alpha"]), math.sin(row["alpha"])
        x, y, z = row["a"], -sa * row["d"], ca * row["d"]
        place = f'<origin xyz="{c * x - s * y} {s * x + c * y} {z}" rpy="{row["alpha"]} 0 {turned}"/>'
        if row.get("passive"):
            add("level_a", place, '<mimic joint="A2" multiplier="-1"/>')
            add("level_b", "", '<mimic joint="A3" multiplier="-1"/>')
        else:
            add(row["name"], place, "")
        turned = row["offset"]
    return "".join([*parts, "</robot>"])


def test_mimic_joints_need_no_columns(tmp_path: Path) -> None:
    simulate({"arm": "palletiser", "seed": 2, "poses": 60, "test_poses": 0}, tmp_path / "made")
    joints = yaml.safe_load((tmp_path / "made/robot.yaml").read_text())["kinematics"]["joints"]
    (tmp_path / "pal.urdf").write_text(urdf_of(joints))
    with (tmp_path / "made/data.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    lines = [[*(f"J{k} [deg]" for k in range(1, 5)), "X [mm]", "Y [mm]", "Z [mm]"]]
    lines += [
        [f"{float(row[q]) / DEGREE:.7f}" for q in ("q1", "q2", "q3", "q5")]
        + [f"{1000 * float(row[axis]):.6f}" for axis in "xyz"]
        for row in rows
    ]
    (tmp_path / "log.csv").write_text("\n".join(map(",".join, lines)) + "\n")
    guessed = init([tmp_path / "log.csv"], tmp_path / "out", urdf=tmp_path / "pal.urdf")
    robot = load_robot(tmp_path / "out/robot.yaml")
    assert (robot.motors, robot.passive) == ([1, 2, 3, 6], [4, 5])
    assert any("level_a, level_b mimic others and have no motor" in note for note in guessed.notes)
    data = load_data(tmp_path / "out/dataset.yaml", robot)
    np.testing.assert_allclose(data.columns["q6"], [float(row["q5"]) for row in rows], atol=1e-8)
    assert not [finding for finding in check(data, robot).findings if finding.severity == "error"]
