"""`armtrue init` on foreign layouts: from exported files to a first diagnosis without editing any file."""

from __future__ import annotations

import csv
import json
import math
import re
import shlex
from pathlib import Path
from typing import Any

import armtrue_sim
import numpy as np
import pytest
import yaml

from armtrue.cli.conftest import armtrue, urdf_of
from armtrue.cli.test_check import angles_of
from armtrue.io import load_robot
from armtrue.tables.chain import chain_from_robot, pose

SCENARIO = Path(__file__).resolve().parents[3] / "sim" / "scenarios" / "kr30-eccentric-gear.yaml"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("campaign")
    armtrue_sim.cli_simulate(SCENARIO, made)
    return made


@pytest.fixture(scope="module")
def rows(campaign) -> list[dict[str, str]]:
    with (campaign / "data.csv").open() as stream:
        return list(csv.DictReader(stream))


def joints_deg(row: dict[str, str]) -> list[str]:
    return [f"{math.degrees(float(row[f'q{k}'])):.7f}" for k in range(1, 7)]


def millimetres(row: dict[str, str]) -> list[str]:
    return [f"{1000 * float(row[axis]):.5f}" for axis in "xyz"]


def write(path: Path, lines: list[list[str]], separator: str = ",") -> Path:
    path.write_text("\n".join(separator.join(cells) for cells in lines) + "\n")
    return path


def dh_table(campaign: Path, path: Path) -> Path:
    """Write the arm as users keep it: a DH table with semicolons, in millimetres and degrees."""
    joints = yaml.safe_load((campaign / "robot.yaml").read_text())["kinematics"]["joints"]
    lines = [["Joint", "a [mm]", "alpha [deg]", "d [mm]", "theta [deg]"]]
    for row in joints:
        figures = (
            1000 * row["a"],
            math.degrees(row["alpha"]),
            1000 * row["d"],
            math.degrees(row.get("offset", 0.0)),
        )
        lines.append([row["name"], *(f"{value:.6f}" for value in figures)])
    return write(path, lines, ";")


def to_first_diagnosis(where: Path, *arguments: str) -> dict[str, Any]:
    """Run init, then every command that it prints, then diagnose; return fit.json."""
    run = armtrue("init", *arguments, "--out", "arm", cwd=where)
    assert run.returncode == 0, run.stdout + run.stderr
    commands = [shlex.split(line)[1:] for line in run.stdout.splitlines() if line.startswith("  armtrue ")]
    assert [command[0] for command in commands] == ["check", "fit"]
    for command in commands:
        step = armtrue(*command, cwd=where)
        assert step.returncode == 0, step.stdout + step.stderr
    found = armtrue("diagnose", "arm/fit.json", "--json", "-", cwd=where)
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["verdict"] == "missing_effect"
    fit = json.loads((where / "arm" / "fit.json").read_text())
    # The model is geometry alone, without springs: better than the data sheet, and a spring is missing.
    assert fit["error"]["held_out"]["mean_um"] < 0.9 * fit["error"]["nominal"]["mean_um"] < 4000.0
    return fit


