"""Steps between two fits, and candidates put in to see what they change."""

from __future__ import annotations

from armtrue.report.gathered.refits import effects_between, with_candidate

GEOMETRY = {"effect": "link_geometry"}
THERMAL = {"effect": "thermal_expansion", "joints": [1, 2]}
BACKLASH = {"effect": "backlash", "joints": [2]}
PROXY = {"effect": "joint_scale", "joints": [3]}


def test_one_effect_more_each_time():
    assert effects_between([GEOMETRY], [GEOMETRY, THERMAL, BACKLASH]) == [[GEOMETRY, THERMAL]]


def test_nothing_between_neighbours():
    assert effects_between([GEOMETRY], [GEOMETRY, THERMAL]) == []
    assert effects_between([GEOMETRY, THERMAL], [GEOMETRY]) == []


def test_what_goes_goes_last():
    between = effects_between([GEOMETRY, PROXY], [GEOMETRY, THERMAL, BACKLASH])
    assert between == [[GEOMETRY, THERMAL, PROXY]]


def test_an_effect_that_grew_keeps_its_old_form_until_its_turn():
    wider = {"effect": "backlash", "joints": [2, 3]}
    between = effects_between([GEOMETRY, BACKLASH], [GEOMETRY, THERMAL, wider])
    assert between == [[GEOMETRY, THERMAL, BACKLASH]]


def test_a_candidate_that_is_in_already_gives_nothing(fits):
    candidate = {"effect": "joint_offset", "joints": [2], "options": {}, "parameters": [{}]}
    assert with_candidate(fits[0], candidate) is None
