"""Files as instruments and controllers write them, from the file to a first diagnosis without an editor.

Each is built from a simulated campaign: the fit of the file must be as good as that of the campaign.
"""

from __future__ import annotations

import csv
import datetime
import json
import math
import shlex
from pathlib import Path
from typing import Any

import armtrue_sim
import numpy as np
import openpyxl
import pytest
from armtrue.cli.conftest import run_forked

pytestmark = pytest.mark.full

HIDDEN = [{"effect": "gear_harmonics", "joints": [3], "scale": 2.5}]
PLAIN = {"arm": "kr30", "seed": 21, "poses": 240, "hidden": HIDDEN}
REFLECTORS = {**PLAIN, "poses": 120, "targets": {"names": ["SMR 1.5 A", "SMR 1.5 B", "SMR 1.5 C"]}}
ORIENTED = {
    **PLAIN,
    "instrument": {"sigma": 9e-6, "orientation": 2e-5},
    "columns": {"add": ["orientation"]},
}
PATIENCE_S = 240.0


def simulated(where: Path, scenario: dict[str, Any]) -> list[dict[str, str]]:
    """Rows of a campaign; its robot.yaml lies in `where`."""
    armtrue_sim.simulate(scenario).write(where / "simulated")
    (where / "robot.yaml").write_bytes((where / "simulated" / "robot.yaml").read_bytes())
    with (where / "simulated" / "data.csv").open() as stream:
        return list(csv.DictReader(stream))


def degrees(row: dict[str, str], digits: int = 5) -> list[str]:
    return [f"{math.degrees(float(row[f'q{k}'])):.{digits}f}" for k in range(1, 7)]


def millimetres(row: dict[str, str]) -> list[str]:
    return [f"{1000.0 * float(row[axis]):.4f}" for axis in "xyz"]


def run(where: Path, *words: str) -> str:
    """Run a command, which must end with status 0; returns its output."""
    ran = run_forked(*words, cwd=where, timeout=PATIENCE_S)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


def first_diagnosis(where: Path, *files: str) -> dict[str, Any]:
    """Run init, the next commands that it prints, and diagnose; return the fit's document with the diagnosis."""
    said = run(where, "init", *files, "--robot", "robot.yaml", "--out", "arm")
    commands = [shlex.split(line)[1:] for line in said.splitlines() if line.startswith("  armtrue ")]
    assert [command[0] for command in commands] == ["check", "fit"]
    for command in commands:
        run(where, *command)
    document = json.loads((where / "arm" / "fit.json").read_text())
    diagnosis = json.loads(run(where, "diagnose", "arm/fit.json", "--json", "-"))
    assert diagnosis["verdict"] == "missing_effect"
    found = {(entry["effect"], tuple(entry["joints"])) for entry in diagnosis["candidates"]}
    assert ("gear_harmonics", (3,)) in found
    return {**document, "said": said, "diagnosis": diagnosis}


def as_well_as_the_campaign(where: Path, document: dict[str, Any]) -> None:
    """The same model fitted to the campaign's own data.csv gives the same error, except for rounding."""
    run(where, "fit", "simulated/data.csv", "-r", "robot.yaml", "-m", "arm/model.yaml", "-o", "own.json")
    own = json.loads((where / "own.json").read_text())
    assert document["data"]["rows"] == own["data"]["rows"]
    mean, expected = (each["error"]["train"]["mean_um"] for each in (document, own))
    assert mean == pytest.approx(expected, rel=0.02)


def test_wide_table_of_three_named_reflectors_is_diagnosed(tmp_path):
    rows = simulated(tmp_path, REFLECTORS)
    names = REFLECTORS["targets"]["names"]
    lines = [
        ["Laser tracker export", "", "3 reflectors"],
        [""],
        ["", *[""] * 6, *(cell for name in names for cell in (name, "", ""))],
        ["Point", *(f"J{k}" for k in range(1, 7)), *(axis for _ in names for axis in ("X", "Y", "Z"))],
        ["", *["deg"] * 6, *["mm"] * 9],
    ]
    for at in range(0, len(rows), 3):
        shots = sorted(rows[at : at + 3], key=lambda row: names.index(row["target"]))
        assert len({row["q1"] for row in shots}) == 1
        lines.append(
            [f"P{at // 3 + 1}", *degrees(shots[0]), *(cell for row in shots for cell in millimetres(row))]
        )
    (tmp_path / "tracker.csv").write_text("\r\n".join(",".join(line) for line in lines) + "\r\n")
    document = first_diagnosis(tmp_path, "tracker.csv")
    assert sorted(document["flange_from_tool"]) == names
    as_well_as_the_campaign(tmp_path, document)


def test_joint_log_and_reordered_tracker_points_are_diagnosed(tmp_path):
    rows = simulated(tmp_path, PLAIN)
    log = ["timestamp actual_q_0 actual_q_1 actual_q_2 actual_q_3 actual_q_4 actual_q_5 point"]
    log += [
        " ".join([f"{float(row['time']):.3f}", *(row[f"q{k}"] for k in range(1, 7)), f"{number}"])
        for number, row in enumerate(rows, start=1)
    ]
    (tmp_path / "ur_log.txt").write_text("\n".join(log) + "\n")
    points = ["// SpatialAnalyzer: Exact", "// Units: mm, Frame: World", "Point\tX\tY\tZ\tRMS"]
    order = np.random.default_rng(3).permutation(len(rows))
    points += ["\t".join([str(at + 1), *millimetres(rows[at]), "0.006"]) for at in order]
    (tmp_path / "points.txt").write_text("\n".join(points) + "\n")
    document = first_diagnosis(tmp_path, "ur_log.txt", "points.txt")
    as_well_as_the_campaign(tmp_path, document)


