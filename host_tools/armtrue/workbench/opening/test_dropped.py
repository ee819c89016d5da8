"""Foreign files dropped with a description of the arm: which are interpreted, and what is kept of the others."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import armtrue_sim
import pytest
import yaml

from armtrue.errors import InputError
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.opening.guesses import first_rows
from armtrue.workbench.opening.opened import open_files

MODEL = "effects: [base_frame, tool_offset, joint_offset, {effect: joint_compliance, joints: [2]}]\n"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("campaign")
    armtrue_sim.simulate({"arm": "kr30", "seed": 5, "poses": 60}).write(made)
    return made


@pytest.fixture
def foreign(campaign, tmp_path) -> Path:
    """The campaign in degrees and millimetres, with a controller's column names."""
    with (campaign / "data.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    lines = ["A1;A2;A3;A4;A5;A6;X;Y;Z"]
    for row in rows:
        angles = [math.degrees(float(row[f"q{k}"])) for k in range(1, 7)]
        lines.append(
            ";".join(f"{value:.6f}" for value in (*angles, *(1000.0 * float(row[a]) for a in "xyz")))
        )
    path = tmp_path / "tracker.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def dropped(folder: Path, *files: Path) -> Drop:
    drop = Drop(folder)
    for file in files:
        drop.take(file.name, file.read_bytes())
    return drop


def opened(drop: Drop):
    assert drop.open({}) is None
    assert drop.guess is not None
    return drop.open({"text": drop.guess.text})


def dh_table(campaign: Path, path: Path) -> Path:
    """The arm's nominal kinematics as a table."""
    kinematics = yaml.safe_load((campaign / "robot.yaml").read_text())["kinematics"]
    lines = ["a [mm],alpha [deg],d [mm],theta [deg]"]
    for row in kinematics["joints"]:
        figures = (
            1000 * row["a"],
            math.degrees(row["alpha"]),
            1000 * row["d"],
            math.degrees(row.get("offset", 0)),
        )
        lines.append(",".join(f"{value:.6f}" for value in figures))
    path.write_text("\n".join(lines) + "\n")
    return path


URDF = """<robot name="two"><link name="base"/><link name="one"/><link name="flange"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="one"/><child link="flange"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>
"""


def test_model_dropped_with_foreign_measurements_is_the_first_model(campaign, foreign, tmp_path):
    model = tmp_path / "believed.yaml"
    model.write_text(MODEL)
    first = opened(dropped(tmp_path / "drop", foreign, campaign / "robot.yaml", model)).model
    assert [entry["effect"] for entry in first.effects][-1] == "joint_compliance"


def test_dropped_dh_table_is_read_as_the_arm(campaign, foreign, tmp_path):
    found = opened(dropped(tmp_path / "drop", foreign, dh_table(campaign, tmp_path / "kr30.csv")))
    assert found.robot.joint_count == 6
    assert found.data.count == 60


def test_robot_yaml_that_names_a_dropped_urdf_is_read_with_it(tmp_path):
    (tmp_path / "two.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(
        "name: mine\nkinematics: {urdf: two.urdf, base: base, tip: flange}\n"
    )
    rows = ["A1;A2;X;Y;Z"]
    for k in range(30):
        one, two = math.radians(7 * k - 100), math.radians(50 * math.sin(k))
        reach = 400.0 + 100.0 * math.cos(two)
        place = (reach * math.cos(one), reach * math.sin(one), 300.0 - 100.0 * math.sin(two))
        rows.append(";".join(f"{v:.6f}" for v in (math.degrees(one), math.degrees(two), *place)))
    (tmp_path / "points.csv").write_text("\n".join(rows) + "\n")
    files = [tmp_path / name for name in ("points.csv", "robot.yaml", "two.urdf")]
    drop = dropped(tmp_path / "drop", *files)
    assert drop.open({}) is None
    assert drop.guess is not None
    assert drop.guess.robot.spec["name"] == "mine"
    assert drop.guess.robot.joint_count == 2


def test_measurements_without_an_arm_name_the_files_to_add(foreign, tmp_path):
    with pytest.raises(
        InputError, match=r"tracker\.csv: found no arm beside it, expected its robot\.yaml, its URDF"
    ):
        dropped(tmp_path / "drop", foreign).open({})


def test_layout_of_foreign_files_named_in_terminal_is_guessed(campaign, foreign, tmp_path):
    drop = Drop(tmp_path / "drop")
    assert drop.take_foreign([foreign], campaign / "robot.yaml", None)
    assert drop.guess is not None
    assert "unit: deg" in drop.guess.text


def test_own_format_with_a_bad_cell_is_not_taken_as_foreign(campaign, tmp_path):
    text = (campaign / "data.csv").read_text().splitlines()
    text[3] = "abc" + text[3][3:]
    (tmp_path / "data.csv").write_text("\n".join(text) + "\n")
    assert not Drop(tmp_path / "drop").take_foreign([tmp_path / "data.csv"], campaign / "robot.yaml", None)
    assert not (tmp_path / "drop").exists()


def test_file_without_measurements_leaves_no_folder_behind(campaign, tmp_path):
    (tmp_path / "words.csv").write_text("hello\nworld\n")
    assert not Drop(tmp_path / "drop").take_foreign([tmp_path / "words.csv"], campaign / "robot.yaml", None)
    assert not (tmp_path / "drop").exists()


def test_files_that_cannot_be_joined_are_refused_by_name(campaign, tmp_path):
    for name in ("one.csv", "two.csv"):
        (tmp_path / name).write_text("hello\nworld\n")
    with pytest.raises(InputError, match=r"^one\.csv"):
        Drop(tmp_path / "drop").take_foreign(
            [tmp_path / "one.csv", tmp_path / "two.csv"], campaign / "robot.yaml", None
        )
    assert not (tmp_path / "drop").exists()


def test_missing_file_is_reported_before_its_missing_arm(tmp_path):
    with pytest.raises(InputError, match=r"nosuch\.csv: cannot be read"):
        open_files([tmp_path / "nosuch.csv"])


def _filled_in(header: list[str], unit: str) -> dict:
    """The form as the page sends it, with `unit` chosen for x, y and z."""
    columns = {name: {"is": name, "unit": unit if name in "xyz" else "deg"} for name in header}
    return {"fields": {"separator": "comma", "decimal": ".", "header_row": "1"}, "columns": columns}


def _joints_and_points_in_inches(foreign: Path, tmp_path: Path) -> list[Path]:
    rows = [line.split(";") for line in foreign.read_text().splitlines()]
    inches = [rows[0][6:], *([f"{float(cell) / 25.4:.6f}" for cell in row[6:]] for row in rows[1:])]
    files = [tmp_path / "joints.csv", tmp_path / "points.csv"]
    for file, lines in zip(files, ([row[:6] for row in rows], inches), strict=True):
        file.write_text("\n".join(",".join(line) for line in lines) + "\n")
    return files


@pytest.mark.full
def test_unit_chosen_for_joined_files_applies_to_original_values(campaign, foreign, tmp_path):
    files = _joints_and_points_in_inches(foreign, tmp_path)
    drop = dropped(tmp_path / "drop", *files, campaign / "robot.yaml")
    assert drop.open({}) is None
    assert drop.guess is not None
    header, rows = first_rows(drop.guess.path, yaml.safe_load(drop.guess.text))
    assert float(rows[0][header.index("x")]) == float(files[1].read_text().splitlines()[1].split(",")[0])
    assert any("inches, read as millimetres" in finding.message for finding in drop.guess.findings)
    assert "does not reach" in str(drop.guess.picture)
    form = _filled_in(header, "in")
    assert drop.open({"form": form, "look": True}) is None
    assert not any(finding.severity == "error" for finding in drop.guess.findings)
    assert "The arm reaches its points" in str(drop.guess.picture)
    found = drop.open({"form": form})
    assert found is not None
    assert found.data.count == 60


def test_mending_the_scale_finding_corrects_the_unit_of_points(campaign, foreign, tmp_path):
    files = _joints_and_points_in_inches(foreign, tmp_path)
    drop = dropped(tmp_path / "drop", *files, campaign / "robot.yaml")
    drop.open({})
    assert drop.guess is not None
    (place,) = (k for k, finding in enumerate(drop.guess.findings) if finding.code == "scale")
    assert drop.open({"mend": place}) is None
    assert "unit: in" in drop.guess.text
    assert "The arm reaches its points" in str(drop.guess.picture)


def test_invalid_form_is_kept_as_the_user_filled_it_in(campaign, foreign, tmp_path):
    drop = dropped(tmp_path / "drop", foreign, campaign / "robot.yaml")
    drop.open({})
    form = _filled_in(["x", "y"], "m")
    form["columns"]["y"]["is"] = "x"
    with pytest.raises(InputError, match="two columns that are x"):
        drop.open({"form": form, "look": True})
    assert drop.draft["form"] == form


def test_unreadable_row_is_left_out_and_noted_in_the_form(campaign, foreign, tmp_path):
    lines = foreign.read_text().splitlines()
    lines[4] = "abc" + lines[4]
    foreign.write_text("\n".join(lines) + "\n")
    drop = dropped(tmp_path / "drop", foreign, campaign / "robot.yaml")
    assert drop.open({}) is None
    assert drop.guess is not None
    assert any("left out: row 5 column A1" in note for note in drop.guess.notes)


def test_notes_of_guesses_name_files_without_their_folder(campaign, foreign, tmp_path):
    drop = dropped(tmp_path / "drop", foreign, campaign / "robot.yaml")
    drop.open({})
    assert drop.guess is not None
    assert not any(str(tmp_path) in note for note in drop.guess.notes)
