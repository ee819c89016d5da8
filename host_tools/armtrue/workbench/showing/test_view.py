"""The page with files in other encodings, doubtful fits, several workbenches, and actions that end meanwhile."""

from __future__ import annotations

import csv
import math
import threading
from pathlib import Path

import armtrue_sim
import pytest
import yaml

from armtrue.workbench import background, server
from armtrue.workbench import engine as engines
from armtrue.workbench.conftest import do, finish
from armtrue.workbench.engine import Engine
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.opening.opened import open_files
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


def test_page_shows_a_latin_1_file_in_the_guessed_encoding(waiting):
    opening = pieces(waiting)["opening"]
    assert "unit of Achse 1 [°]" in opening
    assert "cannot be shown" not in opening


@pytest.mark.parametrize("encoding", ["utf-8", "no-such-encoding", "[5]"])
def test_page_and_forget_work_with_an_unusable_encoding(waiting, encoding):
    guess = waiting.drop.guess
    guess.text = guess.text.replace("encoding: cp1252", f"encoding: {encoding}")
    opening = pieces(waiting)["opening"]
    assert "The first rows cannot be shown" in opening
    assert str(Path(waiting.drop.folder)) not in opening
    do(waiting, "forget")
    assert "Put aside" not in pieces(waiting)["opening"]


def test_notes_include_the_warnings_of_the_fit(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    armtrue_sim.simulate({"arm": "kr30", "seed": 5, "poses": 60}).write(tmp_path)
    with (tmp_path / "data.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    for row in rows:  # either the tracker or the arm hangs upside down
        row["y"], row["z"] = str(-float(row["y"])), str(-float(row["z"]))
    with (tmp_path / "data.csv").open("w") as stream:
        table = csv.DictWriter(stream, rows[0])
        table.writeheader()
        table.writerows(rows)
    robot = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    robot.pop("gravity", None)
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    engine = Engine(Drop(tmp_path / "drop"))
    engine.begin(open_files([tmp_path / "data.csv"]))
    finish(engine)
    assert "from upright in the measuring frame" in pieces(engine)["notes"]


def test_two_workbenches_without_a_session_keep_their_files_apart(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    def started(name):
        engine = Engine(Drop(tmp_path / name))
        engine.go_on_waiting()
        return engine

    def drop(engine, name):
        engine.take(name, b"q1,q2\n0.1,0.2\n")
        finish(engine)

    one, other = started("one"), started("other")
    drop(one, "first.csv")
    drop(other, "second.csv")
    one._waiting_lock.keep(set())  # as if its process ended
    assert list(started("three").drop.names) == ["first.csv"]


def test_view_gives_the_diagnosis_state_from_before_drawing(tmp_path, monkeypatch):
    """A diagnosis ended while the pieces were made, and the page showed for ever that it was being worked out."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    armtrue_sim.simulate({"arm": "kr30", "seed": 5, "poses": 60}).write(tmp_path)
    drawn, diagnose = threading.Event(), background.diagnose

    def when_drawn(fit, tell):
        assert drawn.wait(60.0)
        return diagnose(fit, tell)

    monkeypatch.setattr(background, "diagnose", when_drawn)
    monkeypatch.setattr(engines, "_AT_ONCE_ROWS", 0)
    engine = Engine(Drop(tmp_path / "drop"))
    engine.begin(open_files([tmp_path / "data.csv"]))
    begun = engine.known

    def slowly(engine):
        shown = pieces(engine)
        drawn.set()
        assert engine.background.wait(60.0)
        return shown

    monkeypatch.setattr(server, "pieces", slowly)
    view = server.whole_view(engine)
    assert "being worked out" in view["pieces"]["verdict"]
    assert view["known"] == begun != engine.known


def test_each_ended_action_increments_the_ended_count(waiting):
    """The page saw only the end of a short action, and went on showing the old contents."""
    before = server.whole_view(waiting)["ended"]
    do(waiting, "forget")
    assert server.running(waiting)["ended"] == before + 1


def test_unwritable_state_folder_is_reported_at_the_first_drop(tmp_path, monkeypatch):
    (tmp_path / "state").write_text("no folder")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    engine = Engine(Drop(tmp_path / "drop"))
    engine.go_on_waiting()
    engine.take("first.csv", b"q1,q2\n0.1,0.2\n")
    assert "cannot be" in engine.failure
