import numpy as np
import pytest

from ..errors import ScenarioError
from .expression import evaluate, hat, variables

STATE = {"q1": np.array([0.5, -2.0]), "tau2": np.array([100.0, -40.0]), "dT_arm": np.array([3.0, 0.0])}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1", 1.0),
        ("-q1^2", [-0.25, -4.0]),
        ("2*q1**2 + q1/4 - -3", [0.5 + 0.125 + 3, 8 - 0.5 + 3]),
        ("tau2*abs(tau2)", [1e4, -1600.0]),
        ("sin(q1)*cos(pi)", [-np.sin(0.5), np.sin(2.0)]),
        ("atan2(q1, 1) + min(q1, 0) + max(q1, dT_arm)", [np.arctan2(0.5, 1) + 3, np.arctan2(-2.0, 1) - 2.0]),
        ("sign(tau2)*sqrt(abs(tau2))", [10.0, -np.sqrt(40.0)]),
        ("hat(q1, 0, 0.5, 1)", [1.0, 0.0]),
    ],
)
def test_grammar(text, expected):
    assert np.allclose(evaluate(text, STATE), expected)


def test_hat_is_flat_beyond_an_open_end_and_hats_sum_to_one():
    x = np.linspace(-1.0, 4.0, 51)
    nodes = [0.0, 1.0, 2.5, 3.0]
    hats = [hat(x, nodes[max(i - 1, 0)], node, nodes[min(i + 1, 3)]) for i, node in enumerate(nodes)]
    assert np.allclose(sum(hats), 1.0)
    assert np.all(hats[0][x < 0.0] == 1.0)
    assert np.all(hats[3][x > 3.0] == 1.0)


def test_variables_exclude_functions_and_constants():
    assert variables("q1*tanh(dT*q2/8) + pi") == {"q1", "q2", "dT"}


@pytest.mark.parametrize(
    "text",
    [
        "q1 +",
        "__import__('os')",
        "q1.real",
        "[q1]",
        "q1 if q1 else 0",
        "lambda: 1",
        "sin(q1, q1)",
        "'a'",
        "q1 // 2",
        "open(q1)",
        "True",
    ],
)
def test_anything_but_arithmetic_is_refused(text):
    with pytest.raises(ScenarioError, match="expression"):
        evaluate(text, STATE)


def test_unknown_variable_is_named():
    with pytest.raises(ScenarioError, match="q9"):
        evaluate("q9", STATE)
