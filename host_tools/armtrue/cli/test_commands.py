"""The commands end to end on a simulated arm: what they print, what they write, how they end."""

from __future__ import annotations

import csv
import json
import re
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

from armtrue.cli.app import app

SCENARIO = Path(__file__).resolve().parents[3] / "sim" / "scenarios" / "kr30-eccentric-gear.yaml"


def armtrue(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "armtrue", *arguments]
    run = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)
    assert "Traceback" not in run.stderr, run.stderr
    return run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("commands")
    armtrue_sim.cli_simulate(SCENARIO, made)
    run = armtrue(
        "fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml", "--out", "fit.json", cwd=made
    )
    assert run.returncode == 0, run.stderr
    return made


def test_fit_prints_errors_before_and_after_beside_the_noise_floor(folder):
    run = armtrue(
        "fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml", "--out", "again.json", cwd=folder
    )
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


def test_predict_writes_one_row_a_pose(folder):
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


def test_diagnose_names_the_hidden_effect_and_add_lets_the_error_fall(folder):
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


def test_refine_prints_a_waterfall_and_keeps_the_last_step(folder):
    run = armtrue("refine", "fit.json", "--out", "best.json", "--json", "steps.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "+ gear_harmonics [3]" in run.stdout
    bars = [line.count("█") for line in run.stdout.splitlines() if "█" in line]
    assert bars[-1] < bars[0]
    steps = json.loads((folder / "steps.json").read_text())["steps"]
    assert len(bars) == len(steps)
    best = json.loads((folder / "best.json").read_text())
    assert best["error"]["held_out"]["mean_um"] == steps[-1]["error"]["held_out"]["mean_um"]


def test_check_ends_with_1_where_an_error_was_found(folder):
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
    """Interrupted as soon as the first step is out; what is there is a whole fit."""
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
    # A machine quick enough to finish before the signal is right as well.
    assert process.returncode in (130, 0)
    assert json.loads((folder / "stopped.json").read_text())["format"] == "armtrue-fit"


def test_output_cut_short_by_its_reader_is_no_error(folder):
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


def test_the_help_of_every_command_shows_an_example_of_it():
    root = typer.main.get_command(app)
    assert isinstance(root, Group)
    known = commands(root)
    assert len(known) > 10
    for path, text in known:
        assert f"armtrue {' '.join(path)} " in text or f"armtrue {' '.join(path)}[/]" in text, path
