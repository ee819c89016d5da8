"""`armtrue init` takes every column that it can, and names each that it does not take, with the reason."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import armtrue_sim
import numpy as np
import pytest
import yaml
from armtrue.cli.conftest import armtrue
from armtrue.io import load_data, load_robot
from armtrue.tables.chain import chain_from_robot, pose

JOINTS = [f"q{k}" for k in range(1, 7)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("campaign")
    armtrue_sim.simulate({"arm": "kr30", "seed": 4, "poses": 60, "hidden": []}).write(made)
    return made


@pytest.fixture(scope="module")
def rows(folder: Path) -> list[dict[str, str]]:
    names, *lines = [line.split(",") for line in (folder / "data.csv").read_text().splitlines()]
    return [dict(zip(names, line, strict=True)) for line in lines][:60]


def table(rows: list[dict[str, str]], **more: Any) -> list[list[str]]:
    """Joints, points and `more`: a list of cells by header."""
    names = [*JOINTS, "x", "y", "z"]
    cells = [
        [*(row[name] for name in names), *(str(values[at]) for values in more.values())]
        for at, row in enumerate(rows)
    ]
    return [[*names, *more], *cells]


def init(folder: Path, where: Path, lines: list[list[str]], *options: str) -> tuple[str, dict[str, Any]]:
    """Run init on `lines`; return its output in one line, and its dataset.yaml."""
    (where / "data.csv").write_text("\n".join(",".join(line) for line in lines) + "\n")
    robot = str(folder / "robot.yaml")
    run = armtrue("init", "data.csv", "--robot", robot, "--out", "arm", *options, cwd=where)
    assert run.returncode == 0, run.stdout + run.stderr
    return " ".join(run.stdout.split()), yaml.safe_load((where / "arm" / "dataset.yaml").read_text())


def test_unknown_columns_are_variables_or_named_with_the_reason(folder, tmp_path, rows):
    count = range(len(rows))
    lines = table(
        rows,
        mass_kg=[at % 2 for at in count],
        speed_pct=[10 + at % 3 for at in count],
        override=[100 for _ in count],
        remark=["fine" for _ in count[:-1]] + ["bumped"],
        sigma_x=[0.1 + at for at in count],
        tau2=list(count),
        sin=list(count),
    )
    words, dataset = init(folder, tmp_path, lines)
    assert dataset["columns"]["payload"] == {"column": "mass_kg", "unit": "kg"}
    assert "mass_kg: payload in kg, by its header" in words
    assert dataset["columns"]["tau2"] == "tau2"
    assert dataset["variables"] == {"speed_pct": "speed_pct", "own_sin": "sin"}
    assert "speed_pct: variable speed_pct" in words
    assert "override: not taken, as it is the same in all rows" in words
    assert "remark: not taken, as it holds more than numbers" in words
    assert "sigma_x: not taken, as it looks like the spread of readings" in words
    robot = load_robot(tmp_path / "arm" / "robot.yaml")
    data = load_data(tmp_path / "arm" / "dataset.yaml", robot)
    np.testing.assert_array_equal(data.columns["speed_pct"][:4], [10, 11, 12, 10])


def test_named_stations_are_numbered(folder, tmp_path, rows):
    words, _ = init(folder, tmp_path, table(rows, Station=["BA"[at // 30] for at in range(len(rows))]))
    assert "Station: B is station 1, A is station 2" in words
    data = load_data(tmp_path / "arm" / "dataset.yaml", load_robot(tmp_path / "arm" / "robot.yaml"))
    np.testing.assert_array_equal(data.columns["station"], np.repeat([1.0, 2.0], 30))


@pytest.mark.parametrize("transposed", [False, True])
def test_rotation_matrix_columns_are_read(folder, tmp_path, rows, transposed):
    robot = load_robot(folder / "robot.yaml")
    chain = chain_from_robot(robot.spec)
    joints = np.array([[float(row[name]) for name in JOINTS] for row in rows])
    turned = pose(robot.spec["base"]) @ chain.tool_poses(joints, pose(robot.spec["tool"]))
    matrices = turned[:, :3, :3].swapaxes(1, 2) if transposed else turned[:, :3, :3]
    cells = {
        f"R{i + 1}{k + 1}": [f"{value:.9f}" for value in matrices[:, i, k]]
        for i in range(3)
        for k in range(3)
    }
    words, dataset = init(folder, tmp_path, table(rows, **cells))
    assert dataset["rotation"]["form"] == "matrix"
    assert dataset["rotation"]["columns"][1] == ("R21" if transposed else "R12")
    assert "matrix, as they then follow the arm within" in words
    assert "R11: not taken" not in words


def test_row_with_an_empty_cell_is_left_out_with_skip_bad(folder, tmp_path, rows):
    cells = [f"{20 + 0.1 * at:.1f}" for at in range(len(rows))]
    cells[4] = ""
    lines = table(rows, temp_arm=cells)
    (tmp_path / "data.csv").write_text("\n".join(",".join(line) for line in lines) + "\n")
    refused = armtrue("init", "data.csv", "-r", str(folder / "robot.yaml"), "-o", "arm", cwd=tmp_path)
    assert refused.returncode == 2
    expected = (
        "data.csv row 6 column temp_arm: found nothing, expected a number; --skip-bad reads the other rows"
    )
    assert expected in refused.stderr
    assert not (tmp_path / "arm").exists()
    words, dataset = init(folder, tmp_path, lines, "--skip-bad")
    assert dataset["rows"] == {"skip": [6]}
    assert "left out: row 6 column temp_arm: found nothing, expected a number" in words
    check = armtrue("check", "arm/dataset.yaml", "-r", "arm/robot.yaml", cwd=tmp_path)
    assert check.returncode == 0, check.stdout + check.stderr


def test_thousands_separators_are_removed(folder, tmp_path, rows):
    lines = [[*JOINTS, *(f"{axis} [mm]" for axis in "xyz")]]
    for row in rows:
        points = [f'"{1000 * float(row[axis]) + 5000:,.4f}"' for axis in "xyz"]
        lines.append([*(row[name] for name in JOINTS), *points])
    assert '"' in lines[1][-1]
    words, _ = init(folder, tmp_path, lines)
    assert "thousands separators are removed" in words
    data = load_data(tmp_path / "arm" / "dataset.yaml", load_robot(tmp_path / "arm" / "robot.yaml"))
    np.testing.assert_allclose(data.columns["x"], [float(row["x"]) + 5.0 for row in rows], atol=1e-6)


@pytest.mark.quick("Wann")
@pytest.mark.parametrize("header", ["Zeitstempel", "Wann", "Temperaturzeit", "Datum"])
def test_clock_times_are_recognised_under_any_header(folder, tmp_path, rows, header):
    clock = [f"29.03.2025 {22 + at // 60}:{at % 60:02d}:00" for at in range(len(rows))]
    _, dataset = init(folder, tmp_path, table(rows, **{header: clock}))
    assert dataset["time"] == {"column": header, "format": "%d.%m.%Y %H:%M:%S"}


def test_mostly_non_numeric_column_is_refused_with_skip_bad(folder, tmp_path, rows):
    lines = table(rows, temp_arm=["n/a"] * len(rows))
    (tmp_path / "data.csv").write_text("\n".join(",".join(line) for line in lines) + "\n")
    robot = str(folder / "robot.yaml")
    refused = armtrue("init", "data.csv", "-r", robot, "-o", "arm", "--skip-bad", cwd=tmp_path)
    assert "row 2 column temp_arm: found 'n/a', expected a number, as in most of the rows" in refused.stderr


def test_reflector_and_repeat_columns_survive_rewriting(folder, tmp_path, rows):
    twice = [row for row in rows for _ in range(2)]
    count = range(len(twice))
    lines = table(
        twice,
        Reflector=["AB"[at // 2 % 2] for at in count],
        rep=[f"p{at // 2}" for at in count],
    )
    words, dataset = init(folder, tmp_path, [["# exported by an instrument"], *lines])
    assert dataset["file"] == "data.csv"
    arm = load_robot(tmp_path / "arm" / "robot.yaml")
    data = load_data(tmp_path / "arm" / "dataset.yaml", arm, strict=False)
    assert data.labels["target"] == ["A", "B"]
    assert len(data.labels["repeat"]) == len(rows), words


def test_repetition_counter_is_not_taken_as_column_repeat(folder, tmp_path, rows):
    words, dataset = init(folder, tmp_path, table(rows, rep=[1 + at % 3 for at in range(len(rows))]))
    assert "rep: not taken, as rows with the same name in it have different joints" in words
    assert "repeat" not in dataset["columns"]


def test_extra_joints_are_named_and_too_few_are_refused(folder, tmp_path, rows):
    words, dataset = init(folder, tmp_path, table(rows, q7=range(len(rows)), dir8=[1] * len(rows)))
    assert "q7: not taken, as the arm has 6 joints" in words
    assert "dir8: not taken, as the arm has 6 joints" in words
    assert "q7" not in dataset["columns"]
    short = [[cell for at, cell in enumerate(line) if at != 5] for line in table(rows)]
    (tmp_path / "short.csv").write_text("\n".join(",".join(line) for line in short) + "\n")
    run = armtrue("init", "short.csv", "-r", str(folder / "robot.yaml"), "-o", "two", cwd=tmp_path)
    assert run.returncode == 2
    assert "short.csv header: found 5 joints (q1, q2, q3, q4, q5), expected 6, as the arm has" in run.stderr


def test_column_of_both_files_is_read_once(folder, tmp_path, rows):
    lines = table(rows, pose=range(len(rows)), humidity=[40 + at for at in range(len(rows))])
    joints = [[*line[:6], *line[9:]] for line in lines]
    points = [line[6:] for line in lines]
    for name, part in (("joints.csv", joints), ("points.csv", points)):
        (tmp_path / name).write_text("\n".join(",".join(line) for line in part) + "\n")
    robot = str(folder / "robot.yaml")
    run = armtrue("init", "joints.csv", "points.csv", "-r", robot, "-o", "arm", cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    data = load_data(tmp_path / "arm" / "dataset.yaml", load_robot(tmp_path / "arm" / "robot.yaml"))
    np.testing.assert_array_equal(data.columns["humidity"], 40.0 + np.arange(len(rows)))
