"""`armtrue check` on files with one or two mistakes: it must name these, not another that fits half as well."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from armtrue import _core
from armtrue.cli.conftest import armtrue, urdf_of
from armtrue.io import load_robot
from armtrue.io.rotation import matrix_from_euler, matrix_from_rpy
from armtrue.tables.chain import chain_from_robot, pose

QUARTER = math.pi / 2
# A palletising-class arm: long links, and a controller that couples link angle 3 to joint 2.
TABLE = [
    {"a": 0.0, "alpha": 0.0, "d": 0.67},
    {"a": 0.312, "alpha": -QUARTER, "d": 0.0, "offset": -QUARTER},
    {"a": 1.075, "alpha": 0.0, "d": 0.0},
    {"a": 0.225, "alpha": -QUARTER, "d": 1.28},
    {"a": 0.0, "alpha": QUARTER, "d": 0.0},
    {"a": 0.0, "alpha": -QUARTER, "d": 0.215},
]
BASE = {"xyz": [1.0, 2.0, 0.3], "rpy": [0.1, 0.2, 0.7]}
TOOL = {"xyz": [0.05, 0.02, 0.2], "rpy": [0.3, -0.4, 1.1]}


def robot_file(path: Path, **changed: Any) -> Path:
    kinematics = {"convention": "mdh", "joints": copy.deepcopy(TABLE)}
    path.write_text(yaml.safe_dump({"name": "long", "kinematics": kinematics, **changed}))
    return path


def measured(robot: Path, joints: np.ndarray, noise_m: float = 0.0005) -> dict[str, np.ndarray]:
    """Columns of a data file: `joints`, and the points that the arm in `robot` reaches there, with noise."""
    columns = {f"q{k}": np.ascontiguousarray(values) for k, values in enumerate(joints.T, start=1)}
    spec = load_robot(robot).spec
    fit = {"robot": spec, "model": {"effects": []}, "parameters": [], "measuring_from_base": BASE}
    points = np.asarray(_core.predict(json.dumps({**fit, "flange_from_tool": {"": TOOL}}), columns))
    points = points + np.random.default_rng(3).normal(0.0, noise_m, points.shape)
    return columns | dict(zip("xyz", points.T, strict=True))


def write_csv(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, fmt="%.9f", delimiter=",", header=",".join(columns), comments="")
    return path


def poses(seed: int, spans: list[float], count: int = 40) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6)) * spans


def errors(data: Path, robot: Path, cwd: Path) -> list[dict[str, Any]]:
    run = armtrue("check", str(data), "--robot", str(robot), "--json", "-", cwd=cwd)
    assert run.returncode in (0, 1), run.stderr
    found = [finding for finding in json.loads(run.stdout)["findings"] if finding["severity"] == "error"]
    assert run.returncode == bool(found)
    return found


WIDE = [1.5, 0.7, 0.7, 2.0, 1.5, 3.0]
# Campaigns in which link 2 moves little and against link 3: a scale then fits half as well as a coupling.
NARROW = [1.5, 0.14, 0.14, 2.0, 1.5, 3.0]


@pytest.mark.quick("spans0-0.0-1.0")
@pytest.mark.parametrize(
    ("spans", "against", "ratio"),
    [
        (WIDE, 0.0, 1.0),
        (NARROW, 1.0, -1.0),
        *(pytest.param(*rest, marks=pytest.mark.full)
          for rest in [(WIDE, 0.0, -1.0), (NARROW, 1.0, 1.0), (NARROW, 0.5, 1.0), (NARROW, 0.5, -1.0)]),
    ],
)  # fmt: skip
def test_check_names_coupled_joints_as_coupling_not_as_scale(tmp_path, ratio, spans, against):
    truth = robot_file(tmp_path / "truth.yaml", coupling=[{"joint": 3, "driving": 2, "ratio": ratio}])
    joints = poses(7, spans)
    joints[:, 2] = (joints[:, 2] - against * ratio * joints[:, 1]) if against else joints[:, 2]
    data = write_csv(tmp_path / "data.csv", measured(truth, joints))
    (found,) = errors(data, robot_file(tmp_path / "robot.yaml"), tmp_path)
    assert found["code"] == "coupling"
    assert f"link angle 3 follows q3 {'+' if ratio > 0 else '−'} q2" in found["message"]
    assert found["evidence"]["rms_m_if_changed"] < 1.2e-3
    assert "turn joint 2 alone and watch the encoder of joint 3's motor" in found["remedy"]
    assert "kind: controller" in found["remedy"]
    remedied = yaml.safe_load(found["remedy"].split("'")[1])
    assert errors(data, robot_file(tmp_path / "robot.yaml", **remedied), tmp_path) == []


@pytest.mark.full
def test_check_issue_13_coupling_is_not_reported_as_scale(tmp_path):
    """On this arm check reported 2.2 times the size: joints 2 and 3 move against each other, 20 poses."""
    truth = robot_file(tmp_path / "truth.yaml", coupling=[{"joint": 3, "driving": 2, "ratio": 1.0}])
    for seed in range(6):
        joints = poses(seed, [0.2, 0.7, 0.14, 0.2, 1.5, 0.2], count=20)
        joints[:, 2] -= joints[:, 1]
        data = write_csv(tmp_path / "data.csv", measured(truth, joints))
        found = errors(data, robot_file(tmp_path / "robot.yaml"), tmp_path)
        assert [one["code"] for one in found] == ["coupling"], (seed, found)


def test_check_names_the_convention_of_mdh_table_stated_as_dh(tmp_path):
    truth = robot_file(tmp_path / "truth.yaml")
    data = write_csv(tmp_path / "data.csv", measured(truth, poses(1, WIDE)))
    text = truth.read_text().replace("convention: mdh", "convention: dh")
    (tmp_path / "robot.yaml").write_text(text)
    (found,) = errors(data, tmp_path / "robot.yaml", tmp_path)
    assert found["code"] == "dh_convention"
    assert "'convention: mdh'" in found["remedy"]


def test_check_names_small_joint_angles_that_are_in_degrees(tmp_path):
    truth = robot_file(tmp_path / "truth.yaml")
    columns = measured(truth, poses(2, [0.08, 0.05, 0.05, 0.08, 0.07, 0.08]), noise_m=1e-4)
    columns |= {f"q{k}": np.degrees(columns[f"q{k}"]) for k in range(1, 7)}
    data = write_csv(tmp_path / "data.csv", columns)
    assert "joints_in_degrees" in [one["code"] for one in errors(data, truth, tmp_path)]


@pytest.mark.quick("change1-codes1")
@pytest.mark.parametrize(
    ("change", "codes"),
    [
        ({"q3": -1.0, "z": -1.0}, ["joint_sign", "left_handed_frame"]),
        ({"q2": -1.0, "swap": 1.0}, ["joint_sign", "joints_swapped"]),
        *(pytest.param(*rest, marks=pytest.mark.full)
          for rest in [({"q5": -1.0, "zero": 1.0}, ["joint_sign", "joint_zero"]),
                       ({"q6": -1.0, "xyz": 1.3}, ["joint_sign", "scale"])]),
    ],
)  # fmt: skip
def test_check_two_mistakes_at_once_are_both_named(tmp_path, change, codes):
    truth = robot_file(tmp_path / "truth.yaml")
    columns = measured(truth, poses(4, WIDE))
    if "swap" in change:
        columns["q4"], columns["q6"] = columns["q6"], columns["q4"]
    if "zero" in change:
        columns["q3"] = columns["q3"] + QUARTER
    for name, factor in change.items():
        for column in name if name == "xyz" else [name]:
            if column in columns:
                columns[column] = factor * columns[column]
    found = errors(write_csv(tmp_path / "data.csv", columns), truth, tmp_path)
    assert sorted(one["code"] for one in found) == codes
    if "zero" in change:
        assert "joint 3 has its zero -90° from" in "".join(one["message"] for one in found)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.full) for seed in (1, 2))])
def test_check_finds_no_error_in_an_uncalibrated_arm(tmp_path, seed):
    """Errors of 0.004 rad at each joint and 1 mm at each link (1 sigma) are found by a fit, not by check."""
    rng = np.random.default_rng(seed)
    truth = robot_file(tmp_path / "truth.yaml")
    spec = yaml.safe_load(truth.read_text())
    for row in spec["kinematics"]["joints"]:
        row["offset"] = row.get("offset", 0.0) + float(rng.normal(0.0, 0.004))
        row["a"] += float(rng.normal(0.0, 0.001))
    (tmp_path / "real.yaml").write_text(yaml.safe_dump(spec))
    data = write_csv(tmp_path / "data.csv", measured(tmp_path / "real.yaml", poses(seed, WIDE)))
    assert errors(data, truth, tmp_path) == []


@pytest.mark.quick("written1-read1")
@pytest.mark.parametrize(
    ("written", "read"),
    [
        (("ZYX", "intrinsic", "deg"), ("XYZ", "intrinsic", "deg")),
        (("XYZ", "extrinsic", "rad"), ("XYZ", "extrinsic", "deg")),
        *(pytest.param((order, "intrinsic", "deg"), ("XYZ", "extrinsic", "deg"), marks=pytest.mark.full)
          for order in ("XYZ", "ZYZ")),
    ],
)  # fmt: skip
def test_check_names_the_true_convention_of_euler_angles(tmp_path, written, read):
    robot = robot_file(tmp_path / "robot.yaml")
    joints = poses(5, WIDE)
    columns = measured(robot, joints)
    chain = chain_from_robot(load_robot(robot).spec)
    turned = (pose(BASE) @ chain.tool_poses(joints, pose(TOOL)))[:, :3, :3]
    sequence, axes, unit = written
    angles = np.array([angles_of(matrix, sequence.lower(), axes == "intrinsic") for matrix in turned])
    columns |= dict(zip("ABC", (angles if unit == "rad" else np.degrees(angles)).T, strict=True))
    write_csv(tmp_path / "data.csv", columns)
    names = {name: name for name in columns if name not in "ABC"}
    layout = {"form": "euler", "columns": ["A", "B", "C"]}

    def check_with(rotation: dict[str, Any]) -> list[dict[str, Any]]:
        dataset = {"file": "data.csv", "columns": names, "rotation": {**layout, **rotation}}
        (tmp_path / "dataset.yaml").write_text(yaml.safe_dump(dataset))
        return errors(tmp_path / "dataset.yaml", robot, tmp_path)

    (found,) = check_with({"sequence": read[0], "axes": read[1], "unit": read[2]})
    assert found["code"] == "orientations_do_not_follow"
    named = yaml.safe_load(found["remedy"].split("'")[1])["rotation"]
    assert named["unit"] == unit
    assert check_with(named) == []


def angles_of(matrix: np.ndarray, sequence: str, intrinsic: bool) -> np.ndarray:
    """Euler angles of a rotation by Newton's method: slow, but one formula for all sequences."""
    for start in np.random.default_rng(0).uniform(-1.5, 1.5, (50, 3)):
        angles = start
        for _ in range(30):
            now = matrix_from_euler(angles, sequence, intrinsic)
            moved = [matrix_from_euler(angles + 1e-7 * step, sequence, intrinsic) for step in np.eye(3)]
            jacobian = np.column_stack([((one - now) / 1e-7).ravel() for one in moved])
            angles = angles + np.linalg.lstsq(jacobian, (matrix - now).ravel(), rcond=None)[0]
        if np.abs(matrix_from_euler(angles, sequence, intrinsic) - matrix).max() < 1e-6:
            return angles
    raise AssertionError("no angles found")


