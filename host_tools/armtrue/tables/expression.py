"""Expressions of the state as trees: evaluated over columns, simplified, and split into parts for the compiler.

The grammar is docs/model.md's; the one parser is `armtrue._core.parse_expression`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from armtrue import _core
from armtrue.arrays import Array

# Powers with a whole exponent up to this are computed as products of their base.
LARGEST_EXPONENT = 8


@dataclass(frozen=True)
class Tree:
    """A node: `op` is "number", "variable" or a function of the grammar."""

    op: str
    args: tuple[Tree, ...] = ()
    value: float = 0.0
    name: str = ""

    @property
    def is_number(self) -> bool:
        """True for a literal."""
        return self.op == "number"

    def variables(self) -> frozenset[str]:
        """Names of the state variables that occur."""
        if self.op == "variable":
            return frozenset({self.name})
        return frozenset().union(*(argument.variables() for argument in self.args))


def number(value: float) -> Tree:
    """A literal."""
    return Tree("number", value=float(value))


@lru_cache(maxsize=65536)
def parse(text: str) -> Tree:
    """The tree of `text`, constants folded. Raises `_core.ExpressionError` where it is no expression."""
    return _fold(json.loads(_core.parse_expression(text)))


def _fold(node: dict[str, Any]) -> Tree:
    if node["op"] == "number":
        return number(node["value"])
    if node["op"] == "variable":
        return Tree("variable", name=node["name"])
    return simplified(Tree(node["op"], tuple(_fold(argument) for argument in node["args"])))


def simplified(tree: Tree) -> Tree:
    """`tree` as a literal where it has no variable, else itself."""
    if tree.args and all(argument.is_number for argument in tree.args):
        return number(float(evaluate(tree, {})))
    return tree


def with_zeros(tree: Tree, names: frozenset[str]) -> Tree:
    """`tree` with the variables `names` set to zero, and without products that contain them."""
    if tree.op == "variable":
        return number(0.0) if tree.name in names else tree
    if not names & tree.variables():
        return tree
    args = tuple(with_zeros(argument, names) for argument in tree.args)
    zero = [argument.is_number and argument.value == 0.0 for argument in args]
    if tree.op == "multiply" and any(zero):
        return number(0.0)
    if tree.op in ("add", "subtract") and zero[1]:
        return args[0]
    if tree.op in ("add", "subtract") and zero[0]:
        return args[1] if tree.op == "add" else simplified(Tree("negate", args[1:]))
    if tree.op == "divide" and zero[0] and not zero[1]:
        return number(0.0)
    return simplified(Tree(tree.op, args))


def _hat(v: Array, left: Array, centre: Array, right: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        rising = np.where(left == centre, 1.0, (v - left) / (centre - left))
        falling = np.where(right == centre, 1.0, (right - v) / (right - centre))
    return np.clip(np.where(v < centre, rising, falling), 0.0, 1.0)


_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "divide": np.divide,
    "pow": np.power,
    "negate": np.negative,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
    "tanh": np.tanh,
    "atan2": np.arctan2,
    "min": np.minimum,
    "max": np.maximum,
    "hat": _hat,
}


def evaluate(tree: Tree, columns: Mapping[str, Array]) -> Array:
    """Values of `tree` over `columns` (name → array); raises KeyError for a variable without a column."""
    if tree.op == "number":
        return np.asarray(tree.value)
    if tree.op == "variable":
        return columns[tree.name]
    with np.errstate(all="ignore"):
        return np.asarray(_FUNCTIONS[tree.op](*(evaluate(argument, columns) for argument in tree.args)))


def as_affine(tree: Tree) -> tuple[dict[str, float], float] | None:
    """`tree` as Σ coefficient · variable + constant, or None where it is not affine in its variables."""
    total: dict[str, float] = {}
    constant = 0.0
    for factor, part in linear_parts(tree):
        if part.op == "variable":
            total[part.name] = total.get(part.name, 0.0) + factor
        elif part.is_number:
            constant += factor * part.value
        else:
            return None
    return {name: factor for name, factor in total.items() if factor != 0.0}, constant


def factors(tree: Tree) -> tuple[float, list[tuple[Tree, int]]]:
    """`tree` as a number times powers: the number, and each factor with its exponent; factors may repeat."""
    if tree.is_number:
        return tree.value, []
    if tree.op == "negate":
        number_of, found = factors(tree.args[0])
        return -number_of, found
    if tree.op == "multiply":
        (first, left), (second, right) = factors(tree.args[0]), factors(tree.args[1])
        return first * second, left + right
    if tree.op == "divide" and tree.args[1].is_number and tree.args[1].value != 0.0:
        number_of, found = factors(tree.args[0])
        return number_of / tree.args[1].value, found
    if (exponent := whole_exponent(tree)) is not None and exponent > 0:
        return 1.0, [(tree.args[0], exponent)]
    return 1.0, [(tree, 1)]


def whole_exponent(tree: Tree) -> int | None:
    """The exponent of a power that products can compute; None for any other tree."""
    if tree.op != "pow" or not tree.args[1].is_number:
        return None
    exponent = tree.args[1].value
    return int(exponent) if exponent.is_integer() and abs(exponent) <= LARGEST_EXPONENT else None


def linear_parts(tree: Tree, factor: float = 1.0) -> list[tuple[float, Tree]]:
    """`factor · tree` as (factor, tree) pairs to be summed; no tree is itself a sum or has a constant factor."""
    if tree.op == "negate":
        return linear_parts(tree.args[0], -factor)
    if tree.op in ("add", "subtract"):
        sign = 1.0 if tree.op == "add" else -1.0
        return linear_parts(tree.args[0], factor) + linear_parts(tree.args[1], sign * factor)
    if tree.op == "multiply" and tree.args[0].is_number:
        return linear_parts(tree.args[1], factor * tree.args[0].value)
    if tree.op == "multiply" and tree.args[1].is_number:
        return linear_parts(tree.args[0], factor * tree.args[1].value)
    if tree.op == "divide" and tree.args[1].is_number and tree.args[1].value != 0.0:
        return linear_parts(tree.args[0], factor / tree.args[1].value)
    if tree.op in ("multiply", "divide"):
        above, below = linear_parts(tree.args[0]), linear_parts(tree.args[1])
        if len(above) == len(below) == 1 and below[0][0] != 0.0:
            pulled = above[0][0] * below[0][0] if tree.op == "multiply" else above[0][0] / below[0][0]
            return [(factor * pulled, Tree(tree.op, (above[0][1], below[0][1])))]
    if tree.is_number:
        return [(factor * tree.value, number(1.0))]
    return [(factor, tree)]
