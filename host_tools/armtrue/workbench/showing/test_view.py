"""What the page draws, whatever was dropped on it."""

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


def test_what_a_fit_doubts_stands_among_the_notes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    armtrue_sim.simulate({"arm": "kr30", "seed": 5, "poses": 60}).write(tmp_path)
    with (tmp_path / "data.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    for row in rows:  # the tracker hangs upside down beside the arm, or the arm beside the tracker
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
    one._waiting_lock.keep(set())  # its process ends
    assert list(started("three").drop.names) == ["first.csv"]


def test_what_is_found_while_the_page_is_drawn_is_new_to_it(tmp_path, monkeypatch):
    """The page showed for ever that the diagnosis was being worked out: it ended while the pieces were made."""
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


def test_every_action_that_has_ended_is_new_to_the_page(waiting):
    """Of a short one the page heard nothing but its end, and went on showing what had been before."""
    before = server.whole_view(waiting)["ended"]
    do(waiting, "forget")
    assert server.running(waiting)["ended"] == before + 1


def test_a_workbench_that_can_keep_nothing_still_opens(tmp_path, monkeypatch):
    (tmp_path / "state").write_text("no folder")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    engine = Engine(Drop(tmp_path / "drop"))
    engine.go_on_waiting()
    engine.take("first.csv", b"q1,q2\n0.1,0.2\n")
    assert "cannot be" in engine.failure
