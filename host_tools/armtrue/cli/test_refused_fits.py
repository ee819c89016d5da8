"""`armtrue fit` refuses an impossible arm in one sentence and writes nothing; it marks doubtful results.

With `--skip-bad`, an unreadable row is left out and reported everywhere; the other rows are used.
"""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import yaml

from armtrue import Fit
from armtrue.cli.conftest import FIT, armtrue
from armtrue.cli.fitting import outside_words
from armtrue.report import gather
from armtrue.report.page import page


@pytest.fixture
def changed(folder, tmp_path):
    """The campaign in a folder of its own, with columns of data.csv multiplied."""
    for name in ("robot.yaml", "model.yaml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    header = (folder / "data.csv").read_text().splitlines()[0]
    rows = np.genfromtxt(folder / "data.csv", delimiter=",", skip_header=1)

    def write(**factors: float):
        names = header.split(",")
        factor = [factors.get(name, 1.0) for name in names]
        np.savetxt(
            tmp_path / "data.csv", rows * factor, delimiter=",", header=header, comments="", fmt="%.9g"
        )
        return tmp_path

    return write


def test_fit_refuses_a_reversed_joint_unless_forced(changed):
    where = changed(q2=-1.0)
    run = armtrue(*FIT, "--out", "fit.json", cwd=where)
    assert run.returncode == 2
    (sentence,) = run.stderr.strip().splitlines()
    for words in ("data.csv: joint 2 turns the other way", "scale: -1", "armtrue check", "--force"):
        assert words in sentence
    assert not (where / "fit.json").exists()
    assert armtrue(*FIT, "--out", "fit.json", "--force", cwd=where).returncode == 0


def test_fit_refuses_a_distant_centre_of_mass_and_names_the_link(changed):
    where = changed()
    robot = yaml.safe_load((where / "robot.yaml").read_text())
    robot["links"][2]["com"] = [500.0, 0.0, 0.0]
    (where / "robot.yaml").write_text(yaml.safe_dump(robot))
    run = armtrue(*FIT, "--out", "fit.json", cwd=where)
    assert run.returncode == 2
    assert "links[3].com: found a centre of mass 500 m from its frame" in run.stderr
    checked = armtrue("check", "data.csv", "--robot", "robot.yaml", "--json", "-", cwd=where)
    assert checked.returncode == 1
    assert json.loads(checked.stdout)["findings"][0]["code"] == "masses"


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (
            {"parameters": {"joint_complianc[2]": {"fixed": 1e-6}}},
            "parameters: found 'joint_complianc[2]', expected the name of a parameter of its effects (did you mean "
            "'joint_compliance[2]'?)",
        ),
        (
            {
                "effects": [
                    {"effect": "custom", "name": "c", "coordinate": "motor2", "expression": "1/(q1-q1)"}
                ]
            },
            "expression: found '1/(q1-q1)', expected an expression with a finite value at every pose: that of row 2",
        ),
    ],
)
def test_fit_of_an_invalid_model_names_model_yaml_and_the_key(changed, extra, words):
    where = changed()
    model = yaml.safe_load((where / "model.yaml").read_text())
    model["effects"] += extra.pop("effects", [])
    (where / "model.yaml").write_text(yaml.safe_dump(model | extra))
    run = armtrue(*FIT, "--out", "fit.json", cwd=where)
    assert run.returncode == 2
    assert run.stderr.startswith("armtrue: model.yaml on data.csv: ")
    assert words in run.stderr
    assert not (where / "fit.json").exists()


def test_fit_of_a_hanging_arm_warns_if_gravity_is_not_given(changed):
    # Turned about x by 180° in the measuring frame.
    where = changed(y=-1.0, z=-1.0)
    arm = yaml.safe_load((where / "robot.yaml").read_text())
    for key in ("base", "gravity"):
        arm.pop(key, None)
    (where / "robot.yaml").write_text(yaml.safe_dump(arm))
    run = armtrue(*FIT, "--out", "fit.json", cwd=where)
    assert run.returncode == 0, run.stderr
    (warning,) = json.loads((where / "fit.json").read_text())["warnings"]
    assert "gravity is taken along the base's −z" in warning
    assert "robot.yaml has no 'gravity'" in " ".join(run.stdout.split())


def test_fit_reports_the_warnings_of_check(changed):
    where = changed(temp_arm=3.0)
    run = armtrue(*FIT, "--out", "fit.json", cwd=where)
    (warning,) = json.loads((where / "fit.json").read_text())["warnings"]
    assert "column temp_arm" in warning
    assert "this looks like Fahrenheit" in " ".join(run.stdout.split())


def test_fit_marks_a_negative_compliance_beside_its_value(changed):
    """With gravity stated upside down, compliances come out negative; the fit must say so."""
    where = changed()
    robot = yaml.safe_load((where / "robot.yaml").read_text())
    robot["gravity"] = [0.0, 0.0, 9.81]
    (where / "robot.yaml").write_text(yaml.safe_dump(robot))
    run = armtrue(*FIT, "--out", "fit.json", cwd=where)
    assert run.returncode == 0, run.stderr
    (line,) = [line for line in run.stdout.splitlines() if line.startswith("joint_compliance[2]")]
    assert line.split()[1].startswith("-")
    assert "outside 0 to " in line


@pytest.mark.parametrize(
    ("value", "sigma", "words"),
    [
        (-1e-6, 1e-7, "outside 0 to 200.0 µrad/Nm"),
        (-1e-7, 1e-7, ""),
        (3e-4, 1e-6, "outside"),
        (1e-6, 1e-7, ""),
    ],
)
def test_value_within_two_sigma_of_its_bound_is_not_called_outside(value, sigma, words):
    parameter = {
        "effect": "joint_compliance",
        "sign": 1,
        "bound": 2e-4,
        "unit": "rad/Nm",
        "value": value,
        "sigma": sigma,
    }
    assert outside_words(parameter) == words or (
        words == "outside" and outside_words(parameter).startswith(words)
    )


@pytest.fixture
def spoilt(folder, tmp_path):
    """A copy of the campaign in which one cell of row 5 is a word."""
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    lines = (folder / "data.csv").read_text().splitlines()
    lines[4] = "oops," + lines[4].partition(",")[2]
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_refusal_of_an_unreadable_row_suggests_skip_bad(spoilt):
    run = armtrue(*FIT, "--out", "no.json", cwd=spoilt)
    assert run.returncode == 2
    assert "row 5 column q1: found 'oops'" in run.stderr
    assert run.stderr.rstrip().endswith("--skip-bad reads the other rows")


@pytest.mark.full
def test_skipped_rows_are_in_the_output_the_fit_and_the_report(spoilt):
    run = armtrue(*FIT, "--skip-bad", "--out", "rest.json", cwd=spoilt)
    assert run.returncode == 0, run.stderr
    assert "left out: data.csv row 5 column q1: found 'oops'" in " ".join(run.stdout.split())
    (skipped,) = json.loads((spoilt / "rest.json").read_text())["data"]["skipped"]
    assert skipped["row"] == 5
    fit = Fit.load(spoilt / "rest.json")
    assert 5 not in fit.data.rows
    text = page(gather([fit]))
    assert "1 row left out because unreadable" in text
    assert "1 unreadable" in text
    assert "armtrue explain" in text


def test_check_reports_the_row_that_skip_bad_left_out(spoilt):
    run = armtrue("check", "data.csv", "--robot", "robot.yaml", "--skip-bad", cwd=spoilt)
    assert "row 5 column q1" in " ".join(run.stdout.split())
