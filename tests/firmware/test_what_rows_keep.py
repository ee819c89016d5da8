"""The remaining error of each corrected row, as `armtrue compensate` prints it and as --json has it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from armtrue.cli.conftest import armtrue
from armtrue.tables.conftest import document

# The second row stretches the elbow of an arm that is 3 mm shorter than its file says: no engine reaches the point.
POSES = "q1,q2,q3\n0,0,1\n0,0,-0.322\n0.5,0,-0.8\n"


@pytest.fixture
def tables(tmp_path: Path) -> Path:
    """A folder with fit.json, its table t.bin, and poses.csv."""
    fit = document([("link2.tx", "1", -3e-3), ("motor2", "1", 2e-3)])
    fit["robot"]["temperature"] = {}
    (tmp_path / "poses.csv").write_text(POSES)
    from armtrue.tables import ExportOptions, export, fitted_arm
    from armtrue.tables.compensate import sidecar

    (tmp_path / "t.bin").write_bytes(export(fitted_arm(fit, "fit"), ExportOptions()).image)
    sidecar(tmp_path / "t.bin").write_text(json.dumps(fit))
    return tmp_path


def run(folder: Path, *options: str) -> tuple[str, dict[str, Any]]:
    """What a run prints on standard output, in one line, and its figures; standard error stays empty."""
    words = ["compensate", "t.bin", "poses.csv", "--out", "c.csv"]
    said = armtrue(*words, "--json", "c.json", *options, cwd=folder)
    assert (said.returncode, said.stderr) == (0, "")
    return " ".join(said.stdout.split()), json.loads((folder / "c.json").read_text())


@pytest.mark.quick("fixed")
@pytest.mark.parametrize("engine", ["fixed", "double"])
def test_json_has_the_remaining_error_of_every_row(tables: Path, engine: str) -> None:
    left = run(tables, "--engine", engine)[1]["left"]
    rows = left["rows_um"]
    assert len(rows) == len(left["uncorrected_rows_um"]) == 3
    assert (left["max_um"], left["max_row"]) == (rows[1], 3)
    assert left["mean_um"] == pytest.approx(sum(rows) / 3, abs=1e-3)
    assert max(rows[0], rows[2]) < 20.0 < 1000.0 < rows[1]


def test_result_has_only_joint_and_intended_point_columns(tables: Path) -> None:
    run(tables)
    assert (tables / "c.csv").read_text().splitlines()[0] == "q1,q2,q3,tx,ty,tz"
    assert np.loadtxt(tables / "c.csv", delimiter=",", skiprows=1).shape == (3, 6)


def test_output_names_the_row_with_the_largest_remaining_error(tables: Path) -> None:
    said, figures = run(tables)
    assert "1 of 3 rows keep more than 20 µm and 5 % of their error, by the fit: at most " in said
    assert f"{figures['left']['max_um']:.1f} µm of " in said
    assert "in row 3;" in said
    assert any(note in said for note in figures["notes"] if "keep more than" in note)


def test_remaining_error_without_the_fit_is_reported_unknown(tables: Path) -> None:
    (tables / "t.bin.fit.json").rename(tables / "elsewhere.json")
    said, figures = run(tables)
    assert figures["left"] is None
    assert "how far rows stay from their points is not known" in said
    said, figures = run(tables, "--fit", "elsewhere.json")
    assert figures["left"]["max_row"] == 3
    assert "not known" not in said