def test_pose_of_the_tool_uses_the_rpy_convention_of_robot_yaml():
    assert np.allclose(pose(TOOL)[:3, :3], matrix_from_rpy(TOOL["rpy"]))


@pytest.mark.full
def test_check_remedy_of_a_joint_zero_can_be_pasted_with_a_urdf(folder, tmp_path):
    (tmp_path / "arm.urdf").write_text(urdf_of(folder / "robot.yaml"))
    (tmp_path / "robot.yaml").write_text("kinematics: {urdf: arm.urdf, base: base, tip: tool0}\n")
    names, *rows = [line.split(",") for line in (folder / "data.csv").read_text().splitlines()]
    kept = [names.index(name) for name in ("q1", "q2", "q3", "q4", "q5", "q6", "x", "y", "z")]
    lines = [",".join(names[at] for at in kept)]
    for row in rows:
        row[2] = str(float(row[2]) + 1.5707963)
        lines.append(",".join(row[at] for at in kept))
    (tmp_path / "data.csv").write_text("\n".join(lines))
    run = armtrue("check", "data.csv", "--robot", "robot.yaml", "--json", "c.json", cwd=tmp_path)
    assert run.returncode == 1
    (found,) = [
        f for f in json.loads((tmp_path / "c.json").read_text())["findings"] if f["code"] == "joint_zero"
    ]
    entry = found["remedy"].split("'")[1]
    columns = ", ".join(entry if name == "q3" else f"{name}: {name}" for name in lines[0].split(","))
    (tmp_path / "dataset.yaml").write_text(f"file: data.csv\ncolumns: {{{columns}}}\n")
    mended = armtrue("check", "dataset.yaml", "--robot", "robot.yaml", cwd=tmp_path)
    assert mended.returncode == 0, mended.stdout


