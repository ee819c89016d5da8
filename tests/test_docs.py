"""The examples of the documentation work: every YAML and Python block of docs/files.md, and docs/examples."""

from __future__ import annotations

import ast
import contextlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
import typer
from armtrue import load_data, load_model, load_robot
from armtrue.cli.app import app
from armtrue.io import Robot

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
FILES = (DOCS / "files.md").read_text()
URDF = """<robot name="three"><link name="base_link"/><link name="a"/><link name="b"/><link name="flange"/>
<joint name="j1" type="continuous"><parent link="base_link"/><child link="a"/><axis xyz="0 0 1"/></joint>
<joint name="j2" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
<joint name="j3" type="continuous"><parent link="b"/><child link="flange"/><axis xyz="0 1 0"/></joint></robot>"""


def blocks(language: str, start: str) -> list[str]:
    found = re.findall(rf"```{language}\n(.*?)```", FILES, flags=re.DOTALL)
    return [block for block in found if block.startswith(start)]


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    (block,) = blocks("yaml", "name: kr30")
    (tmp_path / "robot.yaml").write_text(block)
    return load_robot(tmp_path / "robot.yaml")


def test_robot_yaml_of_files_md_loads(robot: Robot) -> None:
    assert robot.joint_count == 3
    assert robot.spec["serial"] == "12345"
    assert robot.spec["linkage"]["angle"] == 1.67


def test_urdf_robot_of_files_md_loads(tmp_path: Path) -> None:
    (block,) = blocks("yaml", "kinematics: {urdf")
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(block)
    assert [joint["gear_ratio"] for joint in load_robot(tmp_path / "robot.yaml").joints] == [101, 101, 121]


def test_model_yaml_of_files_md_loads(tmp_path: Path, robot: Robot) -> None:
    (effects,) = blocks("yaml", "effects:")
    (parameters,) = blocks("yaml", "parameters:")
    (instrument,) = blocks("yaml", "instrument:")
    path = tmp_path / "model.yaml"
    path.write_text(effects + parameters + instrument)
    model = load_model(path, robot)
    assert [effect["effect"] for effect in model.effects][-1] == "custom"
    assert model.parameters["joint_compliance[2]"] == {"prior": 1.5e-6, "sigma": 0.5e-6}
    assert model.instrument == {
        "position": [0.0, 0.0, 0.0],
        "radial": {"a": 5e-6, "b": 5e-7},
        "angular": {"a": 7.5e-6, "b": 3e-6},
    }


def test_dataset_yaml_of_files_md_reads_a_file_of_its_format(tmp_path: Path, robot: Robot) -> None:
    (block,) = blocks("yaml", "file:")
    mapped = block.replace("  x: {", "  q3: J3\n  y: PY\n  z: PZ\n  x: {")
    (tmp_path / "dataset.yaml").write_text(mapped)
    (tmp_path / "series_a_grid.csv").write_text(
        "shoulder_pan_joint;J2;J3;PX;PY;PZ;RX;RY;RZ;Stamp;Status;Override\n"
        "0,1;90;0,2;1000;1,5;1;10;20;30;20200714160005;ok;80\n"
        "0,2;80;0,1;1100;1,5;1;10;20;30;20200714160000;ok;100\n"
        "0,2;80;0,1;1100;1,5;1;10;20;30;20200714160000;bad;100\n"
    )
    data = load_data(tmp_path / "dataset.yaml", robot)
    np.testing.assert_array_equal(data.rows, [3, 2])
    np.testing.assert_allclose(data.columns["q2"], np.radians([-80, -90]) + 0.5)
    np.testing.assert_array_equal(data.columns["payload"], [2.5, 2.5])
    np.testing.assert_array_equal(data.columns["speed"], [100, 80])


