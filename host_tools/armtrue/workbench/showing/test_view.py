"""What the page draws, whatever was dropped on it."""

from __future__ import annotations

import math
from pathlib import Path

import armtrue_sim
import pytest

from armtrue.workbench.conftest import do
from armtrue.workbench.engine import Engine
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.showing.view import pieces

HEAD = [f"Achse {k} [°]" for k in range(1, 7)] + ["X [mm]", "Y [mm]", "Z [mm]"]


@pytest.fixture
def waiting(tmp_path, monkeypatch):
    """An engine on which a German export in Latin-1 and its arm were dropped and opened."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    campaign = armtrue_sim.simulate({"arm": "kr30", "seed": 5, "poses": 60})
    campaign.write(tmp_path)
    head, *rows = [line.split(",") for line in (tmp_path / "data.csv").read_text().splitlines()]
    at = [head.index(name) for name in ("q1", "q2", "q3", "q4", "q5", "q6", "x", "y", "z")]
    lines = [";".join(HEAD)]
    for row in rows:
        values = [float(row[k]) for k in at]
        values = [math.degrees(v) for v in values[:6]] + [1000.0 * v for v in values[6:]]
        lines.append(";".join(f"{v:.6f}" for v in values).replace(".", ","))
    engine = Engine(Drop(tmp_path / "drop"))
    engine.take("export.csv", ("\n".join(lines) + "\n").encode("latin-1"))
    engine.take("robot.yaml", (tmp_path / "robot.yaml").read_bytes())
    do(engine, "open")
    return engine


def test_file_that_is_not_utf_8_is_shown_as_init_reads_it(waiting):
    opening = pieces(waiting)["opening"]
    assert "unit of Achse 1 [°]" in opening
    assert "cannot be shown" not in opening


@pytest.mark.parametrize("encoding", ["utf-8", "no-such-encoding", "[5]"])
def test_page_is_drawn_and_files_are_put_aside_whatever_the_form_stands_on(waiting, encoding):
    guess = waiting.drop.guess
    guess.text = guess.text.replace("encoding: cp1252", f"encoding: {encoding}")
    opening = pieces(waiting)["opening"]
    assert "The first rows cannot be shown" in opening
    assert str(Path(waiting.drop.folder)) not in opening
    do(waiting, "forget")
    assert "Put aside" not in pieces(waiting)["opening"]
