"""Formulas of effects written as text."""

from __future__ import annotations

from armtrue.sketching import formula_lines


def test_formula_of_a_table_does_not_count_its_nodes():
    def line(name: str) -> str:
        term = {"coordinate": "motor1", "weight": 1.0, "expression": "hat(q1, 0, 1, 2)"}
        parameters = [{"name": f"transmission_pwl[1].{name}{k}", "terms": [term]} for k in range(1, 11)]
        (found,) = formula_lines({"parameters": parameters, "nonlinear": []})
        return found

    assert line("node").endswith("+ … (a term for each node)")
    assert line("wave").endswith("+ … (10 terms)")


def test_formula_omits_rounding_residues():
    term = {"coordinate": "base.tx", "weight": 1.0, "expression": "x + -2 + -2.994e-16*z + -3.80212345e-16*y"}
    document = {"parameters": [{"name": "tracker_scale", "terms": [term]}], "nonlinear": []}
    assert formula_lines(document) == ["base.tx += c·(x - 2)"]