@pytest.mark.full
def test_init_reads_instrument_headers_in_degrees_and_millimetres(tmp_path, campaign, rows):
    header = ["Point ID", *(f"A{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]", "Temperature"]
    lines = [header]
    for number, row in enumerate(rows, start=1):
        lines.append([f"P{number}", *joints_deg(row), *millimetres(row), row["temp_arm"]])
    write(tmp_path / "export.csv", lines)
    dh_table(campaign, tmp_path / "arm.csv")
    fit = to_first_diagnosis(tmp_path, "export.csv", "--dh", "arm.csv")
    assert fit["data"]["rows"] == len(rows)
    assert fit["robot"]["kinematics"]["convention"] == "mdh"
    dataset = (tmp_path / "arm" / "dataset.yaml").read_text()
    assert "unit: mm" in dataset
    assert not (tmp_path / "arm" / "data.csv").exists()


def test_init_reads_semicolons_decimal_commas_and_german_times(tmp_path, campaign, rows):
    lines = [["Zeit", *(f"Achse {k}" for k in range(1, 7)), "Messung X", "Messung Y", "Messung Z"]]
    for number, row in enumerate(rows):
        clock = f"03.05.2026 {8 + number // 60:02d}:{number % 60:02d}:00"
        cells = [cell.replace(".", ",") for cell in (*joints_deg(row), *millimetres(row))]
        lines.append([clock, *cells])
    write(tmp_path / "messung.txt", lines, ";")
    fit = to_first_diagnosis(tmp_path, "messung.txt", "--robot", str(campaign / "robot.yaml"))
    assert "time" in fit["data"]["columns"]


def test_suggested_command_for_a_refused_file_keeps_the_users_model(tmp_path, campaign, rows):
    lines = [[*(f"q{k}" for k in range(1, 7)), "x", "y", "z"]]
    lines += [[*joints_deg(row), *millimetres(row)] for row in rows]
    write(tmp_path / "deg.csv", lines)
    own = campaign / "model.yaml"
    arguments = ("deg.csv", "--robot", str(campaign / "robot.yaml"), "--model", str(own), "--out", "f.json")
    refused = armtrue("fit", *arguments, cwd=tmp_path)
    assert refused.returncode == 2
    assert "these look like degrees" in refused.stderr
    command = refused.stderr[refused.stderr.index("armtrue init") :]
    run = armtrue(*shlex.split(command)[1:], cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    assert (tmp_path / "deg" / "model.yaml").read_text() == own.read_text()
    assert "--model takes another" not in run.stdout
    (fit,) = [shlex.split(line) for line in run.stdout.splitlines() if line.startswith("  armtrue fit ")]
    assert fit[fit.index("--model") + 1] == "deg/model.yaml"


def test_files_that_only_lack_a_column_are_not_sent_to_init(tmp_path, campaign, rows):
    robot = str(campaign / "robot.yaml")
    for lacking, words in (("q6", "beside q1, q2, q3, q4, q5"), ("z", "beside x, y")):
        header = [name for name in (*(f"q{k}" for k in range(1, 7)), "x", "y", "z") if name != lacking]
        write(tmp_path / "lacks.csv", [header, *([row[name] for name in header] for row in rows)])
        run = armtrue("check", "lacks.csv", "--robot", robot, cwd=tmp_path)
        assert f"found no column '{lacking}' {words}, expected it" in run.stderr
        assert "armtrue init" not in run.stderr
    run = armtrue("init", "lacks.csv", "--robot", robot, "--out", "arm", cwd=tmp_path)
    assert "found only x, y of the columns of points, expected x, y and z" in run.stderr


def test_check_of_degrees_does_not_judge_them_as_radians(tmp_path, campaign, rows):
    lines = [[*(f"q{k}" for k in range(1, 7)), "x", "y", "z"]]
    lines += [[*joints_deg(row), row["x"], row["y"], row["z"]] for row in rows]
    write(tmp_path / "deg.csv", lines)
    run = armtrue("check", "deg.csv", "--robot", str(campaign / "robot.yaml"), cwd=tmp_path)
    assert "these look like degrees" in " ".join(run.stdout.split())
    assert "'armtrue init' writes one" in " ".join(run.stdout.split())
    assert not {"out_of_limits", "cannot_tell"} & set(run.stdout.split())


@pytest.mark.full
def test_init_reads_a_wide_table_with_three_reflectors(tmp_path, campaign, rows):
    robot = load_robot(campaign / "robot.yaml")
    chain = chain_from_robot(robot.spec)
    joints = np.array([[float(row[f"q{k}"]) for k in range(1, 7)] for row in rows])
    nominal = pose(robot.spec["base"]) @ chain.tool_poses(joints, pose(robot.spec["tool"]))
    error = np.array([[float(row[axis]) for axis in "xyz"] for row in rows]) - nominal[:, :3, 3]
    lines = [[*(f"J{k}" for k in range(1, 7)), *(f"SMR{n}_{axis}" for n in (1, 2, 3) for axis in "XYZ")]]
    places = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.02], [0.0, 0.12, 0.05]])
    for at, q in enumerate(joints):
        points = nominal[at, :3, :3] @ places.T + nominal[at, :3, 3:] + error[at][:, None]
        lines.append([*(f"{value:.9f}" for value in q), *(f"{value:.8f}" for value in points.T.ravel())])
    write(tmp_path / "wide.tsv", lines, "\t")
    fit = to_first_diagnosis(tmp_path, "wide.tsv", "--robot", str(campaign / "robot.yaml"))
    assert sorted(fit["flange_from_tool"]) == ["SMR1", "SMR2", "SMR3"]
    assert fit["data"]["rows"] == 3 * len(rows)


@pytest.mark.full
def test_init_joins_files_of_joints_and_points_by_pose_number(tmp_path, campaign, rows):
    order = np.random.default_rng(0).permutation(len(rows))
    log = [["Pose", *(f"actual_q_{k}" for k in range(6))]]
    log += [[str(n), *(rows[n][f"q{k}"] for k in range(1, 7))] for n in range(len(rows))]
    write(tmp_path / "controller.csv", log)
    tracker = [["# SpatialAnalyzer export"], ["Name", "X", "Y", "Z"], ["", "mm", "mm", "mm"]]
    tracker += [[str(n), *millimetres(rows[n])] for n in order[: len(rows) - 15]]
    write(tmp_path / "tracker.csv", tracker)
    fit = to_first_diagnosis(
        tmp_path, "controller.csv", "tracker.csv", "--robot", str(campaign / "robot.yaml")
    )
    assert fit["data"]["rows"] == len(rows) - 15


