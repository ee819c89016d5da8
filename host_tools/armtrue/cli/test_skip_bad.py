"""`--skip-bad`: an unreadable row is left out and reported everywhere; the other rows are used."""

from __future__ import annotations

import json

import pytest

from armtrue import Fit
from armtrue.cli.conftest import FIT, armtrue
from armtrue.report import gather
from armtrue.report.page import page


@pytest.fixture(scope="module")
def spoilt(folder):
    """The campaign with one cell of row 5 that is not a number."""
    lines = (folder / "data.csv").read_text().splitlines()
    lines[4] = "oops," + lines[4].partition(",")[2]
    (folder / "data.csv").write_text("\n".join(lines) + "\n")
    return folder


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
