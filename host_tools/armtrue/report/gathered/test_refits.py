"""Intermediate models between two fits, and fits with a candidate added."""

from __future__ import annotations

from armtrue.report.gathered.refits import effects_between, with_candidate

GEOMETRY = {"effect": "link_geometry"}
THERMAL = {"effect": "thermal_expansion", "joints": [1, 2]}
BACKLASH = {"effect": "backlash", "joints": [2]}
PROXY = {"effect": "joint_scale", "joints": [3]}


def test_intermediate_models_add_one_effect_each():
    assert effects_between([GEOMETRY], [GEOMETRY, THERMAL, BACKLASH]) == [[GEOMETRY, THERMAL]]


def test_fits_one_effect_apart_have_no_intermediate_model():
    assert effects_between([GEOMETRY], [GEOMETRY, THERMAL]) == []
    assert effects_between([GEOMETRY, THERMAL], [GEOMETRY]) == []


def test_removed_effects_stay_until_the_last_step():
    between = effects_between([GEOMETRY, PROXY], [GEOMETRY, THERMAL, BACKLASH])
    assert between == [[GEOMETRY, THERMAL, PROXY]]


def test_extended_effect_keeps_its_old_form_until_its_step():
    wider = {"effect": "backlash", "joints": [2, 3]}
    between = effects_between([GEOMETRY, BACKLASH], [GEOMETRY, THERMAL, wider])
    assert between == [[GEOMETRY, THERMAL, BACKLASH]]


def test_candidate_already_in_the_model_gives_no_fit(fits):
    candidate = {"effect": "joint_offset", "joints": [2], "options": {}, "parameters": [{}]}
    assert with_candidate(fits[0], candidate) is None
