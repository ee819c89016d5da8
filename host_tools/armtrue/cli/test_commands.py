"""The commands end to end on a simulated arm: their text, their files and their exit status."""

from __future__ import annotations

import csv
import json
import math
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import armtrue_sim
import numpy as np
import pytest
import typer
from click import Group
from typer.testing import CliRunner

from armtrue import diagnosis
from armtrue.cli.app import app
from armtrue.cli.conftest import FIT, armtrue
from armtrue.cli.fitting import _without
from armtrue.fitting import Fit


def test_fit_prints_errors_before_and_after_beside_the_noise_floor(folder):
    run = armtrue(*FIT, "--out", "again.json", cwd=folder)
    for words in (
        "nominal",
        "training poses",
        "held-out poses",
        "by time",
        "noise floor:",
        "± sigma",
        "written: again.json",
    ):
        assert words in run.stdout
    assert (folder / "again.json").read_text() == (folder / "fit.json").read_text()


def test_predict_writes_one_row_per_pose(folder):
    run = armtrue("predict", "fit.json", "test.csv", "--out", "predicted.csv", cwd=folder)
    assert run.returncode == 0, run.stderr
    predicted = np.genfromtxt(folder / "predicted.csv", delimiter=",", names=True)
    exact = np.genfromtxt(folder / "test.csv", delimiter=",", names=True)
    assert predicted.dtype.names == ("x", "y", "z")
    off = [np.median(np.abs(predicted[name] - exact[name])) for name in "xyz"]
    assert max(off) < 200e-6


