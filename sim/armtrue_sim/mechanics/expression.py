"""Expressions of the state, in the grammar of docs/model.md, evaluated on arrays.

The simulator's own parser shares no code with the fitter's, so that each checks the other.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from ..errors import ScenarioError
from .transforms import Array

_FUNCTIONS: dict[str, tuple[int, Callable[..., Array]]] = {
    name: (1, getattr(np, name))
    for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "abs", "sign", "tanh")
}
_OPERATORS: dict[type[ast.operator], Callable[..., Array]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}


def hat(value: Array, left: float, centre: float, right: float) -> Array:
    """0 outside (left, right), 1 at centre, linear between; left (right) = centre: 1 everywhere on that side."""
    rising = np.ones_like(value) if left == centre else (value - left) / (centre - left)
    falling = np.ones_like(value) if right == centre else (right - value) / (right - centre)
    return np.clip(np.minimum(rising, falling), 0.0, 1.0)


_FUNCTIONS |= {"asin": (1, np.arcsin), "acos": (1, np.arccos), "atan": (1, np.arctan)}
_FUNCTIONS |= {"atan2": (2, np.arctan2), "min": (2, np.minimum), "max": (2, np.maximum), "hat": (4, hat)}


@lru_cache(maxsize=4096)
def _parse(text: str) -> ast.expr:
    try:
        tree = ast.parse(text.replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError) as error:
        raise ScenarioError(f"expression '{text}' does not parse: {error}") from error
    for node in ast.walk(tree):
        allowed = (
            isinstance(node, ast.Name | ast.Load | ast.operator | ast.UnaryOp | ast.USub | ast.UAdd)
            or (isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS)
            or (isinstance(node, ast.Constant) and type(node.value) in (int, float))
            or (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords)
        )
        if not allowed:
            raise ScenarioError(
                f"expression '{text}' holds a {type(node).__name__}, expected arithmetic only"
            )
        if isinstance(node, ast.Call):
            name = node.func.id  # type: ignore[attr-defined]
            if name not in _FUNCTIONS or len(node.args) != _FUNCTIONS[name][0]:
                raise ScenarioError(
                    f"expression '{text}' calls {name} with {len(node.args)} arguments: not in the grammar"
                )
    return tree


@lru_cache(maxsize=4096)
def variables(text: str) -> frozenset[str]:
    """Names of the state variables that an expression reads. Raises ScenarioError where it does not parse."""
    called = {node.func.id for node in ast.walk(_parse(text)) if isinstance(node, ast.Call)}  # type: ignore[attr-defined]
    names = {node.id for node in ast.walk(_parse(text)) if isinstance(node, ast.Name)}
    return frozenset(names - called - {"pi"})


def evaluate(text: str, state: Mapping[str, Array]) -> Array:
    """Value of the expression for arrays of state variables. Raises ScenarioError on an unknown variable."""

    def value(node: ast.expr) -> Array:
        if isinstance(node, ast.Constant):
            return node.value  # type: ignore[return-value]
        if isinstance(node, ast.Name):
            if node.id == "pi":
                return np.pi  # type: ignore[return-value]
            try:
                return state[node.id]
            except KeyError:
                raise ScenarioError(
                    f"expression '{text}' reads '{node.id}', which is no state variable here"
                ) from None
        if isinstance(node, ast.UnaryOp):
            operand = value(node.operand)
            return -operand if isinstance(node.op, ast.USub) else operand
        if isinstance(node, ast.BinOp):
            return _OPERATORS[type(node.op)](value(node.left), value(node.right))
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        return _FUNCTIONS[node.func.id][1](*(value(argument) for argument in node.args))

    return value(_parse(text))
