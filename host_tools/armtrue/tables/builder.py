"""The term list under construction: state variables, nodes, terms and data, with all fixed-point exponents chosen.

A `Value` is a slot of the firmware with its fraction bits and the interval that it stays in. Fractions are
chosen so that the interval fills 30 bits; equal nodes are made once.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.tables import layout
from armtrue.tables.fixedpoint import fraction_for, mantissa_and_shift, to_fixed, wrapped_angle
from armtrue.tables.layout import Node, Section, State

# Beyond this a reciprocal saturates: its argument came within 1/64 of zero.
LARGEST_RECIPROCAL = 64.0
# Terms on motor sides with a larger slope than this [rad/rad] are evaluated once more after the last step: a step moves
# a joint by some 1e-4 rad, and the error that it leaves is the slope times that.
STEEP = 5e-4
# Bits by which a SCALE node can shift a slot up: its mantissa has 31 bits and a sign.
_MOST_GAIN = 30
# A wave of order 1 or 2 over a link angle needs no node: the state has the sine and cosine of every link angle, from
# which those of twice the angle follow.
_SLOW_ORDERS = (2**layout.ORDER_FRACTION, 2 * 2**layout.ORDER_FRACTION)
# Sums on a coordinate saturate here [rad, m].
LARGEST_TERM = 0.5
# Amplitudes have 32 fraction bits and a sign.
LARGEST_WAVE = (2.0**31 - 1.0) / 2.0**layout.TERM_SHIFT


class CannotCompileError(Exception):
    """The table format cannot represent an expression or value; the message says which and why."""


@dataclass(frozen=True)
class Value:
    """A slot: its reference, fraction bits, interval, and whether it is constant during a control cycle."""

    section: Section  # STATE or NODES
    index: int
    fraction: int
    low: float
    high: float
    is_constant: bool

    @property
    def largest(self) -> float:
        """Largest magnitude in the interval."""
        return max(abs(self.low), abs(self.high))


@dataclass(frozen=True)
class NodeSpec:
    """A node record whose inputs are `Value`s; slot numbers are assigned when records are written."""

    kind: Node
    a: Value | int = 0
    b: Value | int = 0
    shift: int = 0
    shift2: int = 0
    count: int = 0
    p: int = 0
    r: int = 0


@dataclass
class Harmonics:
    """Waves of joint angles on coordinates; waves of equal order are summed to one amplitude and phase."""

    waves: dict[tuple[int, int, int], complex] = field(default_factory=dict)
    # Offset of the link angle for joints that no other motor drives: there θ = q + offset.
    link_offsets: dict[int, float] = field(default_factory=dict)
    passive: frozenset[int] = frozenset()

    def has_motor(self, coordinate: int) -> bool:
        """True for the motor side of a joint that has a motor, which can correct an error there."""
        return coordinate < layout.MAX_JOINTS and coordinate not in self.passive

    def _is_steep(self, coordinate: int, source: int, order: int, wave: complex) -> bool:
        slope = abs(wave) * order * 2.0**-layout.ORDER_FRACTION
        return self.has_motor(coordinate) and slope > STEEP

    def add(self, coordinate: int, source: int, order: float, phase_turns: float, amplitude: float) -> None:
        """coordinate += amplitude · sin(order · joint + phase).

        Raises CannotCompileError for too high an order or too large an amplitude.
        """
        phase = 2.0 * math.pi * phase_turns
        if order < 0.0:
            order, phase = -order, math.pi - phase
        if order >= 2**11:
            raise CannotCompileError(f"a harmonic of more than {2**11} cycles a turn")
        key = (coordinate, source, to_fixed(order, layout.ORDER_FRACTION))
        wave = self.waves.get(key, 0.0) + amplitude * cmath.exp(1j * phase)
        if abs(wave) > LARGEST_WAVE:
            raise CannotCompileError(
                f"a wave of {abs(wave):.3g} on {layout.coordinate_name(coordinate)}, "
                f"more than {LARGEST_WAVE:.3g} rad (m)"
            )
        self.waves[key] = wave

    def _slow_joint(self, coordinate: int, source: int, order: int, wave: complex) -> int | None:
        """The joint whose link angle's sine and cosine give this wave; None where it needs a sine of its own."""
        is_steep = self._is_steep(coordinate, source, order, wave)
        if order not in _SLOW_ORDERS or is_steep or abs(wave) >= layout.MAX_SLOW_WAVE:
            return None
        if source >= layout.LINK_ANGLE:
            return source - layout.LINK_ANGLE
        return source if source in self.link_offsets else None

    def records(self) -> tuple[list[bytes], int]:
        """Records of the waves that need a sine of their own, steep ones first; and how many are steep."""
        waves = [(*key, wave) for key, wave in sorted(self.waves.items())]
        fast = [entry for entry in waves if self._slow_joint(*entry) is None]
        result = []
        for coordinate, source, order, wave in sorted(fast, key=lambda entry: not self._is_steep(*entry)):
            phase = round(cmath.phase(wave) / (2.0 * math.pi) * 2.0**32) % 2**32
            amplitude = to_fixed(abs(wave), layout.TERM_SHIFT)
            result.append(layout.HARMONIC.pack(coordinate, 0, source, order, phase, amplitude))
        return result, sum(self._is_steep(*entry) for entry in fast)

    def slow_records(self) -> list[bytes]:
        """Waves of one and two cycles per turn of a link angle, one record per coordinate and joint."""
        sums: dict[tuple[int, int], list[float]] = {}
        for (coordinate, source, order), wave in sorted(self.waves.items()):
            joint = self._slow_joint(coordinate, source, order, wave)
            if joint is None:
                continue
            multiple = order // 2**layout.ORDER_FRACTION
            if source < layout.LINK_ANGLE:
                # q = θ - offset.
                wave = wave * cmath.exp(-1j * multiple * self.link_offsets[joint])
            parts = sums.setdefault((coordinate, joint), [0.0] * 4)
            parts[2 * multiple - 2] += wave.real
            parts[2 * multiple - 1] += wave.imag
        return [
            layout.SLOW_WAVE.pack(*place, 0, *(to_fixed(part, layout.TERM_SHIFT) for part in parts))
            for place, parts in sums.items()
        ]