def test_predict_reads_poses_without_positions(folder):
    with (folder / "test.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    names = [name for name in rows[0] if name not in "xyz"]
    with (folder / "bare.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, names, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    armtrue("predict", "fit.json", "test.csv", "--out", "with.csv", cwd=folder)
    run = armtrue("predict", "fit.json", "bare.csv", "--out", "without.csv", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert (folder / "with.csv").read_text() == (folder / "without.csv").read_text()


def test_diagnose_names_hidden_effect_and_add_lowers_the_error(folder):
    run = armtrue("diagnose", "fit.json", "--json", "-", cwd=folder)
    best = json.loads(run.stdout)["candidates"][0]
    assert (best["effect"], best["joints"]) == ("gear_harmonics", [3])
    run = armtrue(
        "add",
        "fit.json",
        "gear_harmonics",
        "--joints",
        "3",
        "--out",
        "added.json",
        "--json",
        "a.json",
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    assert "before, held-out" in run.stdout
    figures = json.loads((folder / "a.json").read_text())
    assert figures["error"]["held_out"]["mean_um"] < 0.6 * figures["before"]["held_out"]["mean_um"]


def test_fit_prints_the_error_of_orientation_and_each_figure_once(tmp_path):
    columns = {"add": ["orientation"]}
    armtrue_sim.simulate({"arm": "kr30", "seed": 5, "columns": columns, "hidden": []}).write(tmp_path)
    run = armtrue(*FIT, "--out", "fit.json", "--json", "f.json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    error = json.loads((tmp_path / "f.json").read_text())["orientation_error"]["train"]
    assert 0.0 < error["mean_urad"] < error["max_urad"] < 1000.0
    lines = run.stdout.splitlines()
    heading = next(k for k, line in enumerate(lines) if "orientation [″]" in line)
    assert f"{math.degrees(error['mean_urad'] * 1e-6) * 3600:.1f}" in lines[heading + 1]
    # The held-out poses are those held out at random.
    assert "held out by random" not in run.stdout
    assert "value: where the column nominal has a figure, what the fit adds to it" in run.stdout


def test_folder_of_a_campaign_may_have_the_name_of_its_scenario(tmp_path):
    for _ in ("new", "there already"):
        run = armtrue("simulate", "kr30-eccentric-gear", "--out", "kr30-eccentric-gear", cwd=tmp_path)
        assert run.returncode == 0, run.stderr
    assert (tmp_path / "kr30-eccentric-gear" / "data.csv").exists()


def test_diagnose_prints_the_coefficients_it_recommends(folder):
    run = armtrue("diagnose", "fit.json", cwd=folder)
    values = re.findall(r"gear_harmonics\[3\]\.(\w+) = (-?[\d.]+) ± ([\d.]+) ″", run.stdout)
    assert [name for name, _, _ in values] == ["sin1", "cos1", "sin2", "cos2"]
    assert all(float(sigma) > 0.0 for _, _, sigma in values)
    said = " ".join(run.stdout.split())
    assert ": gear_harmonics 3 explains more of the squared residual" in said
    assert "explains more than gear_harmonics 3, but with 81 parameters instead of 4" in said
    assert "the data favour the first, but the second explains more with 81 parameters instead of 4" in said
    # The data decide: plan would only say so.
    assert "armtrue plan" not in run.stdout


def test_commands_printed_by_diagnose_can_be_pasted(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "my arm")
    (tmp_path / "my arm" / "fit.json").rename(tmp_path / "my arm" / "first try.json")
    run = armtrue("diagnose", "my arm/first try.json", "--data", "my arm/data.csv", cwd=tmp_path)
    (line,) = [line for line in run.stdout.splitlines() if line.startswith("  armtrue add ")]
    assert line.endswith("--out 'my arm/first try2.json' --data 'my arm/data.csv'")
    added = armtrue(*shlex.split(line)[1:], cwd=tmp_path)
    assert added.returncode == 0, added.stderr
    assert (tmp_path / "my arm" / "first try2.json").exists()
    assert " FIT" not in run.stdout


def test_refine_prints_a_waterfall_and_keeps_the_last_step(folder):
    run = armtrue("refine", "fit.json", "--out", "best.json", "--json", "steps.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "+ gear_harmonics 3" in run.stdout
    bars = [line.count("█") for line in run.stdout.splitlines() if "█" in line]
    assert bars[-1] < bars[0]
    steps = json.loads((folder / "steps.json").read_text())["steps"]
    assert len(bars) == len(steps)
    best = json.loads((folder / "best.json").read_text())
    assert best["error"]["held_out"]["mean_um"] == steps[-1]["error"]["held_out"]["mean_um"]


REFUSED_EFFECTS = {
    "one of those it holds by default": (
        "joint_compliance --joints 2",
        ["fit.json: found joint_compliance in the model already"],
    ),
    "all of those it holds by default": (
        "joint_compliance",
        ["fit.json: found joint_compliance in the model already"],
    ),
    "not of this arm": (
        "parallelogram",
        ["fit.json: parallelogram cannot be added", "expected linkage in robot.yaml, found none"],
    ),
    "not recorded": ("command_readback --joints 2", ["data.csv", "expected column qr2, found none"]),
}


@pytest.mark.parametrize("case", REFUSED_EFFECTS)
def test_add_refuses_an_impossible_effect_with_the_reason(folder, case):
    arguments, named = REFUSED_EFFECTS[case]
    run = armtrue("add", "fit.json", *arguments.split(), "--out", "refused.json", cwd=folder)
    refused(run, named)
    assert not (folder / "refused.json").exists()


def test_add_refuses_an_effect_that_is_partly_in_the_model(folder):
    held = armtrue("add", "fit.json", "joint_scale", "--joints", "3", "--out", "scale.json", cwd=folder)
    assert held.returncode == 0, held.stderr
    run = armtrue("add", "scale.json", "joint_scale", "--out", "refused.json", cwd=folder)
    refused(run, ["scale.json: joint_scale cannot be added", "parameter joint_scale[3]", "twice"])


def test_effect_that_stands_twice_is_removed_from_one_joint_only():
    entries = [{"effect": "gear_harmonics", "joints": [k]} for k in (2, 3)]
    document = {"model": {"effects": entries}, "parameters": entries}
    kept = _without(Fit(document), {"effect": "gear_harmonics"}, [3], Path("fit.json"))
    assert kept == entries[:1]


def refused(run: subprocess.CompletedProcess[str], named: list[str]) -> None:
    """Check for status 2 and a one-line message that contains each text in `named`."""
    assert run.returncode == 2, run.stdout + run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
    for words in named:
        assert words in run.stderr


def test_predict_names_the_column_to_record(folder):
    armtrue("add", "fit.json", "thermal_expansion", "--out", "warm.json", cwd=folder)
    with (folder / "test.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    names = [name for name in rows[0] if not name.startswith("temp_")]
    assert len(names) < len(rows[0])
    with (folder / "cold.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, names, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    run = armtrue("predict", "warm.json", "cold.csv", "--out", "refused.csv", cwd=folder)
    refused(run, ["cold.csv: column temp_arm is missing"])
    assert not (folder / "refused.csv").exists()


@pytest.mark.full
def test_moved_data_lists_searched_paths_and_is_read_with_data(folder):
    away = folder / "away"
    away.mkdir()
    shutil.copy(folder / "fit.json", away / "fit.json")
    document = json.loads((away / "fit.json").read_text())
    document["data"]["path"] = str(folder / "old" / "data.csv")
    (away / "fit.json").write_text(json.dumps(document))
    run = armtrue("diagnose", "away/fit.json", cwd=folder)
    refused(run, ["--data DATA"])
    refused(armtrue("plan", "away/fit.json", "--poses", "5", "--out", "p.csv", cwd=folder), ["--data DATA"])
    places = re.search(r"looked for them at (.*);", run.stderr)
    assert places is not None
    assert places[1].split(", ") == [str(folder / "old" / "data.csv"), str(away / "data.csv")]
    refused(armtrue("diagnose", "away/fit.json", "--data", "no.csv", cwd=folder), ["no.csv", "found no file"])
    other = armtrue("diagnose", "away/fit.json", "--data", "test.csv", cwd=folder)
    refused(other, ["test.csv", "other measurements than those of the fit"])
    step = ("add", "away/fit.json", "gear_harmonics", "--joints", "3", "--out", "away/next.json")
    run = armtrue(*step, "--data", "data.csv", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert armtrue("diagnose", "away/next.json", cwd=folder).returncode == 0


def test_check_exits_with_status_1_if_it_finds_an_error(folder):
    assert armtrue("check", "data.csv", "--robot", "robot.yaml", cwd=folder).returncode == 0
    text = (folder / "robot.yaml").read_text()
    (folder / "turned.yaml").write_text(re.sub(r"offset: -1\.57\d+", "offset: 0.0", text, count=1))
    assert (folder / "turned.yaml").read_text() != text
    run = armtrue("check", "data.csv", "--robot", "turned.yaml", "--json", "-", cwd=folder)
    assert run.returncode == 1
    report = json.loads(run.stdout)
    assert report["ok"] is False
    assert report["findings"][0]["code"] == "joint_zero"


@pytest.mark.parametrize(
    "arguments",
    [
        "fit data.csv --robot robot.yaml --model model.yaml --out j.json --json -",
        "add fit.json backlash --joints 2 --out j.json --json -",
        "check data.csv --robot robot.yaml --json -",
        "diagnose fit.json --json -",
        "effects --json -",
    ],
)
def test_json_to_standard_output_is_json_and_nothing_else(folder, arguments):
    run = armtrue(*arguments.split(), cwd=folder)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)


def test_an_interrupt_keeps_the_last_finished_step(folder):
    """Interrupted as soon as the file of the first step exists: it must be a complete fit."""
    process = subprocess.Popen(
        [sys.executable, "-m", "armtrue", "refine", "fit.json", "--out", "stopped.json"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not (folder / "stopped.json").exists() and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    # Status 0: a fast machine may finish before the signal.
    assert process.returncode in (130, 0)
    assert json.loads((folder / "stopped.json").read_text())["format"] == "armtrue-fit"


class Interrupted:
    """A refinement that is interrupted once `count` steps are finished."""

    def __init__(self, count: int) -> None:
        self.steps = [
            {**diagnosed, "added": added, "removed": [], "effects": [{"effect": "base_frame"}] * (k + 1)}
            for k, (diagnosed, added) in enumerate([(STEP, None), (STEP, ADDED)][:count])
        ]

    def __call__(self, fit, progress, on_step):
        for step in self.steps:
            on_step(fit, step)
        raise KeyboardInterrupt


STEP = {
    "error": {"held_out": {"mean_um": 69.9, "rms_um": 78.7, "p95_um": 131.3, "max_um": 229.2}},
    "noise_floor_um": None,
    "noise_floor_source": "none",
}
ADDED = {"effect": "gear_harmonics", "joints": [3], "options": {}, "parameters": []}


def test_an_interrupt_writes_the_finished_steps_as_interrupted(folder, monkeypatch):
    refinement = Interrupted(2)
    monkeypatch.setattr(diagnosis, "refine", refinement)
    out, steps = folder / "two.json", folder / "two-steps.json"
    arguments = ["refine", str(folder / "fit.json"), "--out", str(out), "--json", str(steps)]
    run = CliRunner().invoke(app, arguments)
    assert run.exit_code == 130
    assert f"stopped: {out} holds the last finished step" in " ".join(run.output.split())
    figures = json.loads(steps.read_text())
    assert figures == {
        "steps": refinement.steps,
        "effects": [{"effect": "base_frame"}] * 2,
        "interrupted": True,
    }
    assert Fit.load(out).effects


def test_an_interrupt_before_the_first_step_writes_nothing(folder, monkeypatch):
    monkeypatch.setattr(diagnosis, "refine", Interrupted(0))
    out, steps = folder / "none.json", folder / "none-steps.json"
    arguments = ["refine", str(folder / "fit.json"), "--out", str(out), "--json", str(steps)]
    run = CliRunner().invoke(app, arguments)
    assert run.exit_code == 130
    assert "nothing is written" in run.output
    assert not out.exists()
    assert not steps.exists()


INTERRUPTED_WHILE_READ_IN = """
import os, signal, sys
class AtImport:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, AtImport())
from armtrue.cli import main
main()
"""
INTERRUPTED_WHEN_DONE = """
import atexit, os, signal
from armtrue.cli import app, main
app.main = lambda: None
atexit.register(os.kill, os.getpid(), signal.SIGINT)
main()
"""
INTERRUPTED_ON_THE_WAY_OUT = """
import os, signal
from armtrue.cli import app, main
app.main = lambda: os.kill(os.getpid(), signal.SIGINT)
main()
"""


@pytest.mark.parametrize(
    ("script", "status"),
    [(INTERRUPTED_WHILE_READ_IN, 130), (INTERRUPTED_ON_THE_WAY_OUT, 130), (INTERRUPTED_WHEN_DONE, 0)],
    ids=["while read in", "on the way out", "when done"],
)
def test_an_interrupt_during_start_or_exit_ends_quietly(folder, script, status):
    command = [sys.executable, "-c", script, "diagnose", "fit.json"]
    # Processes started in the background may inherit an ignored SIGINT.
    run = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (run.returncode, run.stdout, run.stderr) == (status, "", "")


def test_output_closed_early_by_head_prints_no_error(folder):
    command = f"{sys.executable} -m armtrue effects | head -1"
    run = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False
    )
    assert run.stderr == ""


def commands(group: Group, path: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], str]]:
    found = []
    for name, command in group.commands.items():
        if isinstance(command, Group):
            found += commands(command, (*path, name))
        else:
            found.append(((*path, name), command.help or ""))
    return found


def test_help_of_every_command_shows_an_example():
    root = typer.main.get_command(app).whole()
    assert isinstance(root, Group)
    known = commands(root)
    assert len(known) > 10
    for path, text in known:
        assert f"armtrue {' '.join(path)} " in text, path
