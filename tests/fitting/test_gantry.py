"""Gantries (three prismatic joints): Denavit-Hartenberg rows with an angle theta, and their noise."""

from __future__ import annotations

import math
from pathlib import Path

import armtrue
import numpy as np
import pytest
import yaml
from armtrue.cli.conftest import run_forked
from armtrue.tables.chain import chain_from_robot
from armtrue_sim.mechanics.chain import Chain
from numpy.typing import NDArray

Array = NDArray[np.float64]
QUARTER = math.pi / 2
# alpha, a, d, theta; the first slide goes along the base's z, the second along its x, the third along its y.
ROWS = [(0.0, 0.0, 0.1, 0.0), (-QUARTER, 0.05, 0.0, -QUARTER), (-QUARTER, 0.0, 0.2, 0.0)]
LIMITS = [[0.0, 2.0], [0.0, 1.5], [0.0, 0.8]]
TOOL = np.array([0.05, -0.03, 0.12])
GEOMETRY = [{"effect": e} for e in ("base_frame", "tool_offset", "joint_offset", "link_geometry")]


def about(axis: int, angle: float) -> Array:
    pose = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    pose[i, i] = pose[j, j] = math.cos(angle)
    pose[j, i], pose[i, j] = math.sin(angle), -math.sin(angle)
    return pose


def along(x: float, z: float) -> Array:
    pose = np.eye(4)
    pose[0, 3], pose[2, 3] = x, z
    return pose


def flange(joints: Array, convention: str) -> Array:
    """Base from flange as Craig (mdh) or Denavit and Hartenberg (dh) write it."""
    pose = np.eye(4)
    for (alpha, a, d, theta), q in zip(ROWS, joints, strict=True):
        link = about(0, alpha) @ along(a, 0.0)
        joint = about(2, theta) @ along(0.0, d + q)
        pose = pose @ (link @ joint if convention == "mdh" else joint @ link)
    return pose


def robot_file(folder: Path, convention: str) -> Path:
    joints = [
        {"type": "prismatic", "alpha": alpha, "a": a, "d": d, "theta": theta, "limits": limits}
        for (alpha, a, d, theta), limits in zip(ROWS, LIMITS, strict=True)
    ]
    path = folder / "robot.yaml"
    path.write_text(
        yaml.safe_dump({"name": "gantry", "kinematics": {"convention": convention, "joints": joints}})
    )
    return path


def measured(folder: Path, convention: str, poses: int, sigma_m: float, seed: int = 0) -> Path:
    rng = np.random.default_rng(seed)
    lines = ["q1,q2,q3,x,y,z"]
    for joints in rng.uniform(*np.transpose(LIMITS), (poses, 3)):
        point = (flange(joints, convention) @ [*TOOL, 1.0])[:3] + rng.normal(0.0, sigma_m, 3)
        lines.append(",".join(f"{value:.9f}" for value in (*joints, *point)))
    path = folder / "data.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("convention", ["mdh", "dh"])
def test_all_parts_read_theta_of_a_prismatic_joint(tmp_path, convention):
    robot = armtrue.load_robot(robot_file(tmp_path, convention))
    joints = np.array([[0.3, 1.1, 0.4], [1.7, 0.2, 0.6]])
    expected = np.array([flange(q, convention) for q in joints])
    tables, simulator = chain_from_robot(robot.spec), Chain.from_robot(robot.spec)
    assert np.allclose(tables.frames(joints)[-1] @ tables.end, expected, atol=1e-12)
    frames = simulator.frames(simulator.link_variables(joints))
    assert np.allclose(frames.flange_rotation, expected[:, :3, :3], atol=1e-12)
    assert np.allclose(frames.flange_origin, expected[:, :3, 3], atol=1e-12)
    data = armtrue.load_data(measured(tmp_path, convention, 40, 0.0), robot)
    fit = armtrue.fit(data, robot, armtrue.Model([{"effect": "base_frame"}]))
    assert fit.document["error"]["train"]["max_um"] < 0.1


def test_isotropic_scatter_is_attributed_to_the_readings(tmp_path):
    """Three prismatic joints of equally poor repeatability would give the same data: readings are the simpler cause."""
    robot = armtrue.load_robot(robot_file(tmp_path, "mdh"))
    for seed in range(4):
        data = armtrue.load_data(measured(tmp_path, "mdh", 120, 15e-6, seed), robot)
        noise = armtrue.diagnose(armtrue.fit(data, robot, armtrue.Model(GEOMETRY)))["noise"]
        assert noise["joints_urad"] == [0.0, 0.0, 0.0], seed
        assert noise["reading_um"] == pytest.approx(15.0, rel=0.1)


def test_theta_in_degrees_is_refused(tmp_path):
    path = robot_file(tmp_path, "mdh")
    path.write_text(path.read_text().replace("theta: -1.5", "theta: -90.5"))
    with pytest.raises(armtrue.InputError, match=r"joints\[2\].theta: found -90.5.*degrees"):
        armtrue.load_robot(path)


def test_init_reads_a_dh_table_of_prismatic_joints(tmp_path):
    lines = ["joint;type;a [mm];alpha [deg];d [mm];theta [deg]"]
    for k, (alpha, a, d, theta) in enumerate(ROWS, start=1):
        cells = (1000.0 * a, math.degrees(alpha), 1000.0 * d, math.degrees(theta))
        lines.append(";".join([str(k), "prismatic", *(f"{value:g}" for value in cells)]))
    (tmp_path / "arm.csv").write_text("\n".join(lines) + "\n")
    data = measured(tmp_path, "mdh", 40, 0.0).read_text().splitlines()
    millimetres = [",".join(f"{1000.0 * float(cell):.6f}" for cell in line.split(",")) for line in data[1:]]
    (tmp_path / "log.csv").write_text(
        "\n".join(["J1 [mm],J2 [mm],J3 [mm],X [mm],Y [mm],Z [mm]", *millimetres]) + "\n"
    )
    ran = run_forked("init", "log.csv", "--dh", "arm.csv", "--out", "made", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    robot = armtrue.load_robot(tmp_path / "made" / "robot.yaml")
    assert robot.spec["kinematics"]["convention"] == "mdh"
    assert [round(joint["theta"], 6) for joint in robot.joints] == [round(row[3], 6) for row in ROWS]
    data_read = armtrue.load_data(tmp_path / "made" / "dataset.yaml", robot)
    fit = armtrue.fit(data_read, robot, armtrue.Model([{"effect": "base_frame"}, {"effect": "tool_offset"}]))
    assert fit.document["error"]["train"]["max_um"] < 0.1