def test_check_names_stuck_thermometer_and_constant_direction(tmp_path):
    robot = robot_file(tmp_path / "robot.yaml", temperature={"reference": 20.0, "sensors": ["arm", "hall"]})
    columns = measured(robot, poses(2, WIDE, count=90), noise_m=2e-5)
    rng = np.random.default_rng(5)
    for k in range(1, 7):
        columns[f"dir{k}"] = np.ones(90) if k == 2 else rng.choice([-1.0, 1.0], 90)
    columns["time"] = 30.0 * np.arange(90)
    columns["temp_arm"] = 20.0 + np.linspace(0.0, 6.0, 90) + rng.normal(0.0, 0.02, 90)
    columns["temp_arm"][40:70] = columns["temp_arm"][40]
    columns["temp_hall"] = 22.0 + np.linspace(0.0, 2.0, 90) + rng.normal(0.0, 0.02, 90)
    write_csv(tmp_path / "data.csv", columns)
    run = armtrue("check", "data.csv", "--robot", "robot.yaml", "--json", "c.json", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    found = {one["code"]: one for one in json.loads((tmp_path / "c.json").read_text())["findings"]}
    still = found["temperature_stands"]
    assert still["severity"] == "warning"
    assert still["evidence"]["rows"] == list(range(42, 72))
    assert "from row 42 to row 71 (30 of 90 rows, 14 min), while temp_hall changed by 0." in still["message"]
    assert found["never_changes"]["evidence"]["columns"] == ["dir2"]
    said = " ".join(run.stdout.split())
    assert "column dir2: found 1 in all rows: joint 2 approached all poses from one side" in said
    assert "the thermometer stopped updating" in said