@pytest.fixture(scope="module")
def notebook(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """All names after running the Python blocks of docs/files.md in order, in a temporary folder."""
    import armtrue_sim

    folder = tmp_path_factory.mktemp("notebook")
    armtrue_sim.cli_simulate(DOCS.parent / "sim" / "scenarios" / "cobot-two-effects.yaml", folder)
    shutil.copy(folder / "test.csv", folder / "poses.csv")
    names: dict[str, Any] = {"folder": folder}
    with contextlib.chdir(folder):
        for block in blocks("python", ""):
            exec(compile(block, "files.md", "exec"), names)
    return names


@pytest.mark.full  # the example notebook runs the same functions
def test_python_blocks_of_files_md_run(notebook: dict[str, Any]) -> None:
    assert (notebook["folder"] / "fit.json").exists()
    assert (notebook["folder"] / "report.html").exists()
    assert notebook["found"].recommended["effect"] == "backlash"
    assert notebook["first"].count == 50
    assert notebook["report"].last.title == "best"


@pytest.mark.full
def test_files_md_lists_every_key_of_a_diagnosis(notebook: dict[str, Any]) -> None:
    table = FILES[FILES.index("Keys of a diagnosis:") : FILES.index("The steps of a `Refinement`")]
    named = set(re.findall(r"`(\w+)`", table))
    found = notebook["found"]
    parts = [found, found["error"], found["error"]["train"], found["error"]["cross_validation"]]
    parts += [found["candidates"][0], found["candidates"][0]["parameters"][0], found["untestable"][0]]
    parts += [found["spectra"][0]]
    assert {key for part in parts for key in part} <= named


@pytest.mark.parametrize("series", ["a", "c"])
def test_ur10_dataset_yaml_reads_a_file_of_its_format(tmp_path: Path, series: str) -> None:
    """Two rows with the header and number format of the published measurements, which are not in this repository."""
    robot = load_robot(DOCS / "examples" / "ur10-leica" / "robot.yaml")
    text = (DOCS / "examples" / "ur10-leica" / f"series_{series}.yaml").read_text()
    (tmp_path / "dataset.yaml").write_text(re.sub(r"^file: .*$", "file: rows.csv", text, flags=re.MULTILINE))
    joints = "shoulder_pan_joint;shoulder_lift_joint;elbow_joint;wrist_1_joint;wrist_2_joint;wrist_3_joint"
    measured = "measurement_temperature;measurement_x;measurement_y;measurement_z"
    angles = "measurement_rx;measurement_ry;measurement_rz"
    (tmp_path / "rows.csv").write_text(
        f"Timestamp;{joints};{measured};{angles}\n"
        "20200714163924;-2,1;-2,1;-0,8;-0,2;0,4;0,0;23,68;1685,3;-1665,3;-415,8;-90,3;-49,7;-90,9\n"
        "20200714163904;-1,6;-1,6;0,0;-1,6;0,0;0,0;23,68;2362,0;-1368,5;119,4;-90,4;-59,9;-90,9\n"
    )
    data = load_data(tmp_path / "dataset.yaml", robot)
    assert data.rows.tolist() == ([3, 2] if series == "a" else [2, 3])
    assert data.columns["time"].tolist() == ([0.0, 20.0] if series == "a" else [0.0, 10.0])
    assert np.ptp(data.columns["x"]) == pytest.approx(0.6767)
    assert "dir6" in data.columns


def test_commands_of_the_installation_page_exist() -> None:
    page = (DOCS / "installation.md").read_text()
    checklist = page[page.index("## Start-up checklist") :]
    commands = re.findall(r"`armtrue ([^`]+)`", checklist)
    assert len(commands) > 10
    root = typer.main.get_command(app).whole()
    for words in map(str.split, commands):
        command: click.Command = root
        while words and isinstance(command, click.Group):
            assert words[0] in command.commands, words
            command = command.commands[words.pop(0)]
        known = {
            option for parameter in command.params for option in parameter.opts + parameter.secondary_opts
        }
        assert {word for word in words if word.startswith("--")} <= known, words


# (CHANGELOG.md may name removed files.)
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for folder in ("docs", "firmware", "sim") for page in sorted((ROOT / folder).rglob("*.md"))),
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_named_by_a_page_exist(page: Path) -> None:
    text = page.read_text()
    named = re.findall(r"`((?:docs|fitter|firmware|host_tools|sim|tests|tools)/[\w./-]+)`", text)
    # The reader of docs/adding-an-effect.md writes belt_stretch.cc.
    missing = [name for name in named if not (ROOT / name).exists() and "belt_stretch" not in name]
    links = [link for link in re.findall(r"\]\((?!https?:|#|mailto:)([^)#]+)", text) if " " not in link]
    assert missing + [link for link in links if not (page.parent / link).exists()] == []


def test_examples_page_commands_find_the_hidden_effect(tmp_path: Path) -> None:
    """Runs every command of the page in the example's folder."""
    page = (DOCS / "examples" / "README.md").read_text()
    shutil.copytree(DOCS / "examples" / "kr30-eccentric-gear", tmp_path / "example")
    commands = [line.split() for line in page.splitlines() if line.startswith("    armtrue ")]
    commands += [found.split() for found in re.findall(r"`(armtrue (?!simulate)[^`]+)`", page)]
    assert len(commands) == 4
    said = ""
    for words in commands:
        done = subprocess.run(
            [sys.executable, "-m", *words],
            cwd=tmp_path / "example",
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in (0, 1), done.stderr
        said += done.stdout
    assert "Recommended: gear_harmonics 3" in said


def test_example_notebook_runs_and_its_results_render_as_html(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(DOCS / "examples/kr30-eccentric-gear", tmp_path / "tour")
    monkeypatch.chdir(tmp_path / "tour")
    cells = json.loads(Path("tour.ipynb").read_text())["cells"]
    names: dict[str, Any] = {}
    shown = []
    for cell in cells:
        if cell["cell_type"] != "code":
            continue
        *body, last = ast.parse("".join(cell["source"])).body
        exec(compile(ast.Module(body, []), "tour.ipynb", "exec"), names)
        assert isinstance(last, ast.Expr)
        shown.append(eval(compile(ast.Expression(last.value), "tour.ipynb", "eval"), names))
    check, first, diagnosis, steps, error_um, picture = shown
    for result in (check, first, diagnosis, steps):
        assert result._repr_html_().count("<tr>") >= 2
    assert "gear_harmonics" in diagnosis._repr_html_()
    assert "held-out poses" in repr(first)
    assert "µm" in repr(first)
    assert error_um < 0.5 * first.document["error"]["held_out"]["mean_um"]
    assert "How the error fell" in picture._repr_html_()
