"""The parts of a fit.json that go into tables."""

from __future__ import annotations

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.tables import expression
from armtrue.tables.conftest import document
from armtrue.tables.export import ExportOptions, export
from armtrue.tables.fitted import digest_of, fitted_arm


def node(index: int, value: float, nodes: list[float], text: str) -> dict[str, object]:
    table = {"id": "t", "axes": [{"variable": "q1", "nodes": nodes}], "index": [index]}
    term = {"coordinate": "motor1", "expression": text, "weight": 2.0, "table": table}
    return {"name": "t", "effect": "transmission_pwl", "value": value, "terms": [term]}


def test_nodes_form_a_table_and_missing_nodes_are_uncovered() -> None:
    nodes = [0.0, 0.5, 1.0, 1.5]
    fit = document([])
    fit["parameters"] += [
        node(0, 1e-4, nodes, "hat(q1, -0.5, 0, 0.5)"),
        node(1, 2e-4, nodes, "hat(q1, 0, 0.5, 1)"),
        node(3, 3e-4, nodes, "hat(q1, 1, 1.5, 2)"),
    ]
    (grid,) = fitted_arm(fit, "fit").grids
    assert grid.values.tolist() == [2e-4, 4e-4, 0.0, 6e-4]
    assert grid.covered.tolist() == [True, True, False, True]
    at = np.array([0.25, 0.75, 1.75, 2.0, -0.25])
    assert np.allclose(grid.evaluate({"q1": at}), [3e-4, 2e-4, 3e-4, 0.0, 1e-4])


def test_term_that_is_no_hat_function_stays_an_expression() -> None:
    fit = document([])
    fit["parameters"].append(node(1, 1e-4, [0.0, 0.5, 1.0], "hat(q1, 0, 0.5, 1)*dir1"))
    arm = fitted_arm(fit, "fit")
    assert not arm.grids
    assert arm.terms == {"motor1": {"hat(q1, 0, 0.5, 1)*dir1": 2e-4}}


def test_effects_of_the_measurement_are_left_out() -> None:
    fit = document([("motor1", "q1", 1e-4), ("base.tx", "time", 1e-9)])
    fit["parameters"][1] |= {"exported": False, "effect": "time_drift"}
    fit["effects_move_um"] = {"time_drift": 156.5}
    arm = fitted_arm(fit, "fit")
    assert list(arm.terms) == ["motor1"]
    assert arm.skipped == {"time_drift": 156.5}


def test_effects_unknown_to_a_device_stay_behind_with_size() -> None:
    fit = document([("motor1", "dir1*(1 - 2*exp(-travel1/0.01))", -4e-5), ("motor2", "warm2_1000", 1e-4)])
    fit["parameters"][0] |= {"effect": "hysteresis"}
    fit["parameters"][1] |= {"exported": False, "effect": "self_heating"}
    fit["effects_move_um"] = {"hysteresis": 23.06}
    arm = fitted_arm(fit, "fit")
    assert not arm.skipped
    assert arm.variables() == {"dir1"}
    assert {effect: size for effect, (_, size) in arm.stays_behind.items()} == {
        "hysteresis": 23.06,
        "self_heating": None,
    }
    columns = {"dir1": np.array([1.0, -1.0])}
    ((text, coefficient),) = arm.terms["motor1"].items()
    assert np.allclose(coefficient * expression.evaluate(expression.parse(text), columns), [-4e-5, 4e-5])
    notes = export(arm, ExportOptions()).notes
    assert any("hysteresis" in note and "23.1 µm" in note for note in notes)


def test_term_of_one_of_several_reflectors_has_its_name() -> None:
    fit = document([("tool[1].tx", "q1", 1e-4), ("tool.ty", "q1", 2e-4)])
    pose = fit["flange_from_tool"].popitem()[1]
    fit["flange_from_tool"] = {"far": pose, "near": pose}
    assert list(fitted_arm(fit, "fit").terms) == ["tool[near].tx", "tool.ty"]


def test_load_acts_at_the_flange_if_neither_tool_nor_point_is_given() -> None:
    fit = document([])
    del fit["payload_point"]
    assert "tool" not in fit["robot"]
    assert fitted_arm(fit, "fit").payload_point.tolist() == [0.0, 0.0, 0.0]


def test_digest_depends_on_content_and_not_on_key_order() -> None:
    one, other = document([("motor1", "q1", 1e-4)]), document([("motor1", "q1", 1e-4)])
    other["parameters"][0] = dict(reversed(list(other["parameters"][0].items())))
    assert digest_of(one) == digest_of(other)
    other["parameters"][0]["value"] = 2e-4
    assert digest_of(one) != digest_of(other)


@pytest.mark.parametrize("missing", ["robot", "flange_from_tool", "measuring_from_base", "parameters"])
def test_incomplete_fit_is_refused(missing: str) -> None:
    fit = document([])
    del fit[missing]
    with pytest.raises(InputError, match=missing):
        fitted_arm(fit, "fit.json")


def test_invalid_expression_is_refused() -> None:
    with pytest.raises(InputError, match="fit.json"):
        fitted_arm(document([("motor1", "__import__('os')", 1.0)]), "fit.json")