def _unused_bits(value: Value) -> int:
    """Unused upper bits of a slot, by which it can be shifted up; a shift adds no precision below its last bit."""
    if value.largest == 0.0:
        return 0
    return min(_MOST_GAIN, 30 - math.frexp(value.largest)[1] - value.fraction)


@dataclass
class Builder:
    """Collects records; joints are named by 0-based numbers."""

    harmonics: Harmonics = field(default_factory=Harmonics)
    # kind, index, mass set → slot
    states: dict[tuple[State, int, int], Value] = field(default_factory=dict)
    nodes: list[NodeSpec] = field(default_factory=list)
    constant_nodes: set[int] = field(default_factory=set)  # numbers of those constant during a control cycle
    # coordinate, slot, mantissa, steep
    terms: list[tuple[int, Value, int, bool]] = field(default_factory=list)
    data: bytearray = field(default_factory=bytearray)
    axis_slots: list[tuple[int, Value]] = field(default_factory=list)  # offsets in data where slot numbers go
    _node_values: dict[NodeSpec, Value] = field(default_factory=dict)
    _axes: dict[int, list[Value]] = field(default_factory=dict)  # of the grid of a node's number

    def state(
        self, kind: State, index: int, low: float, high: float, mass_set: int = 0, fraction: int | None = None
    ) -> Value:
        """The slot of a state variable."""
        bits = layout.STATE_FRACTION[kind] if fraction is None else fraction
        is_constant = layout.state_class(kind) == 0
        value = Value(Section.STATE, len(self.states), bits, low, high, is_constant)
        return self.states.setdefault((kind, index, mass_set), value)

    def one(self) -> Value:
        """The constant 1."""
        return self.state(State.ONE, 0, 1.0, 1.0)

    def _node(self, kind: Node, fraction: int, low: float, high: float, **fields: Any) -> Value:
        """The slot of a new node with these `fields` of its record, or of the equal node that is there already."""
        spec = NodeSpec(kind, **fields)
        if spec not in self._node_values:
            inputs = [value for value in (spec.a, spec.b) if isinstance(value, Value)]
            by_joint = spec.kind in (Node.HARMONIC, Node.ANGLE)
            is_constant = not by_joint and all(value.is_constant for value in inputs)
            self._node_values[spec] = self._appended(spec, fraction, low, high, is_constant)
        return self._node_values[spec]

    def _appended(self, spec: NodeSpec, fraction: int, low: float, high: float, is_constant: bool) -> Value:
        value = Value(Section.NODES, len(self.nodes), fraction, low, high, is_constant)
        self.nodes.append(spec)
        if is_constant:
            self.constant_nodes.add(value.index)
        return value

    def affine(self, value: Value, factor: float, offset: float = 0.0) -> Value:
        """factor · value + offset."""
        if factor == 1.0 and offset == 0.0:
            return value
        low, high = sorted((factor * value.low + offset, factor * value.high + offset))
        largest = max(abs(low), abs(high), abs(offset), abs(factor) * value.largest)
        # 62 bits of shift and 30 of mantissa limit how much finer than its input the result can be.
        fraction = fraction_for(largest, most=value.fraction + 40)
        mantissa, shift = mantissa_and_shift(factor * 2.0 ** (fraction - value.fraction), least_shift=0)
        rest = to_fixed(offset, fraction)
        return self._node(Node.SCALE, fraction, low, high, a=value, shift=shift, p=mantissa, r=rest)

    def constant(self, number: float) -> Value:
        """A literal as a slot."""
        return self.affine(self.one(), 0.0, number) if number != 1.0 else self.one()

    def add(self, a: Value, b: Value, sign: float = 1.0) -> Value:
        """a + sign · b."""
        if sign != 1.0:
            b = self.affine(b, sign)
        low, high = a.low + b.low, a.high + b.high
        fraction = min(
            fraction_for(max(abs(low), abs(high), a.largest, b.largest)), a.fraction + 31, b.fraction + 31
        )
        shift, shift2 = a.fraction - fraction, b.fraction - fraction
        if max(shift, shift2) > 31:
            raise CannotCompileError("a sum whose parts differ by more than 2^31 in size")
        return self._node(Node.SUM, fraction, low, high, a=a, b=b, shift=shift, shift2=shift2)

    def multiply(self, a: Value, b: Value) -> Value:
        """a · b."""
        corners = [x * y for x in (a.low, a.high) for y in (b.low, b.high)]
        low, high = min(corners), max(corners)
        if a == b:
            low = max(low, 0.0)
        a, b = self._filled(a), self._filled(b)
        return self._node(Node.PRODUCT, a.fraction + b.fraction - 32, low, high, a=a, b=b)

    def _filled(self, value: Value) -> Value:
        """`value` shifted up to use its upper bits, because only the upper half of a product is kept."""
        unused = _unused_bits(value)
        return self.with_fraction(value, value.fraction + unused) if unused > 6 else value

    def reciprocal(self, value: Value) -> Value:
        """1 / value; saturates where the value comes within 1 / LARGEST_RECIPROCAL of zero."""
        if value.low > 0.0 or value.high < 0.0:
            low, high = sorted((1.0 / value.low, 1.0 / value.high))
            low, high = max(low, -LARGEST_RECIPROCAL * 2**20), min(high, LARGEST_RECIPROCAL * 2**20)
        else:
            low, high = -LARGEST_RECIPROCAL, LARGEST_RECIPROCAL
        fraction = min(fraction_for(max(abs(low), abs(high))), 62 - value.fraction)
        if fraction + value.fraction < 0:
            raise CannotCompileError("a quotient by a number beyond 2^30")
        return self._node(Node.RECIPROCAL, fraction, low, high, a=value, shift=fraction + value.fraction)

    def pick(self, kind: Node, a: Value, b: Value) -> Value:
        """min(a, b) or max(a, b)."""
        choose = min if kind is Node.MINIMUM else max
        low, high = choose(a.low, b.low), choose(a.high, b.high)
        fraction = min(a.fraction, b.fraction)
        a, b = self.with_fraction(a, fraction), self.with_fraction(b, fraction)
        return self._node(kind, fraction, low, high, a=a, b=b)

    def with_fraction(self, value: Value, fraction: int) -> Value:
        """`value` with another number of fraction bits, rounded if they are fewer."""
        if value.fraction == fraction:
            return value
        mantissa, shift = mantissa_and_shift(2.0 ** (fraction - value.fraction), least_shift=0)
        return self._node(Node.SCALE, fraction, value.low, value.high, a=value, shift=shift, p=mantissa)

    def unary(self, kind: Node, value: Value) -> Value:
        """abs(value) or sign(value)."""
        if kind is Node.SIGN:
            return self._node(kind, 30, -1.0, 1.0, a=value)
        return self._node(kind, value.fraction, 0.0, value.largest, a=value)

    def harmonic(self, source: int, order: float, phase_turns: float) -> Value:
        """sin(order · joint + phase); `source`: 0-based joint, plus LINK_ANGLE for a link angle."""
        fixed, phase = to_fixed(order, layout.ORDER_FRACTION), wrapped_angle(phase_turns)
        return self._node(Node.HARMONIC, 30, -1.0, 1.0, a=source, p=fixed, r=phase)

    def angle_sum(self, parts: list[tuple[int, float]]) -> Value:
        """Σ order · joint as an angle slot, from (source, order) pairs."""
        value: Value | int = layout.NONE
        for source, order in parts:
            value = self._node(
                Node.ANGLE, 0, 0, 0, a=source, b=value, p=to_fixed(order, layout.ORDER_FRACTION)
            )
        assert isinstance(value, Value)
        return value

    def long_angle(self, source: int, low: float, high: float) -> Value:
        """A joint's angle in radian, of more turns than a state variable holds; `source` as for `harmonic`.

        It is read as a fraction of 2^n turns, with n such that it wraps only beyond twice the range.
        """
        turns = np.array([low, high]) / (2.0 * math.pi)
        part = 2.0 ** -math.ceil(math.log2(4.0 * np.abs(turns).max()))
        within = dataclasses.replace(
            self.angle_sum([(source, part)]), fraction=32, low=part * turns[0], high=part * turns[1]
        )
        return self.affine(within, 2.0 * math.pi / part)

    def to_angle(self, value: Value) -> Value:
        """A slot in radian as an angle slot."""
        factor = 2.0**32 / (2.0 * math.pi) / 2.0**value.fraction
        mantissa, shift = mantissa_and_shift(factor)
        return self._node(Node.TO_ANGLE, 0, 0, 0, a=value, shift=shift, p=mantissa)

    def sine_of(self, angle: Value, phase_turns: float) -> Value:
        """sin(angle slot + phase)."""
        return self._node(Node.SINE, 30, -1.0, 1.0, a=angle, r=wrapped_angle(phase_turns))

    def power_of_two(self, value: Value) -> Value:
        """2^value."""
        high = 2.0 ** min(value.high, 40.0)
        fraction = fraction_for(high)
        low = 2.0 ** max(value.low, -60.0)
        argument = self.with_fraction(value, max(0, min(30, value.fraction)))
        return self._node(
            Node.POWER_OF_TWO, fraction, low, high, a=argument, shift=argument.fraction, p=fraction
        )

    def spline(self, value: Value, first: int, cell_shift: int, coefficients: Array) -> Value:
        """Piecewise cubic of a slot; `coefficients` (cells, 4), for rising powers of the position within the cell."""
        largest = float(np.abs(coefficients).max()) + float(np.abs(coefficients).sum(axis=1).max())
        fraction = fraction_for(largest)
        word = len(self.data) // 4
        raw = np.round(coefficients * 2.0**fraction).astype(np.int64)
        # The gap that rounding leaves between the end of a cell and the start of the next goes into the linear part.
        raw[:-1, 1] += raw[1:, 0] - raw[:-1].sum(axis=1)
        for cell in raw:
            self.data += struct.pack("<4i", *cell)
        ends = coefficients.sum(axis=1)
        low = float(min(coefficients[:, 0].min(), ends.min()))
        high = float(max(coefficients[:, 0].max(), ends.max()))
        return self._node(
            Node.SPLINE, fraction, low, high, a=value, shift=cell_shift, count=len(raw), p=first, r=word
        )

    def grid(
        self,
        axes: list[tuple[Value, tuple[float, ...]]],
        values: Array,
        covered: NDArray[np.bool_],
        exponent: int,
        hold: bool = False,
    ) -> list[Value]:
        """Multilinear table; `values` (nodes of axis 1, …, outputs). Returns one slot per output.

        `exponent`: fraction bits of the int16 values. `hold`: constant beyond the ends instead of fading out.
        """
        outputs = values.shape[-1]
        word = len(self.data) // 4
        self.data += layout.GRID_HEAD.pack(len(axes), outputs, 0)
        flags = layout.AXIS_HOLD_LOW | layout.AXIS_HOLD_HIGH if hold else 0
        for value, nodes in axes:
            self._axis(value, nodes, flags)
        mask = np.zeros(4 * ((covered.size + 31) // 32), dtype=np.uint8)
        packed = np.packbits(covered.ravel(), bitorder="little")
        mask[: packed.size] = packed
        self.data += mask.tobytes()
        raw = np.round(np.where(covered[..., None], values, 0.0) * 2.0**exponent).astype("<i2")
        self.data += raw.tobytes()
        self.data += bytes(-len(self.data) % 4)
        is_constant = all(value.is_constant for value, _ in axes)
        self._axes[len(self.nodes)] = [value for value, _ in axes]
        result = []
        for output in range(outputs):
            part = values[..., output]
            spec = NodeSpec(Node.CONTINUATION) if output else NodeSpec(Node.GRID, count=outputs, r=word)
            low, high = min(0.0, float(part.min())), max(0.0, float(part.max()))
            result.append(self._appended(spec, exponent + layout.GRID_VALUE_FRACTION, low, high, is_constant))
        return result

    def _axis(self, value: Value, nodes: tuple[float, ...], flags: int) -> None:
        largest = 2.0 ** (31 - value.fraction)
        for node in nodes:
            if abs(node) >= largest:
                raise CannotCompileError(
                    f"a table node at {node:g}, expected within ±{largest:g} (wider limits of the joint in robot.yaml, "
                    "and a new fit, allow more)"
                )
        raw = [to_fixed(node, value.fraction) for node in nodes]
        steps = np.diff(np.array(raw, dtype=np.float64))
        if steps.min() <= 2.0**layout.GRID_FRACTION:
            raise CannotCompileError(
                f"table nodes {float(np.diff(nodes).min()):.3g} apart, closer than the format can tell"
            )
        inverses = np.round(2.0 ** (32 + layout.GRID_FRACTION) / steps).astype(np.int64)
        uniform = bool(np.ptp(np.diff(nodes)) <= 1e-9 * (nodes[-1] - nodes[0]))
        self.axis_slots.append((len(self.data), value))
        self.data += layout.GRID_AXIS.pack(0, len(nodes), flags | (0 if uniform else layout.AXIS_EXPLICIT))
        if uniform:
            step = (nodes[-1] - nodes[0]) / (len(nodes) - 1) * 2.0**value.fraction
            self.data += struct.pack("<iI", raw[0], round(2.0 ** (32 + layout.GRID_FRACTION) / step))
        else:
            self.data += struct.pack(f"<{len(raw)}i", *raw)
            self.data += struct.pack(f"<{len(inverses)}I", *(int(i) for i in inverses))

    def add_term(self, coordinate: int, value: Value, coefficient: float, slope: float = 0.0) -> None:
        """coordinate += coefficient · value. `slope`: largest derivative of the term by a joint [rad/rad].

        Raises CannotCompileError beyond 0.5 rad (m).
        """
        if abs(coefficient) * value.largest > LARGEST_TERM:
            raise CannotCompileError(
                f"a term of up to {abs(coefficient) * value.largest:.3g} on {layout.coordinate_name(coordinate)}, "
                f"more than {LARGEST_TERM} rad (m)"
            )
        if value.largest == 0.0 or coefficient == 0.0:
            return
        # A coefficient too large for the mantissa's 31 bits: a slot with unused upper bits is shifted up instead.
        room = _unused_bits(value)
        need = math.frexp(abs(coefficient))[1] - (value.fraction - 31)
        if need > 0 and room > 0:
            value = self.with_fraction(value, value.fraction + min(room, need))
        try:
            mantissa = to_fixed(coefficient, layout.COORDINATE_FRACTION + layout.TERM_SHIFT - value.fraction)
        except OverflowError:
            raise CannotCompileError(
                f"a coefficient of {coefficient:.3g} for a quantity of at most {value.largest:.3g} in the workspace, "
                "more than the format can hold"
            ) from None
        steep = self.harmonics.has_motor(coordinate) and not value.is_constant and slope > STEEP
        self.terms.append((coordinate, value, mantissa, steep))

    def _inputs(self, index: int) -> list[Value]:
        """The slots that node `index` reads."""
        spec = self.nodes[index]
        return [value for value in (spec.a, spec.b) if isinstance(value, Value)] + self._axes.get(index, [])

    def nodes_read_by(self, values: list[Value]) -> set[int]:
        """Numbers of all nodes that `values` need, grids with all of their outputs."""
        needed: set[int] = set()
        waiting = [value.index for value in values if value.section is Section.NODES]
        while waiting:
            index = waiting.pop()
            while self.nodes[index].kind is Node.CONTINUATION:
                index -= 1
            if index in needed:
                continue
            outputs = self.nodes[index].count if self.nodes[index].kind is Node.GRID else 1
            needed.update(range(index, index + outputs))
            waiting += [value.index for value in self._inputs(index) if value.section is Section.NODES]
        return needed
