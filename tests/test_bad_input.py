"""Bad input to the command line: one error sentence, exit status 2, no file written.

Each case is a good set of files with one thing wrong. `names`: words that the sentence must contain: the file, the row
or key, what was found, what was expected.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from armtrue.cli.conftest import armtrue

ROBOT = """\
name: six
kinematics:
  convention: mdh
  joints:
  - {name: A1, a: 0.0, alpha: 0.0, d: 0.8, gear_ratio: 250, limits: [-2.6, 2.6]}
  - {name: A2, a: 0.35, alpha: -1.5707963267948966, d: 0.0, offset: -1.5707963267948966, limits: [-1.5, 1.0]}
  - {name: A3, a: 0.85, alpha: 0.0, d: 0.0, limits: [-1.7, 1.2]}
  - {name: A4, a: 0.145, alpha: -1.5707963267948966, d: 0.82, limits: [-3.1, 3.1]}
  - {name: A5, a: 0.0, alpha: 1.5707963267948966, d: 0.0, limits: [-2.0, 2.0]}
  - {name: A6, a: 0.0, alpha: -1.5707963267948966, d: 0.17, limits: [-3.1, 3.1]}
"""
MODEL = """\
effects: [base_frame, tool_offset, joint_offset, link_geometry]
"""
DH = [
    (0, 0, 0.8, 0),
    (0.35, -1, 0, -1),
    (0.85, 0, 0, 0),
    (0.145, -1, 0.82, 0),
    (0, 1, 0, 0),
    (0, -1, 0.17, 0),
]
HEADER = "q1,q2,q3,q4,q5,q6,x,y,z"
KEPT = "what stood here before\n"


def tool_point(q: np.ndarray) -> np.ndarray:
    """Tool point [m] by Craig's modified DH, row by row; no file states its offset from the flange."""
    pose = np.eye(4)
    for (a, quarter_alpha, d, quarter_offset), angle in zip(DH, q, strict=True):
        alpha, theta = quarter_alpha * np.pi / 2, angle + quarter_offset * np.pi / 2
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        pose = pose @ np.array(
            [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
        )
    return (pose @ [0.05, 0.03, 0.2, 1.0])[:3] + np.array([1.0, -0.5, 0.2])


def measurements(poses: int = 60) -> str:
    joints = np.random.default_rng(3).uniform(-1, 1, (poses, 6)) * [2.5, 0.9, 1.1, 3.0, 1.9, 3.0]
    lines = [HEADER]
    for q in joints:
        lines.append(",".join(f"{value:.9f}" for value in [*q, *tool_point(q)]))
    return "\n".join(lines) + "\n"


DATA = measurements()


def scaled(text: str, columns: slice, factor: float) -> str:
    head, *rows = text.splitlines()
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[columns] = [f"{float(cell) * factor:.6f}" for cell in row[columns]]
    return "\n".join([head, *(",".join(row) for row in cells)]) + "\n"


def cell(row: int, column: int, text: str) -> Callable[[str], str]:
    """Put `text` into a file's row (header = 1) and column (from 0)."""

    def change(file: str) -> str:
        lines = file.splitlines()
        cells = lines[row - 1].split(",")
        cells[column] = text
        lines[row - 1] = ",".join(cells)
        return "\n".join(lines) + "\n"

    return change


def lost(row: int) -> Callable[[str], str]:
    """Put zeros in place of the position of a file's row (header = 1)."""

    def change(file: str) -> str:
        for column in (6, 7, 8):
            file = cell(row, column, "0")(file)
        return file

    return change


def without_last_cell(row: int) -> Callable[[str], str]:
    def change(file: str) -> str:
        lines = file.splitlines()
        lines[row - 1] = lines[row - 1].rsplit(",", 1)[0]
        return "\n".join(lines) + "\n"

    return change


def replaced(found: str, put: str) -> Callable[[str], str]:
    def change(file: str) -> str:
        assert found in file
        return file.replace(found, put, 1)

    return change


@dataclass(frozen=True)
class Case:
    """Changes to the good files, and words that the sentence must name. A change that returns None deletes the file."""

    name: str
    names: list[str]
    data: Callable[[str], str | None] = field(default=lambda text: text)
    robot: Callable[[str], str | None] = field(default=lambda text: text)
    model: Callable[[str], str | None] = field(default=lambda text: text)


def gone(_: str) -> None:
    return None


def effects(entries: str) -> Callable[[str], str]:
    return lambda _: f"effects: [base_frame, tool_offset, {entries}]\n"


def custom(expression: str, coordinate: str = "motor3") -> Callable[[str], str]:
    return lambda _: (
        "effects:\n- base_frame\n- tool_offset\n"
        f"- {{effect: custom, name: mine, coordinate: {coordinate}, expression: {json.dumps(expression)}}}\n"
    )


CASES = [
    Case("data missing", ["data.csv", "no such file"], data=gone),
    Case("robot missing", ["robot.yaml", "no such file"], robot=gone),
    Case("model missing", ["model.yaml", "no such file"], model=gone),
    Case("data empty", ["data.csv", "header"], data=lambda _: ""),
    Case("no rows", ["data.csv", "no rows"], data=lambda _: HEADER + "\n"),
    Case("wrong column", ["data.csv", "no column 'q4'", "did you mean 'j4'"], data=replaced("q4", "j4")),
    Case("column twice", ["data.csv", "'q3' a second time"], data=replaced("q4", "q3")),
    Case("joint beyond the arm", ["data.csv", "'q7'", "1 to 6"], data=replaced("z\n", "q7\n")),
    Case("nan", ["data.csv row 5 column y", "'nan'", "a number"], data=cell(5, 7, "nan")),
    Case("infinity", ["data.csv row 6 column q1", "'-inf'", "a number"], data=cell(6, 0, "-inf")),
    Case("text in a number", ["data.csv row 9 column q2", "'abc'", "a number"], data=cell(9, 1, "abc")),
    Case("empty cell", ["data.csv row 4 column z", "nothing", "a number"], data=cell(4, 8, "")),
    Case(
        "lost reflector", ["data.csv row 4 columns x, y, z", "0, 0, 0", "a measured position"], data=lost(4)
    ),
    Case("ragged row", ["data.csv row 3", "8 cells", "9"], data=without_last_cell(3)),
    Case(
        "degrees for radians",
        ["data.csv row", "radians", "degrees"],
        data=lambda t: scaled(t, slice(0, 6), 57.29578),
    ),
    Case(
        "millimetres for metres",
        ["data.csv row", "metres", "millimetres"],
        data=lambda t: scaled(t, slice(6, 9), 1e3),
    ),
    Case("inches for metres", ["data.csv", "metres"], data=lambda t: scaled(t, slice(6, 9), 39.3700787)),
    Case(
        "foreign separator", ["data.csv", "comma", "dataset.yaml"], data=lambda text: text.replace(",", ";")
    ),
    Case("not text", ["data.csv", "utf-8"], data=lambda text: text + "\udcff"),
    Case(
        "singular data",
        ["data.csv", "1 different pose"],
        data=lambda text: "\n".join([HEADER, *[text.splitlines()[1]] * 40]) + "\n",
    ),
    Case("too few poses", ["data.csv", "4"], data=lambda text: "\n".join(text.splitlines()[:5]) + "\n"),
    Case(
        "unknown effect",
        ["model.yaml", "effects[3]", "'joint_ofset'", "joint_offset"],
        model=effects("joint_ofset"),
    ),
    Case(
        "effect twice",
        ["model.yaml", "joint_offset", "second time"],
        model=effects("joint_offset, joint_offset"),
    ),
    Case(
        "effect on a joint that is not there",
        ["model.yaml", "effects[3].joints", "[7]", "1 to 6"],
        model=effects("{effect: joint_offset, joints: [7]}"),
    ),
    Case(
        "effect without its column",
        ["thermal_joint_drift", "temp_"],
        model=effects("thermal_joint_drift"),
    ),
    Case(
        "unknown option",
        ["model.yaml", "order", "orders"],
        model=effects("{effect: gear_harmonics, order: [1]}"),
    ),
    Case(
        "effect on a joint that is not its own",
        ["model.yaml", "gravity_balancer", "other joints", "leave joints out"],
        model=effects("{effect: gravity_balancer, joints: [3]}"),
    ),
    Case("no effects", ["model.yaml", "effects"], model=lambda _: "effects: []\n"),
    Case("model is no YAML", ["model.yaml line 2", "expected YAML"], model=lambda _: "effects: [\n"),
    Case(
        "contradictory robot",
        ["robot.yaml", "kinematics.joints", "beside 'urdf'"],
        robot=replaced("  convention: mdh\n", "  urdf: arm.urdf\n  base: b\n  tip: t\n"),
    ),
    Case(
        "urdf missing",
        ["arm.urdf", "no such file"],
        robot=lambda _: "kinematics: {urdf: arm.urdf, base: b, tip: t}\n",
    ),
    Case(
        "urdf of nobody's home",
        ["~arm.urdf", "no such file"],
        robot=lambda _: "kinematics: {urdf: ~arm.urdf, base: b, tip: t}\n",
    ),
    Case(
        "unknown key",
        ["robot.yaml", "kinematics.joints[2].ofset", "did you mean 'offset'"],
        robot=replaced("offset", "ofset"),
    ),
    Case(
        "unknown convention",
        ["robot.yaml", "'hdm'", "mdh or dh"],
        robot=replaced("convention: mdh", "convention: hdm"),
    ),
    Case(
        "limits the wrong way round",
        ["robot.yaml", "joints[1].limits", "lo below hi"],
        robot=replaced("[-2.6, 2.6]", "[2.6, -2.6]"),
    ),
    Case(
        "text in robot",
        ["robot.yaml", "joints[1].d", "'tall'", "metres"],
        robot=replaced("d: 0.8", "d: tall"),
    ),
    Case(
        "degrees in robot",
        ["robot.yaml", "joints[2].alpha", "degrees"],
        robot=replaced("-1.5707963267948966, d", "-90, d"),
    ),
    Case(
        "links too few",
        ["robot.yaml: links", "found 1", "expected 6"],
        robot=lambda text: text + "links: [{mass: 1}]\n",
    ),
    Case(
        "negative mass",
        ["robot.yaml", "links[1].mass", "-1"],
        robot=lambda text: text + "links: [{mass: -1}" + ", {mass: 1}" * 5 + "]\n",
    ),
    Case(
        "coupling of a joint that is not there",
        ["robot.yaml", "coupling[1].joint", "9", "1 to 6"],
        robot=lambda text: text + "coupling: [{joint: 9, driving: 2, ratio: 1}]\n",
    ),
    Case(
        "expression that does not parse",
        ["model.yaml", "effects[3].expression", "sin(q1"],
        model=custom("sin(q1"),
    ),
    Case(
        "expression with an unknown name", ["model.yaml", "effects[3].expression", "q9"], model=custom("q9")
    ),
    Case(
        "expression that calls code",
        ["model.yaml", "expression"],
        model=custom("__import__('os').system('ls')"),
    ),
    Case("expression with an attribute", ["model.yaml", "expression"], model=custom("q1.real")),
    Case("expression with a comprehension", ["model.yaml", "expression"], model=custom("[q1 for q1 in q2]")),
    Case("expression too deep", ["model.yaml", "expression"], model=custom("(" * 20000 + "q1" + ")" * 20000)),
    Case(
        "unknown coordinate", ["model.yaml", "coordinate", "'motr3'", "motor3"], model=custom("q1", "motr3")
    ),
]


def write(folder: Path, case: Case) -> None:
    for name, good, change in (
        ("robot.yaml", ROBOT, case.robot),
        ("model.yaml", MODEL, case.model),
        ("data.csv", DATA, case.data),
    ):
        content = change(good)
        if content is not None:
            (folder / name).write_bytes(content.encode("utf-8", "surrogateescape"))


def assert_one_sentence(run: subprocess.CompletedProcess[str], names: list[str]) -> None:
    assert run.returncode == 2, run.stderr
    assert run.stderr.startswith("armtrue: ")
    assert run.stderr.count("\n") == 1, run.stderr
    for name in names:
        assert name in run.stderr
    assert run.stdout == ""


FIT = ("fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml", "--out", "fit.json")


def test_fit_accepts_the_unchanged_files(tmp_path: Path) -> None:
    write(tmp_path, Case("good", []))
    run = armtrue(*FIT, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert json.loads((tmp_path / "fit.json").read_text())["error"]["train"]["max_um"] < 0.1


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_fit_refuses_bad_files(tmp_path: Path, case: Case) -> None:
    write(tmp_path, case)
    (tmp_path / "fit.json").write_text(KEPT)
    before = sorted(path.name for path in tmp_path.iterdir())
    assert_one_sentence(armtrue(*FIT, cwd=tmp_path), case.names)
    assert (tmp_path / "fit.json").read_text() == KEPT
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fitted")
    write(folder, Case("good", []))
    assert armtrue(*FIT, cwd=folder).returncode == 0
    document = json.loads((folder / "fit.json").read_text())
    for name, change in (("newer", {"version": 99}), ("other", {"format": "else"})):
        (folder / f"{name}.json").write_text(json.dumps({**document, **change}))
    moved = {
        **document,
        "data": {**document["data"], "path": "/nowhere/data.csv", "relative": "gone/data.csv"},
    }
    (folder / "moved").mkdir()
    (folder / "moved" / "fit.json").write_text(json.dumps(moved))
    del document["error"]["train"]["max_um"]
    (folder / "figure.json").write_text(json.dumps(document))
    del document["error"]["train"]
    (folder / "figures.json").write_text(json.dumps(document))
    (folder / "text.json").write_text("no JSON")
    (folder / "cut.json").write_text((folder / "fit.json").read_text()[:1000])
    (folder / "degrees.csv").write_text("q1,q2,q3,q4,q5,q6\n0,-70,90,0,45,0\n")
    (folder / "few.csv").write_text("q1,q2,q3,q4,q5\n0,0,0,0,0\n")
    (folder / "kept").write_text(KEPT)
    return folder


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        ("predict none.json data.csv --out kept", ["none.json", "no such file"]),
        ("predict text.json data.csv --out kept", ["text.json", "not JSON"]),
        ("predict cut.json data.csv --out kept", ["cut.json", "not JSON"]),
        ("predict newer.json data.csv --out kept", ["newer.json", "version 99", "1"]),
        ("predict other.json data.csv --out kept", ["other.json", "armtrue-fit"]),
        ("predict fit.json few.csv --out kept", ["few.csv", "'q6'"]),
        ("predict fit.json degrees.csv --out kept", ["degrees.csv row 2", "degrees"]),
        ("predict fit.json data.csv --out nowhere/p.csv", ["nowhere/p.csv", "no folder"]),
        ("predict fit.json data.csv --out moved", ["moved", "found a folder"]),
        ("check data.csv --robot robot.yaml --json nowhere/c.json", ["nowhere/c.json", "no folder"]),
        ("check robot.yaml --robot robot.yaml", ["robot.yaml", "file"]),
        ("add fit.json joint_offset --out kept", ["joint_offset", "already"]),
        ("add fit.json joint_ofset --out kept", ["joint_ofset", "joint_offset"]),
        ("add fit.json backlash --joints 9 --out kept", ["joints", "9", "1 to 6"]),
        ("add fit.json backlash --joints two --out kept", ["--joints", "'two'"]),
        ("add fit.json thermal_joint_drift --out kept", ["thermal_joint_drift", "temp_"]),
        ("add fit.json gear_harmonics --option orders --out kept", ["--option", "'orders'"]),
        ("add fit.json gear_mesh --option orders=1,2 --out kept", ["orders", "'1,2'", "such as [1,2]"]),
        ("add moved/fit.json backlash --out kept", ["measurements", "/nowhere/data.csv", "moved/data.csv"]),
        ("diagnose text.json", ["text.json", "not JSON"]),
        ("diagnose moved/fit.json", ["/nowhere/data.csv"]),
        ("refine none.json --out kept", ["none.json", "no such file"]),
        ("report moved/fit.json --out kept", ["/nowhere/data.csv"]),
        ("report figure.json --out kept", ["figure.json", "error.train.max_um", "micrometres"]),
        ("compare figures.json data.csv", ["figures.json", "error.train"]),
    ],
)
def test_other_commands_refuse_bad_input(fitted: Path, arguments: str, names: list[str]) -> None:
    before = sorted(path.name for path in fitted.iterdir())
    assert_one_sentence(armtrue(*arguments.split(), cwd=fitted), names)
    assert (fitted / "kept").read_text() == KEPT
    assert sorted(path.name for path in fitted.iterdir()) == before


def test_unknown_option_ends_with_status_2(tmp_path: Path) -> None:
    run = armtrue("fit", "--no-such-option", cwd=tmp_path)
    assert run.returncode == 2
    assert "--no-such-option" in run.stderr
