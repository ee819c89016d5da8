"""Compiles expressions of the state into nodes of the term list; where no node exists, into a table of stated error."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from armtrue.arrays import Array
from armtrue.tables import expression, layout
from armtrue.tables.builder import Builder, CannotCompileError, Value
from armtrue.tables.expression import Tree
from armtrue.tables.layout import Node

# Error of a table in place of an expression, on its coordinate [rad or m]: the error that is aimed at, and the largest
# that is accepted and stated. 2e-7 rad is 0.6 µm at 3 m.
TABLE_ERROR_WANTED = 2e-9
TABLE_ERROR_ACCEPTED = 2e-7
_MOST_SPLINE_CELLS = 255
_SAMPLES_PER_CELL = 24
_FALLBACK_NODES = (9, 17, 33, 65)
_HARD = ("asin", "acos", "atan", "log", "sqrt", "atan2")
_SMALLEST_STEEPNESS = 15.0  # tanh is ±1 within 2^-40 beyond


@dataclass
class Compiler:
    """Compiles trees for one table. `variable`: name → slot of a state variable (raises CannotCompileError)."""

    builder: Builder
    variable: Callable[[str], Value]
    angle_source: Callable[[str], int | None]  # q3 → 2, th3 → LINK_ANGLE + 2, None: no revolute joint
    notes: list[str] = field(default_factory=list)

    def compile(self, tree: Tree, coefficient: float) -> Value:
        """The slot that holds `tree`. `coefficient`: its factor on the coordinate, for the error.

        Raises CannotCompileError where no form keeps the error within TABLE_ERROR_ACCEPTED.
        """
        scale = max(abs(coefficient), 1e-12)
        if _needs_table(tree) and len(tree.variables()) == 1:
            found = self._spline_over_variable(tree, scale)
            if found is not None:
                return found
        handler = getattr(self, f"_{tree.op}", None)
        if handler is not None:
            return handler(tree, scale)  # type: ignore[no-any-return]
        return self._tabulated(tree, scale)

    def as_wave(self, tree: Tree) -> tuple[int, float, float] | None:
        """Source, order and phase in turns where `tree` is a sine or cosine of one joint angle."""
        found = self._angles(tree.args[0]) if tree.op in ("sin", "cos") else None
        if found is None or len(found[0]) != 1:
            return None
        return *found[0][0], found[1] + (0.25 if tree.op == "cos" else 0.0)

    def _angles(self, argument: Tree) -> tuple[list[tuple[int, float]], float] | None:
        """Σ order · joint angle + constant as (source, order) pairs and turns; None if `argument` is no such sum."""
        affine = expression.as_affine(argument)
        if affine is None:
            return None
        joints = []
        for name, order in affine[0].items():
            source = self.angle_source(name)
            if source is None:
                return None
            joints.append((source, order))
        return joints, affine[1] / (2.0 * math.pi)

    def _number(self, tree: Tree, scale: float) -> Value:
        return self.builder.constant(tree.value)

    def _variable(self, tree: Tree, scale: float) -> Value:
        return self.variable(tree.name)

    def _add(self, tree: Tree, scale: float) -> Value:
        a, b = tree.args
        sign = 1.0 if tree.op == "add" else -1.0
        if b.is_number:
            return self.builder.affine(self.compile(a, scale), 1.0, sign * b.value)
        if a.is_number:
            return self.builder.affine(self.compile(b, scale), sign, a.value)
        return self.builder.add(self.compile(a, scale), self.compile(b, scale), sign)

    _subtract = _add

    def _negate(self, tree: Tree, scale: float) -> Value:
        return self.builder.affine(self.compile(tree.args[0], scale), -1.0)

    def _multiply(self, tree: Tree, scale: float) -> Value:
        a, b = tree.args
        if a.is_number:
            a, b = b, a
        if b.is_number:
            return self.builder.affine(self.compile(a, scale * b.value), b.value)
        return self._product_of_powers(tree, scale) or self.builder.multiply(
            self.compile(a, scale), self.compile(b, scale)
        )

    def _product_of_powers(self, tree: Tree, scale: float) -> Value | None:
        """A product with equal factors, as powers of them; None where all factors differ.

        As a product of independent factors, x · (-x) would have an interval of both signs, though it is never positive.
        """
        number, factors = expression.factors(tree)
        exponents: dict[Tree, int] = {}
        for base, exponent in factors:
            exponents[base] = exponents.get(base, 0) + exponent
        if len(exponents) == len(factors):
            return None
        powers = [self._power(self.compile(base, scale * number), n) for base, n in exponents.items()]
        return self.builder.affine(functools.reduce(self.builder.multiply, powers), number)

    def _power(self, value: Value, exponent: int) -> Value:
        """value^exponent for an exponent above zero, with the interval of a power, not of independent factors."""
        result = value
        for n in range(2, exponent + 1):
            ends = sorted((value.low**n, value.high**n))
            low = 0.0 if n % 2 == 0 and value.low < 0.0 < value.high else ends[0]
            result = dataclasses.replace(self.builder.multiply(result, value), low=low, high=ends[1])
        return result

    def _divide(self, tree: Tree, scale: float) -> Value:
        a, b = tree.args
        if b.is_number:
            return self.builder.affine(self.compile(a, scale / b.value), 1.0 / b.value)
        inverse = self.builder.reciprocal(self.compile(b, scale))
        if a.is_number:
            return self.builder.affine(inverse, a.value)
        return self.builder.multiply(self.compile(a, scale), inverse)

    def _pow(self, tree: Tree, scale: float) -> Value:
        exponent = expression.whole_exponent(tree)
        if exponent is None:
            return self._tabulated(tree, scale)
        result = self._power(self.compile(tree.args[0], scale), abs(exponent))
        if exponent < 0:
            return self.builder.reciprocal(result)
        return self.builder.one() if exponent == 0 else result

    def _sin(self, tree: Tree, scale: float) -> Value:
        return self._wave(tree.args[0], scale, 0.0 if tree.op == "sin" else 0.25)

    _cos = _sin

    def _tan(self, tree: Tree, scale: float) -> Value:
        sine = self._wave(tree.args[0], scale, 0.0)
        return self.builder.multiply(sine, self.builder.reciprocal(self._wave(tree.args[0], scale, 0.25)))

    def _wave(self, argument: Tree, scale: float, phase_turns: float) -> Value:
        """sin(argument + phase): of joint angles as binary angles, which wrap by themselves; of others in radian."""
        joints, turns = self._angles(argument) or ([], 0.0)
        if any(abs(order) >= 2**11 for _, order in joints):
            raise CannotCompileError(f"a harmonic of more than {2**11} cycles a turn")
        if len(joints) == 1:
            return self.builder.harmonic(*joints[0], phase_turns + turns)
        if joints:
            return self.builder.sine_of(self.builder.angle_sum(joints), phase_turns + turns)
        return self.builder.sine_of(self.builder.to_angle(self.compile(argument, scale)), phase_turns)

    def _abs(self, tree: Tree, scale: float) -> Value:
        kind = Node.ABSOLUTE if tree.op == "abs" else Node.SIGN
        return self.builder.unary(kind, self.compile(tree.args[0], scale))

    _sign = _abs

    def _min(self, tree: Tree, scale: float) -> Value:
        kind = Node.MINIMUM if tree.op == "min" else Node.MAXIMUM
        return self.builder.pick(kind, *(self.compile(argument, scale) for argument in tree.args))

    _max = _min

    def _exp(self, tree: Tree, scale: float) -> Value:
        exponent = self.builder.affine(self.compile(tree.args[0], scale), math.log2(math.e))
        if exponent.high > 30.0:
            raise CannotCompileError("an exponential that grows beyond 2^30 within its variables' ranges")
        return self.builder.power_of_two(exponent)

    def _tanh(self, tree: Tree, scale: float) -> Value:
        inner = self.compile(tree.args[0], scale)
        limit = self.builder.constant(_SMALLEST_STEEPNESS)
        inner = self.builder.pick(Node.MINIMUM, inner, limit)
        inner = self.builder.pick(Node.MAXIMUM, inner, self.builder.affine(limit, -1.0))
        # tanh x = 1 - 2 e^-2x / (1 + e^-2x), an odd function: evaluated for |x|, where the exponential is small.
        sign = self.builder.unary(Node.SIGN, inner)
        size = self.builder.unary(Node.ABSOLUTE, inner)
        small = self.builder.power_of_two(self.builder.affine(size, -2.0 * math.log2(math.e)))
        ratio = self.builder.multiply(
            self.builder.affine(small, -1.0, 1.0),
            self.builder.reciprocal(self.builder.affine(small, 1.0, 1.0)),
        )
        return self.builder.multiply(sign, ratio)

    def _hat(self, tree: Tree, scale: float) -> Value:
        value = self.compile(tree.args[0], scale)
        if not all(argument.is_number for argument in tree.args[1:]):
            raise CannotCompileError("a hat whose nodes are not numbers")
        left, centre, right = (argument.value for argument in tree.args[1:])
        nodes = [*([left] if left < centre else []), centre, *([right] if right > centre else [])]
        heights = [float(node == centre) for node in nodes]
        if len(nodes) == 1:
            return self.builder.constant(1.0)
        covered = np.ones(len(nodes), dtype=np.bool_)
        return self.builder.grid([(value, tuple(nodes))], np.array(heights)[:, None], covered, 14, hold=True)[
            0
        ]

    def _asin(self, tree: Tree, scale: float) -> Value:
        """A function of one argument as a piecewise cubic of the argument's slot."""
        inner = self.compile(tree.args[0], scale)
        column = Tree("variable", name="x")
        found = self._spline(inner, lambda x: expression.evaluate(Tree(tree.op, (column,)), {"x": x}), scale)
        return self._tabulated(tree, scale) if found is None else found

    _acos = _atan = _log = _sqrt = _asin

    def _spline_over_variable(self, tree: Tree, scale: float) -> Value | None:
        (name,) = tree.variables()
        return self._spline(self.variable(name), lambda x: expression.evaluate(tree, {name: x}), scale)

    def _spline(self, value: Value, function: Callable[[Array], Array], scale: float) -> Value | None:
        """`function` of a slot as a piecewise cubic, with as few cells as the error allows; None if no number does."""
        first = math.floor(value.low * 2.0**value.fraction)
        span = math.ceil(value.high * 2.0**value.fraction) - first
        best: tuple[float, int, Array] | None = None
        for cell_shift in range(30, 5, -1):
            cells = -(-span // 2**cell_shift)
            if cells > _MOST_SPLINE_CELLS:
                break
            width = 2.0 ** (cell_shift - value.fraction)
            coefficients, error = _fit_cubics(
                function, first * 2.0**-value.fraction, value.high, width, cells
            )
            if not np.isfinite(error):
                return None
            best = (scale * error, cell_shift, coefficients)
            if scale * error <= TABLE_ERROR_WANTED:
                break
        if best is None or best[0] > TABLE_ERROR_ACCEPTED:
            return None
        return self.builder.spline(value, first, best[1], best[2])

    def _tabulated(self, tree: Tree, scale: float) -> Value:
        """A multilinear table over the tree's variables, as fine as the accepted error requires."""
        names = sorted(tree.variables())
        if not 1 <= len(names) <= 3:
            raise CannotCompileError(
                f"'{tree.op}' of {len(names)} variables ({', '.join(names)}), which no node computes and no table holds"
            )
        values = [self.variable(name) for name in names]
        for count in _FALLBACK_NODES:
            if count ** len(names) > layout.MAX_GRID_NODES // 2:
                break
            axes: list[Array] = [
                np.asarray(np.linspace(value.low, value.high, count), dtype=np.float64) for value in values
            ]
            error, table = _tabulation_error(tree, names, axes)
            if scale * error <= TABLE_ERROR_ACCEPTED:
                self.notes.append(
                    f"'{tree.op}' of {', '.join(names)} became a table of {count ** len(names)} nodes, "
                    f"error at most {scale * error:.2g} on its coordinate"
                )
                exponent = int_exponent(float(np.abs(table).max()))
                covered = np.ones(table.shape, dtype=np.bool_)
                pairs = [(value, tuple(axis)) for value, axis in zip(values, axes, strict=True)]
                return self.builder.grid(pairs, table[..., None], covered, exponent, hold=True)[0]
        raise CannotCompileError(
            f"'{tree.op}' of {', '.join(names)}: a table of it would be wrong by more than "
            f"{TABLE_ERROR_ACCEPTED:g} rad (m) on its coordinate"
        )


def _needs_table(tree: Tree) -> bool:
    if tree.op in _HARD:
        return True
    if tree.op == "pow" and not (tree.args[1].is_number and tree.args[1].value.is_integer()):
        return True
    return any(_needs_table(argument) for argument in tree.args)


def int_exponent(largest: float) -> int:
    """Fraction bits with which values up to `largest` fill 16 bits."""
    if largest <= 0.0:
        return 30
    exponent = math.floor(math.log2(32767.0 / largest))
    return max(-15, min(40, exponent))


def _fit_cubics(
    function: Callable[[Array], Array], start: float, end: float, width: float, cells: int
) -> tuple[Array, float]:
    """Cubics through the ends and two inner points of every cell, and their largest error on a finer raster.

    The last cell may reach beyond `end`, where the function need not exist: it is fitted to the part before.
    """
    points = np.array([0.0, 0.2, 0.8, 1.0])
    used = np.ones(cells)
    used[-1] = np.clip((end - start) / width - (cells - 1), 1e-6, 1.0)
    starts = start + width * np.arange(cells)[:, None]
    samples = np.broadcast_to(function(starts + width * used[:, None] * points), (cells, points.size))
    coefficients = samples @ np.linalg.inv(np.vander(points, 4, increasing=True)).T
    within = (np.arange(_SAMPLES_PER_CELL) + 0.5) / _SAMPLES_PER_CELL
    fitted = coefficients @ np.vander(within, 4, increasing=True).T
    raster: Array = starts + width * used[:, None] * within
    error = np.abs(fitted - function(raster)).max()
    # Rescale from the used part to the whole cell.
    coefficients = coefficients / used[:, None] ** np.arange(4)
    return coefficients, float(error) if np.isfinite(samples).all() else math.inf


def _tabulation_error(tree: Tree, names: list[str], axes: list[Array]) -> tuple[float, Array]:
    table = _on_raster(tree, names, axes)
    middles = [0.5 * (axis[:-1] + axis[1:]) for axis in axes]
    exact = _on_raster(tree, names, middles)
    interpolated = table
    for dimension in range(len(axes)):
        interpolated = 0.5 * (
            np.take(interpolated, range(interpolated.shape[dimension] - 1), dimension)
            + np.take(interpolated, range(1, interpolated.shape[dimension]), dimension)
        )
    error = np.abs(interpolated - exact).max()
    return (float(error) if np.isfinite(table).all() and np.isfinite(error) else math.inf), table


def _on_raster(tree: Tree, names: list[str], axes: list[Array]) -> Array:
    columns: Mapping[str, Array] = dict(zip(names, np.meshgrid(*axes, indexing="ij"), strict=True))
    return np.array(np.broadcast_to(expression.evaluate(tree, columns), [axis.size for axis in axes]))