def test_clock_of_the_points_is_used_if_the_joints_have_none(tmp_path):
    rows = simulated(tmp_path, PLAIN)
    joints = [",".join(["point", *(f"q{k}" for k in range(1, 7))])]
    joints += [",".join([str(at), *(row[f"q{k}"] for k in range(1, 7))]) for at, row in enumerate(rows)]
    (tmp_path / "joints.csv").write_text("\n".join(joints) + "\n")
    begun = datetime.datetime(2026, 5, 3, 8, 0, 0)
    points = ["point,x,y,z,Timestamp"]
    for at, row in reversed(list(enumerate(rows))):
        clock = begun + datetime.timedelta(seconds=round(float(row["time"])))
        points.append(",".join([str(at), row["x"], row["y"], row["z"], f"{clock:%Y-%m-%d %H:%M:%S}"]))
    (tmp_path / "points.csv").write_text("\n".join(points) + "\n")
    document = first_diagnosis(tmp_path, "joints.csv", "points.csv")
    assert "time" in document["data"]["columns"]
    as_well_as_the_campaign(tmp_path, document)


def test_windows_file_with_units_in_its_header_is_diagnosed(tmp_path):
    rows = simulated(tmp_path, PLAIN)
    header = [
        *(f"A{k} [°]" for k in range(1, 7)),
        "X [mm]",
        "Y [mm]",
        "Z [mm]",
        "Temperatur Arm [°C]",
        "Last [kg]",
    ]
    lines = ["\t".join(header)]
    lines += ["\t".join([*degrees(row), *millimetres(row), row["temp_arm"], row["payload"]]) for row in rows]
    (tmp_path / "messwerte.txt").write_bytes(("\r\n".join(lines) + "\r\n\r\n").encode("cp1252"))
    document = first_diagnosis(tmp_path, "messwerte.txt")
    assert {"temp_arm", "payload"} <= set(document["data"]["columns"])
    as_well_as_the_campaign(tmp_path, document)


def test_german_csv_with_trailing_separators_is_diagnosed(tmp_path):
    rows = simulated(tmp_path, PLAIN)
    begun = datetime.datetime(2026, 5, 3, 8, 0, 0)
    lines = ["Messprotokoll;Zelle 7", "Datum/Uhrzeit;Achse 1;Achse 2;Achse 3;Achse 4;Achse 5;Achse 6;X;Y;Z;"]
    for row in rows:
        clock = begun + datetime.timedelta(seconds=float(row["time"]))
        cells = [cell.replace(".", ",") for cell in (*degrees(row), *millimetres(row))]
        lines.append(";".join([clock.strftime("%d.%m.%Y %H:%M:%S"), *cells]) + ";")
    (tmp_path / "protokoll.csv").write_bytes(("\r\n".join(lines) + "\r\n").encode("utf-8-sig"))
    document = first_diagnosis(tmp_path, "protokoll.csv")
    assert "time" in document["data"]["columns"]
    as_well_as_the_campaign(tmp_path, document)


@pytest.mark.parametrize(
    ("names", "sequence"), [(("A", "B", "C"), "zyx"), (("W", "P", "R"), "xyz")], ids=["KUKA", "FANUC"]
)
def test_euler_angles_are_read_in_the_controllers_convention(tmp_path, names, sequence):
    rows = simulated(tmp_path, ORIENTED)
    lines = [",".join([*(f"J{k}" for k in range(1, 7)), "X", "Y", "Z", *names])]
    for row in rows:
        turned = rotation(row)
        if sequence == "zyx":
            b = math.asin(-turned[2, 0])
            angles = [math.atan2(turned[1, 0], turned[0, 0]), b, math.atan2(turned[2, 1], turned[2, 2])]
        else:  # about fixed axes x, y, z
            b = math.asin(-turned[2, 0])
            angles = [math.atan2(turned[2, 1], turned[2, 2]), b, math.atan2(turned[1, 0], turned[0, 0])]
        lines.append(
            ",".join([*degrees(row), *millimetres(row), *(f"{math.degrees(a):.6f}" for a in angles)])
        )
    (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n")
    document = first_diagnosis(tmp_path, "poses.csv")
    assert document["noise"]["sigma_rotation_rad"] is not None
    as_well_as_the_campaign(tmp_path, document)


def rotation(row: dict[str, str]) -> np.ndarray:
    """The matrix of a row's quaternion."""
    w, x, y, z = (float(row[name]) for name in ("qw", "qx", "qy", "qz"))
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def test_workbook_with_cover_sheet_and_unit_row_is_diagnosed(tmp_path):
    rows = simulated(tmp_path, PLAIN)
    book = openpyxl.Workbook()
    book.active.title = "Cover"
    book.active.append(["Calibration of cell 7", None, "Operator: N. N."])
    sheet = book.create_sheet("Measurements")
    sheet.append(["Calibration of cell 7"])
    sheet.append([])
    sheet.append(
        ["No.", "Date", *(f"Joint {k}" for k in range(1, 7)), "Measured X", "Measured Y", "Measured Z"]
    )
    sheet.append([None, None, *["deg"] * 6, *["mm"] * 3])
    begun = datetime.datetime(2026, 5, 3, 8, 0, 0)
    for number, row in enumerate(rows, start=1):
        clock = begun + datetime.timedelta(seconds=round(float(row["time"])))
        sheet.append([number, clock, *map(float, (*degrees(row), *millimetres(row)))])
    book.save(tmp_path / "cell 7.xlsx")
    document = first_diagnosis(tmp_path, "cell 7.xlsx")
    assert "time" in document["data"]["columns"]
    as_well_as_the_campaign(tmp_path, document)