@pytest.mark.full
def test_init_finds_the_euler_convention_that_fits_the_arm(tmp_path, campaign, rows):
    robot = load_robot(campaign / "robot.yaml")
    chain = chain_from_robot(robot.spec)
    few = rows[:80]
    joints = np.array([[float(row[f"q{k}"]) for k in range(1, 7)] for row in few])
    turned = pose(robot.spec["base"]) @ chain.tool_poses(joints, pose(robot.spec["tool"]))
    lines = [[*(f"A{k}" for k in range(1, 7)), "X", "Y", "Z", "A", "B", "C"]]
    for row, matrix in zip(few, turned[:, :3, :3], strict=True):
        angles = np.degrees(angles_of(matrix, "zyx", True))
        lines.append([*joints_deg(row), *millimetres(row), *(f"{angle:.6f}" for angle in angles)])
    write(tmp_path / "krl.csv", lines)
    run = armtrue("init", "krl.csv", "--robot", str(campaign / "robot.yaml"), "--out", "arm", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    rotation = yaml.safe_load((tmp_path / "arm" / "dataset.yaml").read_text())["rotation"]
    assert (rotation["sequence"], rotation["axes"], rotation["unit"]) in [
        ("ZYX", "intrinsic", "deg"),
        ("XYZ", "extrinsic", "deg"),
    ]
    fit = armtrue(
        "fit",
        "arm/dataset.yaml",
        "-r",
        "arm/robot.yaml",
        "-m",
        "arm/model.yaml",
        "-o",
        "f.json",
        cwd=tmp_path,
    )
    assert fit.returncode == 0, fit.stderr
    assert armtrue("diagnose", "f.json", cwd=tmp_path).returncode == 0


@pytest.mark.full
def test_init_reads_xlsx_with_a_title_above_the_table(tmp_path, campaign, rows):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Calibration of cell 7"])
    sheet.append(
        [*(f"Joint {k} (deg)" for k in range(1, 7)), "Measured X (mm)", "Measured Y (mm)", "Measured Z (mm)"]
    )
    for row in rows:
        sheet.append([float(cell) for cell in (*joints_deg(row), *millimetres(row))])
    book.save(tmp_path / "cell 7.xlsx")
    fit = to_first_diagnosis(tmp_path, "cell 7.xlsx", "--robot", str(campaign / "robot.yaml"))
    assert fit["data"]["rows"] == len(rows)


def test_init_reports_and_labels_repeated_poses(tmp_path, campaign, rows):
    lines = [[*(f"q{k}" for k in range(1, 7)), "x1", "y1", "z1", "x2", "y2", "z2"]]
    for row in [*rows[:60], *rows[:20]]:
        lines.append(
            [
                *(row[f"q{k}"] for k in range(1, 7)),
                *(row[axis] for axis in "xyz"),
                *(row[axis] for axis in "xyz"),
            ]
        )
    write(tmp_path / "w.csv", lines)
    run = armtrue("init", "w.csv", "--robot", str(campaign / "robot.yaml"), "--out", "arm", cwd=tmp_path)
    assert re.search(r"\d+ rows repeat a pose", run.stdout), run.stdout + run.stderr
    assert "repeat" in (tmp_path / "arm" / "data.csv").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("files", "options", "words"),
    [
        ({"a.csv": "q1,q2\n1,2\n"}, [], "expected --urdf FILE, --dh TABLE"),
        ({"a.csv": ""}, ["--robot", "ROBOT"], "a.csv: found no rows"),
        ({"a.csv": "hello\nworld\n"}, ["--robot", "ROBOT"], "a.csv: found no row of numbers"),
        ({"a.csv": "x,y,z\n1,2,3\n"}, ["--robot", "ROBOT"], "a.csv: found joints in 0 of the files"),
        (
            {"a.csv": "q1,q2\n1,2\n"},
            ["--robot", "ROBOT"],
            "a.csv header: found 2 joints (q1, q2), expected 6",
        ),
        (
            {"a.csv": "q1,q2,q3,q4,q5,q6\n1,2,1,1,1,1\n"},
            ["--robot", "ROBOT"],
            "a.csv: found no columns of points",
        ),
        ({"a.xlsx": "no zip"}, ["--robot", "ROBOT"], "a.xlsx: cannot be read as an XLSX"),
        ({"a.csv": "a\0b,\0\n1,2\n"}, ["--robot", "ROBOT"], "a.csv: found bytes that are no text"),
    ],
)
def test_init_refuses_unreadable_input_and_writes_nothing(tmp_path, campaign, files, options, words):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    options = [str(campaign / "robot.yaml") if option == "ROBOT" else option for option in options]
    run = armtrue("init", *files, *options, "--out", "arm", cwd=tmp_path)
    assert run.returncode == 2, run.stdout + run.stderr
    assert words in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "arm").exists()


