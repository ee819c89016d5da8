"""Actions on the tree of models, and the cards and lists that belong to them."""

from __future__ import annotations

import html
import re

import armtrue_sim
import pytest

from armtrue.verdicts import chance, why_words
from armtrue.workbench.conftest import do
from armtrue.workbench.engine import Engine
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.opening.opened import open_files
from armtrue.workbench.showing.beside import swaps
from armtrue.workbench.showing.card import card
from armtrue.workbench.showing.panels import panel
from armtrue.workbench.showing.view import pieces


@pytest.mark.full
def test_refine_reuses_a_model_that_the_tree_has_already(engine):
    do(engine, "add", candidate=0)
    do(engine, "undo")
    do(engine, "refine")
    made = [(node.parent, str(node.effects)) for node in engine.session.nodes]
    assert len(set(made)) == len(made)
    assert engine.session.path[1].number == 1


def test_replacements_are_listed_with_the_most_probable_first(engine):
    shown = swaps(engine.session, "0")
    assert "the most probable first" in shown
    candidates = engine.session.diagnosis_of(0)["candidates"]
    probable = sorted((each["probability"] for each in candidates), reverse=True)[:12]
    said = [html.unescape(each) for each in re.findall(r": probability ([^<]+)</span>", shown)]
    assert said == [chance(each) for each in probable]


def test_replacements_include_an_effect_that_was_removed_since(engine):
    do(engine, "add", candidate=0)
    do(engine, "add", entry={"effect": "backlash", "joints": [2]})
    effects = [entry["effect"] for entry in engine.session.node.effects]
    do(engine, "remove", effect=effects.index("gear_harmonics"))
    do(engine, "add", entry={"effect": "backlash", "joints": [1]})
    place = [entry.get("joints") for entry in engine.session.node.effects].index([2])
    first = re.search(r"<li><span>(.+?): probability", swaps(engine.session, str(place)))
    assert first is not None
    assert first[1].startswith("gear_harmonics")


def test_spectra_say_which_model_the_dashed_line_is_of(engine):
    assert "Dashed" not in panel(engine.session, {"name": "spectra"})
    do(engine, "add", candidate=0)
    assert "Dashed: first model." in panel(engine.session, {"name": "spectra"})


def test_card_does_not_print_a_probability_of_100_percent(engine):
    first = engine.session.diagnosis_of(0)["candidates"][0]
    assert first["probability"] > 0.995
    assert "100 %, explains" in first["why"]
    assert why_words(first).startswith("probability > 99 %, explains")
    assert "probability 100 %" not in card(engine.session, "0")


@pytest.mark.full
def test_rows_left_out_by_a_range_are_not_called_wrong(engine):
    do(engine, "leave_out_where", variable="q1", low=20, high=60)
    words = pieces(engine)["left-out"]
    assert "left out by you: " in words
    assert "wrong" not in words


def test_error_of_orientation_is_shown_where_orientations_were_measured(tmp_path, engine):
    assert "orientation" not in pieces(engine)["error"]
    oriented = {"arm": "cobot", "seed": 3, "poses": 60, "columns": {"add": ["orientation"]}}
    armtrue_sim.simulate(oriented | {"instrument": {"sigma": 9e-6, "orientation": 2e-5}}).write(
        tmp_path / "two"
    )
    for _ in range(2):  # fitted, and resumed
        other = Engine(Drop(tmp_path / "drop"))
        other.begin(open_files([tmp_path / "two" / "data.csv"]))
        found = re.search(r"Error of orientation, training poses: mean ([\d.]+)″", pieces(other)["error"])
        assert found is not None
        assert 0.0 < float(found[1]) < 30.0
        other._locks.keep(set())
