"""Formulas as people read them."""

from __future__ import annotations

from armtrue.sketching import formula_lines


def test_formula_has_no_rests_of_rounding():
    term = {"coordinate": "base.tx", "weight": 1.0, "expression": "x + -2 + -2.994e-16*z + -3.80212345e-16*y"}
    document = {"parameters": [{"name": "tracker_scale", "terms": [term]}], "nonlinear": []}
    assert formula_lines(document) == ["base.tx += c·(x - 2)"]
