"""Files dropped later: read like the first ones, compared, and joined without losing the earlier session."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import armtrue_sim
import numpy as np
import pytest

from armtrue.comparing import compare
from armtrue.io import load_data
from armtrue.workbench.conftest import do, finish
from armtrue.workbench.engine import Engine
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.opening.opened import open_files
from armtrue.workbench.showing.view import pieces

ARM = {"arm": "kr30", "seed": 5, "poses": 150}
MODEL = "effects: [base_frame, tool_offset, joint_offset, link_geometry]\n"
FIRST = 110
MOVED = (0.7, np.array([1.5, -0.4, 0.1]))


@pytest.fixture(scope="module")
def rows(tmp_path_factory) -> tuple[Path, list[dict[str, str]]]:
    folder = tmp_path_factory.mktemp("campaign")
    armtrue_sim.simulate(ARM).write(folder)
    with (folder / "data.csv").open() as stream:
        return folder, list(csv.DictReader(stream))


@pytest.fixture
def engine(tmp_path, monkeypatch) -> Engine:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return Engine(Drop(tmp_path / "drop"))


def text(rows: list[dict[str, str]]) -> bytes:
    """Rows in Armtrue's own form."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue().encode()


def moved(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Rows as a tracker at another place measures them."""
    (angle, shift), found = MOVED, []
    turn = np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    )
    for row in rows:
        place = turn @ [float(row[axis]) for axis in "xyz"] + shift
        found.append({**row, **{axis: repr(float(v)) for axis, v in zip("xyz", place, strict=True)}})
    return found


def foreign(
    rows: list[dict[str, str]], names: str = "A1;A2;A3;A4;A5;A6;X;Y;Z", unit: float = 1000.0
) -> bytes:
    """Rows as a controller exports them, with joint 3 reversed."""
    lines = [names]
    for row in rows:
        angles = [math.degrees(float(row[f"q{k}"])) * (-1 if k == 3 else 1) for k in range(1, 7)]
        lines.append(";".join(f"{v:.7f}" for v in (*angles, *(unit * float(row[axis]) for axis in "xyz"))))
    return "\n".join(lines).encode() + b"\n"


def begun(engine: Engine, rows, place: Path) -> Engine:
    folder, found = rows
    (place / "first.csv").write_bytes(text(found[:FIRST]))
    (place / "model.yaml").write_text(MODEL)
    engine.begin(open_files([place / "first.csv"], folder / "robot.yaml", place / "model.yaml"))
    return engine


def test_fitted_rows_are_recognised_and_join_is_not_offered(engine, rows, tmp_path):
    begun(engine, rows, tmp_path)
    engine.take("again.csv", text(rows[1][:FIRST]))
    assert "are among those that were fitted" in do(engine, "compare")
    assert "Let them join" not in pieces(engine)["result"]


@pytest.mark.full
def test_moved_base_is_reported_and_joins_as_a_separate_set_up(engine, rows, tmp_path):
    begun(engine, rows, tmp_path)
    before = engine.session.node.mean_um
    engine.take("later.csv", text(moved(rows[1][FIRST:])))
    said = do(engine, "compare")
    fit = engine.session.fit_of(0)
    found = compare(fit, load_data(engine.drop.folder / "later.csv", fit.robot))
    assert "base or instrument were moved" in found.sentences[-1]
    for sentence in found.sentences:
        assert sentence in pieces(engine)["result"]
    assert "base or instrument were moved" in said
    assert "Let them join as a set-up of their own" in pieces(engine)["result"]
    do(engine, "join")
    assert engine.session.node.effects[-1] == {"effect": "station"}
    assert engine.session.node.mean_um == pytest.approx(before, rel=0.2)
    do(engine, "make", name="export")
    engine.take("third.csv", text(rows[1][FIRST:]))
    assert "as was to be expected" in do(engine, "compare"), "a file without set-ups is of the first one"


@pytest.mark.full
def test_measurements_of_the_same_set_up_join_without_station(engine, rows, tmp_path):
    begun(engine, rows, tmp_path)
    engine.take("later.csv", text(rows[1][FIRST:]))
    assert "as was to be expected" in do(engine, "compare")
    do(engine, "join")
    assert {"effect": "station"} not in engine.session.node.effects


@pytest.mark.full
def test_earlier_session_stays_reachable_after_a_join(engine, rows, tmp_path, monkeypatch):
    begun(engine, rows, tmp_path)
    do(engine, "name", node=0, name="my careful model")
    do(engine, "leave_out", rows=[5])
    engine.take("later.csv", text(rows[1][FIRST:]))
    do(engine, "compare")
    do(engine, "join")
    joined = engine.session.key
    assert "first.csv: 110 measurements, 2 models" in pieces(engine)["history"]
    do(engine, "switch", session=0)
    assert [node.name for node in engine.session.nodes] == ["my careful model", ""]
    assert engine.session.node.left_out == [5]
    do(engine, "undo")
    again = Engine(Drop(tmp_path / "other"))
    engine._locks.keep(set())
    begun(again, rows, tmp_path)
    assert again.session.key == joined, "work in the first session loses no link"
    do(again, "switch", session=0)
    assert again.session.nodes[0].name == "my careful model"
    assert again.session.at == 0


@pytest.mark.full
def test_later_file_in_the_same_layout_is_read_like_the_first(engine, rows):
    engine.take("first.csv", foreign(rows[1][:FIRST]))
    engine.take("robot.yaml", (rows[0] / "robot.yaml").read_bytes())
    do(engine, "open")
    place = next(k for k, found in enumerate(engine.drop.guess.findings) if found.code == "joint_sign")
    do(engine, "open", mend=place)
    do(engine, "open", text=engine.drop.guess.text)
    engine.take("second.csv", foreign(rows[1][FIRST:]))
    assert "second.csv: mean error" in do(engine, "compare")
    assert "as was to be expected" in engine.said
    do(engine, "join")
    assert engine.session.data.count == len(rows[1])


@pytest.mark.full
def test_later_file_in_another_layout_is_compared_after_review(engine, rows, tmp_path):
    begun(engine, rows, tmp_path)
    engine.take("other.csv", foreign(rows[1][FIRST:], "J1;J2;J3;J4;J5;J6;X [m];Y [m];Z [m]", 1.0))
    assert "Look at what was guessed" in do(engine, "compare")
    opening = pieces(engine)["opening"]
    assert 'data-act="compare" data-source="form"' in opening
    place = next(k for k, found in enumerate(engine.drop.guess.findings) if found.code == "joint_sign")
    do(engine, "open", mend=place)
    do(engine, "compare", text=engine.drop.guess.text)
    assert "as was to be expected" in engine.said
    do(engine, "join")
    assert engine.session.data.count == len(rows[1])


def test_bad_cell_in_own_format_is_named_and_nothing_is_guessed(engine, rows, tmp_path):
    begun(engine, rows, tmp_path)
    wrong = [dict(row) for row in rows[1][FIRST:]]
    wrong[2]["q1"] = "abc"
    engine.take("later.csv", text(wrong))
    engine.do("compare", {})
    finish(engine)
    assert "later.csv row 4 column q1: found 'abc'" in engine.failure
    assert engine.drop.guess is None


@pytest.mark.parametrize(("columns", "factor", "unit"), [("q", 180 / math.pi, "deg"), ("xyz", 1000.0, "mm")])
def test_own_format_in_other_units_is_compared_after_review_of_the_form(
    engine, rows, tmp_path, columns, factor, unit
):
    begun(engine, rows, tmp_path)
    other = [
        {key: str(factor * float(row[key])) if key[0] in columns else row[key] for key in row}
        for row in rows[1][FIRST:]
    ]
    engine.take("later.csv", text(other))
    assert "Look at what was guessed" in do(engine, "compare")
    assert "expected" in engine.drop.guess.notes[0]
    assert f"unit: {unit}" in engine.drop.guess.text
    do(engine, "compare", text=engine.drop.guess.text)
    assert "as was to be expected" in engine.said