def test_init_does_not_overwrite_existing_files(tmp_path, campaign):
    for name in ("robot.yaml", "data.csv"):
        (tmp_path / name).write_bytes((campaign / name).read_bytes())
    (tmp_path / "dataset.yaml").write_text("kept")
    run = armtrue("init", "data.csv", "--robot", "robot.yaml", cwd=tmp_path)
    assert run.returncode == 2
    assert (tmp_path / "dataset.yaml").read_text() == "kept"


def test_init_reports_a_urdf_that_is_in_millimetres(tmp_path, campaign, rows):
    """The lengths of the URDF are wrong, not the points, which are in metres."""
    urdf = urdf_of(campaign / "robot.yaml", length=1000.0)
    (tmp_path / "mm.urdf").write_text(urdf.replace("</robot>", "<odd/></robot>"))
    lines = [[*(f"q{k}" for k in range(1, 7)), "x", "y", "z"]]
    lines += [[row[name] for name in lines[0]] for row in rows]
    write(tmp_path / "data.csv", lines)
    run = armtrue("init", "data.csv", "--urdf", "mm.urdf", "--out", "arm", cwd=tmp_path)
    words = " ".join(run.stdout.split())
    assert run.returncode == 1
    assert run.stderr == ""
    assert "the lengths in mm.urdf look like millimetres" in words
    assert "Write the lengths in mm.urdf in metres" in words
    assert "kilometres" not in words


RAIL = (
    '<robot name="arm"><link name="floor"/><joint name="rail" type="prismatic"><parent link="floor"/>'
    '<child link="base"/><origin xyz="0 0 0.2" rpy="0 0 0.3"/><axis xyz="1 0 0"/>'
    '<limit lower="0" upper="4" effort="1" velocity="1"/></joint>'
)


@pytest.mark.full
@pytest.mark.parametrize("stated", [True, False])
def test_init_reads_an_arm_on_a_rail_in_millimetres_and_degrees(tmp_path, campaign, stated):
    (tmp_path / "rail.urdf").write_text(urdf_of(campaign / "robot.yaml").replace('<robot name="arm">', RAIL))
    (tmp_path / "r.yaml").write_text("kinematics: {urdf: rail.urdf, base: floor, tip: tool0}\n")
    chain = chain_from_robot(load_robot(tmp_path / "r.yaml").spec)
    joints = np.random.default_rng(3).uniform(-1.0, 1.0, (60, 7))
    joints[:, 0] = 2.0 + joints[:, 0]
    turned = chain.tool_poses(joints, np.eye(4))
    points = turned[:, :3, :3] @ [0.05, 0.02, 0.1] + turned[:, :3, 3]
    units = ["mm", *6 * ["deg"], *3 * ["mm"]]
    names = ["E1", *(f"A{k}" for k in range(1, 7)), "X", "Y", "Z"]
    lines = [[f"{name} [{unit}]" if stated else name for name, unit in zip(names, units, strict=True)]]
    table = np.hstack([1000.0 * joints[:, :1], np.degrees(joints[:, 1:]), 1000.0 * points])
    lines += [[f"{value:.6f}" for value in row] for row in table]
    write(tmp_path / "rail.csv", lines)
    run = armtrue("init", "rail.csv", "--urdf", "rail.urdf", "--out", "arm", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    columns = yaml.safe_load((tmp_path / "arm" / "dataset.yaml").read_text())["columns"]
    assert (columns["q1"]["unit"], columns["q2"]["unit"]) == ("mm", "deg")
    check = armtrue("check", "arm/dataset.yaml", "--robot", "arm/robot.yaml", cwd=tmp_path)
    assert check.returncode == 0, check.stdout


def test_init_names_the_column_of_a_joint_with_a_wrong_unit(tmp_path, campaign, rows):
    lines = [["A1 [mm]", *(f"A{k} [deg]" for k in range(2, 7)), "X", "Y", "Z"]]
    lines += [[*joints_deg(row), *millimetres(row)] for row in rows]
    write(tmp_path / "data.csv", lines)
    run = armtrue("init", "data.csv", "--robot", str(campaign / "robot.yaml"), "--out", "arm", cwd=tmp_path)
    assert run.returncode == 2
    assert "data.csv header: found column 'A1 [mm]' in mm, expected a unit of angle" in run.stderr
