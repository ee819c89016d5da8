"""Results of the workbench (commands, notebook, fits with rows left out) and measurements that are added later."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest
from armtrue.cli.conftest import run_forked
from bench_page import Page
from opened import Workbench
from selenium.webdriver.common.by import By

pytestmark = pytest.mark.full

PATIENCE_S = 120.0


def done(workbench: Workbench, **words) -> dict:
    """Request an action, wait until it is done, and return the state after it."""
    assert workbench.do(**words) == 200
    end = time.monotonic() + PATIENCE_S
    while (state := workbench.state())["busy"]:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert state["failure"] == ""
    return state


def bundle(workbench: Workbench, place: Path) -> Path:
    """The unpacked archive of Export."""
    done(workbench, do="make", name="export")
    archive = workbench.ask(f"{workbench.path}file?name=made").read()
    zipfile.ZipFile(io.BytesIO(archive)).extractall(place)
    return place


def armtrue(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return run_forked(*words, cwd=folder, timeout=PATIENCE_S)


@pytest.fixture
def exported(workbench, tmp_path):
    """A session with rows left out and an effect added, exported; its state with it."""
    done(workbench, do="leave_out", rows=[5, 9])
    state = done(workbench, do="add", candidate=0)
    return bundle(workbench, tmp_path / "out"), state


def test_notebook_runs_and_ends_with_the_sessions_model(exported, monkeypatch):
    folder, state = exported
    cells = [cell["source"] for cell in json.loads((folder / "session.ipynb").read_text())["cells"]]
    monkeypatch.chdir(folder)
    names: dict = {}
    for cell in cells:
        exec(compile("".join(cell), "session.ipynb", "exec"), names)
    assert names["model"].effects == state["effects"]
    mean = names["model"].document["error"]["held_out"]["mean_um"]
    assert mean == pytest.approx(state["error"]["held_out"]["mean_um"], rel=1e-9)


def test_commands_run_and_end_with_the_sessions_model(exported):
    folder, state = exported
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    ran = subprocess.run(
        ["sh", "commands.sh"], cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert ran.returncode == 0, ran.stderr
    steps = sorted(folder.glob("step-?.json"))
    last = json.loads(steps[-1].read_text())
    assert len(steps) == len(state["steps"])
    assert last["model"]["effects"] == state["effects"]
    assert last["error"]["held_out"]["mean_um"] == pytest.approx(
        state["error"]["held_out"]["mean_um"], rel=1e-9
    )
    assert (folder / "report.html").is_file()


def test_command_line_accepts_a_fit_with_rows_left_out(exported):
    folder, state = exported
    assert json.loads((folder / "fit.json").read_text())["data"]["left_out"] == [5, 9]
    ran = armtrue(folder, "diagnose", "fit.json", "--json", "diagnosis.json")
    assert ran.returncode == 0, ran.stderr
    assert json.loads((folder / "diagnosis.json").read_text())["verdict"] == state["verdict"]
    ran = armtrue(folder, "report", "fit.json", "--out", "report.html")
    assert ran.returncode == 0, ran.stderr
    assert "2 rows left out by a person: 5, 9." in (folder / "report.html").read_text()


@pytest.mark.parametrize("rows", ["x", "1", "99999"])
def test_rows_that_cannot_be_left_out_are_refused_in_one_sentence(campaign, tmp_path, rows):
    words = ["fit", str(campaign / "data.csv"), "--robot", str(campaign / "robot.yaml")]
    words += ["--model", str(campaign / "model.yaml"), "--out", "fit.json", "--leave-out", rows]
    ran = armtrue(tmp_path, *words)
    assert ran.returncode == 2
    assert len(ran.stderr.strip().splitlines()) == 1
    assert "expected" in ran.stderr
    assert not (tmp_path / "fit.json").exists()


def test_new_measurements_are_compared_and_then_join(start, browser, campaign, tmp_path):
    head, *rows = (campaign / "data.csv").read_text().splitlines()
    old, new = tmp_path / "old.csv", tmp_path / "new.csv"
    old.write_text("\n".join([head, *rows[:220]]) + "\n")
    new.write_text("\n".join([head, *rows[220:]]) + "\n")
    workbench = start(old, "--robot", campaign / "robot.yaml", "--model", campaign / "model.yaml")
    page = Page(browser, workbench.address)
    page.add()
    before = workbench.state()
    browser.driver.find_element(By.ID, "files").send_keys(str(new))
    buttons = page.until(
        lambda: page.by_role("#opening button", "button", "Compare with the model"), "Compare"
    )
    assert "as was to be expected" in page.after(buttons[0].click)
    buttons = page.until(lambda: page.by_role("main button", "button", "Let them join"), "Join")
    said = page.after(buttons[0].click)
    assert f"{len(rows) - 220} measurements of new.csv joined 220 of old.csv" in said
    after = workbench.state()
    assert after["effects"] == before["effects"]
    assert after["error"]["held_out"]["n"] > before["error"]["held_out"]["n"]
    assert page.failure() == ""
