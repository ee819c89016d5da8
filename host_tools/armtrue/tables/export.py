"""Export of a fit as a table image: compile terms, set limits, write records, sign (docs/table-format.md)."""

from __future__ import annotations

import re
import zlib
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.tables import expression, fixed, layout
from armtrue.tables.builder import Builder, CannotCompileError, Harmonics, Value
from armtrue.tables.compiler import Compiler, int_exponent
from armtrue.tables.fitted import FittedArm, Grid
from armtrue.tables.fixedpoint import mantissa_and_shift, to_fixed
from armtrue.tables.gravity_sets import GravitySets, Reading, gravity_variable
from armtrue.tables.layout import Section, State
from armtrue.tables.reference import Reference, Surroundings

_JOINT_VARIABLE = re.compile(r"^(q|th|dir)(\d+)$")

# Ranges for the choice of exponents; inputs beyond them saturate on the device and are counted.
_TEMPERATURE_RANGE_K = 150.0
_TIME_RANGE_S = 2.0**20
_LIMIT_MARGIN = 0.02  # rad or m beyond the joint limits
_LARGEST_POSITION = 7.9  # rad or m: what Q28 holds
_LONGEST_M = 12.0  # of one link or tool; the firmware's reader bounds their sum
_SAMPLED_POSES = 2000
_TORQUE_MARGIN = 1.5
_INCREMENTS_PER_MOTOR_TURN = 2**20
_INCREMENTS_PER_UNIT = 2**24
# Largest correction that an export allows on its own [rad, m]; --max-correction may say more.
_LARGEST_CORRECTION = 0.15
_CORRECTION_STEP = 1e-3
# What to do about a term that a table cannot hold.
_REMEDY = "take the effect out with 'armtrue remove', or fit it in another form"


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; None takes the default that the field's comment gives."""

    serial: str | None = None  # robot.yaml's serial, or its name
    tool: str | None = None  # the only or first tool
    full_pose: bool = False
    sequence: int = 0
    increments: tuple[float, ...] | None = None  # per joint turn or metre; from the gear ratio
    blend_ms: int = 500
    damping_m: float | None = None  # 0.4 % of the reach
    max_correction: float | None = None  # rad or m; twice what 99.9 % of sampled poses need, rounded up
    max_rate: float = 0.1  # rad/s or m/s
    dead_band: float = 2e-5  # rad or m
    payload_max_kg: float | None = None  # half the arm's mass, or 50; the largest that was measured
    secret_seed: bytes | None = None  # Ed25519; None leaves the image unsigned


@dataclass
class Exported:
    """An image and what was found while making it."""

    image: bytes
    notes: list[str] = field(default_factory=list)


def export(arm: FittedArm, options: ExportOptions, path: object = "fit") -> Exported:
    """Compile `arm` into a table image.

    Errors: InputError naming what the format cannot hold. `path` is for messages.
    """
    exported = _Exporter(arm, options, path).run()
    image, verdict = exported.image, fixed.validate(exported.image)
    if verdict.refusal == fixed.TOO_COSTLY:
        raise InputError(
            f"{path}: found a model that takes up to {fixed.cycle_cost(image)} instructions of a control cycle, "
            f"expected at most {fixed.cycle_budget()}; fit fewer effects, wider table spacing or a grid of fewer axes"
        )
    if not verdict.accepted:
        raise InputError(
            f"{path}: found a table that no device would take ({verdict.reason}, byte {verdict.field}), "
            "expected values within docs/table-format.md; check the options and the fit's parameters"
        )
    return exported


class _Exporter:
    def __init__(self, arm: FittedArm, options: ExportOptions, path: object) -> None:
        self.arm = arm
        self.chain = arm.chain
        self.options = options
        self.path = path
        self.notes: list[str] = []
        alone = np.flatnonzero(np.count_nonzero(self.chain.coupling, axis=1) == 1).tolist()
        offsets = {k: float(self.chain.offset[k]) for k in alone if not self.chain.prismatic[k]}
        self.builder = Builder(Harmonics(passive=self.chain.passive, link_offsets=offsets))
        self.rotation_length_m = 0.25 * self.chain.reach_m if options.full_pose else None
        self.tool = self._tool_name()
        self.payload_max_kg = self._payload_max()
        self.gravity = GravitySets(self.chain, arm.payload_in_last_link(), self.payload_max_kg)
        self._ranges: dict[str, tuple[float, float]] = {}
        self._samples: dict[str, Array] = {}

    def run(self) -> Exported:
        self._check_arm()
        self._per_unit = self._increments()
        self.builder.one()
        self._sample_ranges()
        try:
            self._compile_terms()
            image = self._image()
        except (CannotCompileError, OverflowError) as error:
            raise InputError(f"{self.path}: cannot be exported: {error}") from None
        if self.arm.skipped:
            names = [
                name if not size else f"{name} ({size:.1f} µm RMS of what was measured)"
                for name, size in self.arm.skipped.items()
            ]
            self.notes.append(f"left out, as it belongs to the measurement: {', '.join(names)}")
        for effect, (why, moves_um) in self.arm.stays_behind.items():
            size = "" if moves_um is None else f" (the effect moves the tool by {moves_um:.1f} µm RMS)"
            self.notes.append(f"not exported, in part or as a whole: {effect}; {why}{size}")
        return Exported(image, self.notes)

    # ---- what goes in

    def _tool_name(self) -> str:
        names = list(self.arm.flange_from_tool)
        wanted = self.options.tool
        if wanted in names:
            return wanted
        if wanted is not None:
            one = "none: the fit has one tool, which has no name; leave --tool out"
            expected = one if names == [""] else f"one of {', '.join(repr(n) for n in names)}"
            raise InputError(f"--tool: found '{wanted}', expected {expected}")
        if len(names) > 1:
            self.notes.append(f"tool '{names[0]}' of {', '.join(names)} is active (--tool takes another)")
        return names[0]

    def _payload_max(self) -> float:
        if self.options.payload_max_kg is not None:
            return self.options.payload_max_kg
        usual = 50.0 if self.chain.masses is None else max(5.0, 0.5 * float(self.chain.masses.sum()))
        return max(usual, self.arm.payload_kg)

    def _check_arm(self) -> None:
        n = self.chain.joint_count
        self._refuse_more_than(layout.MAX_JOINTS, n, "joints")
        self._refuse_more_than(layout.MAX_SENSORS, len(self.chain.sensors), "sensors")
        for entry in np.argwhere((self.chain.coupling != 0.0) & ~np.eye(n, dtype=bool)):
            if any(self.chain.prismatic[k] for k in entry):
                raise InputError(
                    f"{self.path}: joints {entry[0] + 1} and {entry[1] + 1} are coupled and one slides, "
                    "expected coupling between turning joints"
                )
        largest = _LARGEST_POSITION - _LIMIT_MARGIN
        for k, (low, high) in enumerate(self.chain.limits):
            if self.chain.prismatic[k] and max(abs(low), abs(high)) > largest:
                raise InputError(
                    f"{self.path}: joint {k + 1} has limits {low:g} to {high:g} m, expected within ±{largest:g} m, "
                    "which is what a device can count; give robot.yaml the limits of the part that is used, counted "
                    "from its middle if it is longer, and fit again"
                )

    def _refuse_more_than(self, most: int, count: int, what: str) -> None:
        if count > most:
            raise InputError(f"{self.path}: found {count} {what}, expected at most {most}")

    def _random_poses(self, seed: int) -> Array:
        low, high = self.chain.limits.T
        poses = np.random.default_rng(seed).uniform(low, high, (_SAMPLED_POSES, self.chain.joint_count))
        return np.asarray(poses[self.chain.can_stand(poses)])

    def _sample_ranges(self) -> None:
        """Ranges of the gravity variables over the workspace, without and with the largest payload."""
        reference = Reference(self.arm, self.tool)
        poses = self._random_poses(1)
        for payload in (0.0, self.payload_max_kg):
            columns = reference.state(poses, Surroundings({}, payload=np.full(len(poses), payload)))
            self._samples = columns
            for name in self.arm.variables():
                if gravity_variable(name) is None or name not in columns:
                    continue
                low, high = self._ranges.get(name, (0.0, 0.0))
                column = _TORQUE_MARGIN * columns[name]
                self._ranges[name] = (min(low, float(column.min())), max(high, float(column.max())))
        self._zero = frozenset(
            name
            for name, (low, high) in self._ranges.items()
            if self.gravity.is_zero(name, max(-low, high) / _TORQUE_MARGIN)
        )

    # ---- terms

    def _variable(self, name: str) -> Value:
        """The slot of the state variable `name`."""
        match = _JOINT_VARIABLE.match(name)
        builder = self.builder
        if match and 1 <= int(match[2]) <= self.chain.joint_count:
            k = int(match[2]) - 1
            if match[1] == "dir":
                return builder.state(State.DIRECTION, k, -1.0, 1.0)
            row = np.eye(self.chain.joint_count)[k] if match[1] == "q" else self.chain.coupling[k]
            offset = 0.0 if match[1] == "q" else float(self.chain.offset[k])
            bounds = row * (self.chain.limits + np.array([-_LIMIT_MARGIN, _LIMIT_MARGIN])).T
            low, high = float(bounds.min(axis=0).sum()) + offset, float(bounds.max(axis=0).sum()) + offset
            source = self._angle_source(name)
            if source is not None and max(-low, high) > _LARGEST_POSITION:
                return builder.long_angle(source, low, high)
            kind = State.MOTOR if match[1] == "q" else State.LINK
            return builder.state(kind, k, max(low, -_LARGEST_POSITION), min(high, _LARGEST_POSITION))
        if name == "payload":
            return builder.state(State.PAYLOAD, 0, 0.0, self.payload_max_kg)
        if name == "time":
            return builder.state(State.TIME, 0, 0.0, _TIME_RANGE_S)
        sensor = {f"dT_{sensor}": number for number, sensor in enumerate(self.chain.sensors)}.get(name)
        if sensor is not None or (name == "dT" and self.chain.sensors):
            return builder.state(State.TEMPERATURE, sensor or 0, -_TEMPERATURE_RANGE_K, _TEMPERATURE_RANGE_K)
        if (found := self.gravity.reading(name)) is not None:
            return self._gravity_state(*found, *self._ranges[name])
        if name.startswith(("tau", "gm", "bm")):
            raise CannotCompileError(
                f"'{name}' was measured, and robot.yaml gives no masses from which a device could compute it"
            )
        raise CannotCompileError(f"a device does not know '{name}'")

    def _gravity_state(self, mass_set: int, reading: Reading, low: float, high: float) -> Value:
        fraction = self.gravity.sets[mass_set].fraction
        return self.builder.state(reading.kind, reading.joint, low, high, mass_set, fraction)

    def _angle_source(self, name: str) -> int | None:
        match = _JOINT_VARIABLE.match(name)
        if match is None or match[1] == "dir":
            return None
        k = int(match[2]) - 1
        # Couplings are between turning joints (`_check_arm`).
        if k >= self.chain.joint_count or self.chain.prismatic[k]:
            return None
        return k if match[1] == "q" else layout.LINK_ANGLE + k

    def _compile_terms(self) -> None:
        regressors: dict[str, dict[str, float]] = defaultdict(dict)
        others: list[tuple[str, expression.Tree, float]] = []
        effects: dict[tuple[str, expression.Tree], dict[str, None]] = defaultdict(dict)
        for coordinate, basis in self.arm.terms.items():
            merged: dict[expression.Tree, float] = defaultdict(float)
            for text, coefficient in basis.items():
                whole = expression.with_zeros(expression.parse(text), self._zero)
                for factor, tree in expression.linear_parts(whole, coefficient):
                    merged[tree] += factor
                    effects[coordinate, tree].update(
                        dict.fromkeys(self.arm.effects.get((coordinate, text), []))
                    )
            for tree, coefficient in merged.items():
                variable = gravity_variable(tree.name)
                if variable is not None and variable.is_regressor:
                    regressors[coordinate][tree.name] = coefficient
                elif coefficient != 0.0:
                    others.append((coordinate, tree, coefficient))
        # All mass sets must be known before the first slot is made: slots depend on fractions, fractions on the sets.
        combined = {coordinate: self.gravity.combined(sums) for coordinate, sums in regressors.items()}
        for name in sorted(self.arm.variables()):
            is_read = any(name in tree.variables() for _, tree, _ in others) or any(
                name == axis.variable for grid in self.arm.grids for axis in grid.axes
            )
            if is_read:
                self.gravity.reading(name)
        if len(self.gravity.sets) > layout.MAX_MASS_SETS:
            raise CannotCompileError(
                f"{len(self.gravity.sets)} sets of masses for gravity, more than {layout.MAX_MASS_SETS}; "
                "give link masses in robot.yaml"
            )
        self.gravity.choose_fractions()
        self._add_combined(combined)
        compiler = Compiler(self.builder, self._variable, self._angle_source)
        for coordinate, tree, coefficient in others:
            number = self._coordinate_number(coordinate)
            if number is None:
                continue
            names = ", ".join(effects[coordinate, tree]) or "unknown"
            with _naming(f"effect {names}, a term on {coordinate}"):
                wave = compiler.as_wave(tree)
                if wave is not None:
                    self.builder.harmonics.add(number, *wave, coefficient)
                    continue
                value = compiler.compile(tree, coefficient)
                self.builder.add_term(number, value, coefficient, self._slope(tree, coefficient))
        self._add_grids()
        self.notes += compiler.notes

    def _coordinate_number(self, coordinate: str) -> int | None:
        """Number of a coordinate; None for another tool than the active one."""
        if coordinate.startswith("tool[") and coordinate[5:].rsplit("]", 1)[0] != self.tool:
            return None
        return layout.coordinate_number(coordinate)

    def _add_combined(self, combined: dict[str, dict[Reading, int]]) -> None:
        for coordinate, readings in combined.items():
            for reading, mass_set in readings.items():
                # The mass set contains the coefficients, so the state variable is the sum itself, in rad.
                value = self._gravity_state(mass_set, reading, -0.5, 0.5)
                with _naming(f"gravity regressors on {coordinate}"):
                    self.builder.add_term(layout.coordinate_number(coordinate), value, 1.0)

    def _add_grids(self) -> None:
        """Grids with equal axes, coverage and exponent share one node, so that the cell is searched only once."""
        together: dict[tuple[Any, ...], list[Grid]] = defaultdict(list)
        for grid in self.arm.grids:
            exponent = int_exponent(float(np.abs(grid.values).max()))
            together[grid.axes, grid.covered.tobytes(), exponent].append(grid)
        for (axes, _, exponent), grids in together.items():
            for first in range(0, len(grids), layout.MAX_GRID_OUTPUTS):
                self._add_grid(axes, exponent, grids[first : first + layout.MAX_GRID_OUTPUTS])

    def _add_grid(self, axes: Any, exponent: int, grids: list[Grid]) -> None:
        if len(axes) > layout.MAX_GRID_AXES:
            raise CannotCompileError(
                f"table {grids[0].name} has {len(axes)} axes, more than {layout.MAX_GRID_AXES}"
            )
        if grids[0].values.size > layout.MAX_GRID_NODES:
            raise CannotCompileError(
                f"table {grids[0].name} has {grids[0].values.size} nodes, more than {layout.MAX_GRID_NODES}"
            )
        values = np.stack([grid.values for grid in grids], axis=-1)
        pairs = [(self._variable(axis.variable), axis.nodes) for axis in axes]
        with _naming(f"table {grids[0].name} over {', '.join(axis.variable for axis in axes)}"):
            outputs = self.builder.grid(pairs, values, grids[0].covered, exponent)
        for grid, value in zip(grids, outputs, strict=True):
            number = self._coordinate_number(grid.coordinate)
            if number is None:
                continue
            with _naming(f"table {grid.name}"):
                self.builder.add_term(number, value, 1.0, _grid_slope(grid))

    def _slope(self, tree: expression.Tree, coefficient: float) -> float:
        """Largest slope of a term over any one joint [rad/rad]; gravity is taken as constant."""
        joints = [name for name in tree.variables() if name[0] == "q" or name.startswith("th")]
        columns, step = self._samples, 1e-5
        largest = 0.0
        for name in joints:
            moved = {**columns, name: columns[name] + step}
            with np.errstate(all="ignore"):
                change = np.abs(expression.evaluate(tree, moved) - expression.evaluate(tree, columns)) / step
            largest = max(largest, float(np.nanquantile(change, 0.99)))
        return abs(coefficient) * largest

    # ---- the image

    def _image(self) -> bytes:
        sections = self._records()
        n = self.chain.joint_count
        damping = self.options.damping_m or 0.004 * self.chain.reach_m
        flags = (layout.FLAG_FULL_POSE if self.options.full_pose else 0) | (
            layout.FLAG_SIGNED if self.options.secret_seed else 0
        )
        offset = layout.HEADER.size + layout.DIRECTORY_ENTRY.size * len(sections)
        directory = b""
        body = b""
        for kind, count, content in sections:
            directory += layout.DIRECTORY_ENTRY.pack(kind, count, offset + len(body))
            body += content
        trailer = layout.CHECKSUM.size + (layout.SIGNATURE_LENGTH if self.options.secret_seed else 0)
        header = layout.HEADER.pack(
            layout.MAGIC,
            layout.VERSION,
            layout.HEADER.size,
            offset + len(body) + trailer,
            flags,
            self.options.sequence,
            n,
            len(self.chain.sensors),
            len(self.arm.flange_from_tool),
            len(sections),
            self._serial(),
            self.arm.digest,
            list(self.arm.flange_from_tool).index(self.tool),
            0,
            self.options.blend_ms,
            to_fixed(max(layout.DAMPING[0], damping), layout.LENGTH_FRACTION),
            to_fixed(self.rotation_length_m or 0.0, layout.LENGTH_FRACTION),
            self._constant_nodes,
            self._steep_nodes,
            self._constant_terms,
            self._steep_terms,
            self._steep_harmonics,
            0,
        )
        image = header + directory + body
        if self.options.secret_seed:
            from armtrue.tables import signing

            image += signing.sign(self.options.secret_seed, image)
        image += layout.CHECKSUM.pack(zlib.crc32(image))
        if len(image) > layout.MAX_IMAGE_LENGTH:
            raise InputError(
                f"{self.path}: found a model of {len(image)} bytes as a table, expected at most "
                f"{layout.MAX_IMAGE_LENGTH}; fit wider table spacing or fewer grid nodes"
            )
        return image

    def _serial(self) -> bytes:
        text = self.options.serial if self.options.serial is not None else self.arm.serial
        if not text:
            text = self.arm.name.encode("ascii", "replace").decode()[: layout.SERIAL_LENGTH]
        if not text.isascii() or not text.isprintable() or not 0 < len(text) <= layout.SERIAL_LENGTH:
            raise InputError(
                f"--serial: found '{text}', expected 1 to {layout.SERIAL_LENGTH} printable ASCII characters"
            )
        return text.encode()

    def _records(self) -> list[tuple[Section, int, bytes]]:
        """(kind, count, content) of every section that is not empty, in order."""
        # Constant ones (ONE first), then joint positions, then gravity by mass set: each set is summed once.
        states = sorted(
            self.builder.states.items(),
            key=lambda item: (layout.state_class(item[0][0]), item[0][0] is not State.ONE, item[0][2]),
        )
        order = self._node_order()
        keys = [(Section.STATE, value.index) for _, value in states] + [(Section.NODES, i) for i in order]
        slot_of = {key: position for position, key in enumerate(keys)}

        def slot(value: Value | int) -> int:
            return value if isinstance(value, int) else slot_of[value.section, value.index]

        harmonics, self._steep_harmonics = self.builder.harmonics.records()
        slow_waves = self.builder.harmonics.slow_records()
        self._refuse_more_than(layout.MAX_SLOTS, len(slot_of), "state variables and nodes")
        self._refuse_more_than(layout.MAX_TERMS, len(self.builder.terms), "terms")
        self._refuse_more_than(layout.MAX_HARMONICS, len(harmonics), "harmonics")
        self._refuse_more_than(layout.MAX_SLOW_WAVES, len(slow_waves), "slow waves")
        for position, value in self.builder.axis_slots:
            self.builder.data[position : position + 2] = slot(value).to_bytes(2, "little")
        nodes = [
            layout.NODE.pack(s.kind, s.shift, s.shift2, s.count, slot(s.a), slot(s.b), s.p, s.r)
            for s in (self.builder.nodes[i] for i in order)
        ]
        data, base = bytes(self.builder.data), self.arm.measuring_from_base
        content: list[tuple[Section, list[bytes]]] = [
            (Section.JOINTS, self._joints()),
            (Section.TOOLS, self._tools()),
            (Section.COUPLING, self._coupling()),
            (Section.STATE, [layout.STATE.pack(*key, value.fraction) for key, value in states]),
            (Section.SENSORS, self._sensors()),
            (Section.MASS_SETS, self._mass_sets()),
            (Section.GRAVITY, self._gravity()),
            (Section.NODES, nodes),
            (Section.TERMS, self._terms(slot)),
            (Section.HARMONICS, harmonics),
            (Section.SLOW_WAVES, slow_waves),
            (Section.DATA, [data[i : i + 4] for i in range(0, len(data), 4)]),
            (Section.BASE, [layout.BASE.pack(*base[:3, :3].ravel(), *base[:3, 3])]),
        ]
        return [(kind, len(records), b"".join(records)) for kind, records in content if records]

    def _node_order(self) -> list[int]:
        """Constant ones first, then those that steep terms need, then the rest; every node follows its inputs."""
        needed = self.builder.nodes_read_by([value for _, value, _, steep in self.builder.terms if steep])

        def part(i: int) -> int:
            return 0 if i in self.builder.constant_nodes else 1 if i in needed else 2

        order = sorted(range(len(self.builder.nodes)), key=part)
        self._constant_nodes = sum(part(i) == 0 for i in order)
        self._steep_nodes = sum(part(i) <= 1 for i in order)
        return order

    def _terms(self, slot: Any) -> list[bytes]:
        def part(term: tuple[int, Value, int, bool]) -> int:
            return 0 if term[1].is_constant else 1 if term[3] else 2

        one = self.builder.one()
        terms = sorted(self.builder.terms, key=lambda term: (part(term), term[1] != one, term[0]))
        self._constant_terms = sum(part(term) == 0 for term in terms)
        self._steep_terms = sum(part(term) <= 1 for term in terms)
        return [
            layout.TERM.pack(coordinate, 0, slot(value), mantissa) for coordinate, value, mantissa, _ in terms
        ]

    def _transform(self, matrix: Array) -> list[int]:
        longest = float(np.abs(matrix[:3, 3]).max())
        if longest > _LONGEST_M:
            raise InputError(
                f"{self.path}: found a link or tool of {longest:g} m, expected at most {_LONGEST_M:g} m"
            )
        rotation = [to_fixed(v, layout.RATIO_FRACTION) for v in matrix[:3, :3].ravel()]
        return rotation + [to_fixed(v, layout.LENGTH_FRACTION) for v in matrix[:3, 3]]

    def _joints(self) -> list[bytes]:
        largest = self._magnitude_limits()
        largest[list(self.chain.passive)] = 0.0
        self._say_what_is_cut()
        records = []
        for k, transform in enumerate(self.chain.fixed):
            slides = self.chain.prismatic[k]
            unit = 1.0 if slides else 1.0 / (2.0 * np.pi)  # native units (m or turn) per m or rad
            to_position, position_shift = mantissa_and_shift(2.0**32 / self._per_unit[k])
            to_increment, increment_shift = mantissa_and_shift(self._per_unit[k] / 2.0**32)
            records.append(
                layout.JOINT.pack(
                    *self._transform(transform),
                    round(self.chain.offset[k] * unit * 2.0**32),
                    0,
                    to_position,
                    to_increment,
                    position_shift,
                    increment_shift,
                    int(slides),
                    layout.PASSIVE if k in self.chain.passive else 0,
                    round(min(largest[k] * unit, layout.MAX_DELTA[slides]) * 2.0**32),
                    round(min(self.options.max_rate * unit, layout.MAX_RATE[slides]) * 2.0**32),
                    max(1, round(self.options.dead_band * unit * abs(self._per_unit[k]))),
                )
            )
        return records

    def _increments(self) -> list[float]:
        """Drive increments per joint turn (revolute) or metre (prismatic)."""
        given = self.options.increments
        n = self.chain.joint_count
        motors = [k for k in range(n) if k not in self.chain.passive]
        least, most = layout.INCREMENTS_PER_UNIT
        if given is not None:
            if len(given) not in (1, len(motors)) or not all(least <= abs(value) <= most for value in given):
                numbers = "1 number" if len(motors) == 1 else f"1 or {len(motors)} numbers"
                raise InputError(
                    f"--increments: found {', '.join(f'{value:.10g}' for value in given) or 'none'}, expected "
                    f"{numbers} from {least:.10g} to {most:.10g}, negative where a drive counts against its joint"
                )
            # A passive joint has no drive, but its record needs a value.
            per_unit = np.full(n, float(_INCREMENTS_PER_UNIT))
            per_unit[motors] = given
            return [float(value) for value in per_unit]
        made = []
        for k, (slides, ratio) in enumerate(zip(self.chain.prismatic, self.chain.gear_ratio, strict=True)):
            count = float(
                _INCREMENTS_PER_MOTOR_TURN * abs(ratio) if ratio and not slides else _INCREMENTS_PER_UNIT
            )
            if not least <= count <= most:
                raise InputError(
                    f"{self.path}: joint {k + 1} has gear_ratio {ratio:g}, which makes {count:.10g} increments a "
                    f"turn, expected {least:.10g} to {most:.10g}; give the drives' own with --increments"
                )
            made.append(count)
            if ratio is not None and ratio < 0.0:
                self.notes.append(
                    f"joint {k + 1} has gear_ratio {ratio:g}: its drive is taken to count up as the joint's angle "
                    "grows; if it counts down, export with --increments and a minus for this joint"
                )
        return made

    def _say_what_is_cut(self) -> None:
        """Note the options that are outside what the firmware allows any table."""
        least = layout.DAMPING[0]
        if self.options.damping_m is not None and self.options.damping_m < least:
            self.notes.append(
                f"--damping {self.options.damping_m:g} is raised to {least:.3g} m/rad, "
                "the least that the firmware allows"
            )
        asked = [("--max-rate", self.options.max_rate, layout.MAX_RATE, ("rad/s", "m/s"))]
        if self.options.max_correction is not None:
            asked.append(("--max-correction", self.options.max_correction, layout.MAX_DELTA, ("rad", "m")))
        for name, value, most, units in asked:
            for slides in sorted(set(self.chain.prismatic)):
                cap = most[slides] * (1.0 if slides else 2.0 * np.pi)
                if value > cap:
                    joints = "sliding" if slides else "turning"
                    self.notes.append(
                        f"{name} {value:g} is cut to {cap:.3g} {units[slides]} on {joints} joints, "
                        "the most that the firmware allows"
                    )

    def _magnitude_limits(self) -> Array:
        """Largest correction of each joint [rad or m]."""
        n = self.chain.joint_count
        if self.options.max_correction is not None:
            return np.full(n, self.options.max_correction)
        reference = Reference(self.arm, self.tool)
        poses = self._random_poses(2)
        warm = np.full(len(poses), self.chain.temperature_reference + 15.0)
        around = Surroundings(
            dict.fromkeys(self.chain.sensors, warm),
            payload=np.where(np.arange(len(poses)) % 2 == 0, 0.0, self.payload_max_kg),
            time=np.where(np.arange(len(poses)) % 3 == 0, 0.0, 4e4),
            direction=np.random.default_rng(3).choice([-1.0, 1.0], poses.shape),
        )
        correction = np.abs(reference.newton_joints(poses, around, self.rotation_length_m) - poses)
        # Close to singularities corrections grow without bound, so all but one in a thousand are covered. Their last
        # digits depend on rounding; whole steps give the same image on every processor.
        covered = 2.0 * np.quantile(correction, 0.999, axis=0) + 2e-3
        return np.asarray(
            np.minimum(np.ceil(covered / _CORRECTION_STEP) * _CORRECTION_STEP, _LARGEST_CORRECTION)
        )

    def _coupling(self) -> list[bytes]:
        records = []
        for row, column in np.argwhere(self.chain.coupling - np.diag(np.diag(self.chain.coupling))):
            what = f"a coupling of joint {row + 1} to motor {column + 1}"
            ratio = _held(self.chain.coupling[row, column], layout.COUPLING_FRACTION, what)
            records.append(layout.COUPLING.pack(row, column, 0, ratio))
        return records

    def _tools(self) -> list[bytes]:
        self._refuse_more_than(layout.MAX_TOOLS, len(self.arm.flange_from_tool), "tools")
        return [
            layout.TOOL.pack(
                *self._transform(self.chain.end @ pose), self._name(name, layout.TOOL_NAME_LENGTH, "target")
            )
            for name, pose in self.arm.flange_from_tool.items()
        ]

    def _sensors(self) -> list[bytes]:
        reference = round(1000.0 * self.chain.temperature_reference)
        length = layout.SENSOR_NAME_LENGTH
        return [
            layout.SENSOR.pack(reference, self._name(sensor, length, "sensor"))
            for sensor in self.chain.sensors
        ]

    def _name(self, name: str, most: int, what: str) -> bytes:
        encoded = name.encode()
        if len(encoded) > most:
            raise InputError(f"{self.path}: found {what} '{name}', expected a name of at most {most} bytes")
        return encoded

    def _mass_sets(self) -> list[bytes]:
        records = []
        where = layout.ACTS_AT_COMMAND if self.arm.loads_act_at_command else 0
        for mass_set in self.gravity.sets:
            record = layout.MASS_SET_HEAD.pack(
                mass_set.fraction, where | (layout.CARRIES_PAYLOAD if mass_set.carries_payload else 0), 0
            )
            for mass, moment in zip(mass_set.masses, mass_set.moments, strict=True):
                record += layout.MASS_SET_LINK.pack(
                    _held(mass, mass_set.fraction, "a mass"),
                    *(_held(v, mass_set.fraction, "a mass moment") for v in moment),
                )
            records.append(record)
        return records

    def _gravity(self) -> list[bytes]:
        if not self.gravity.sets:
            return []
        vector = [_held(v, layout.LENGTH_FRACTION, "gravity in m/s²") for v in self.chain.gravity]
        point = [_held(v, layout.LENGTH_FRACTION, "a payload point in m") for v in self.gravity.payload_point]
        limit = to_fixed(min(self.payload_max_kg, 2000.0), layout.STATE_FRACTION[State.PAYLOAD])
        return [layout.GRAVITY.pack(*vector, *point, limit)]


@contextmanager
def _naming(what: str) -> Iterator[None]:
    """Begin the message of an error with `what` a table cannot hold, and end it with a remedy."""
    try:
        yield
    except (CannotCompileError, OverflowError) as error:
        raise CannotCompileError(f"{what}: {error}; {_REMEDY}") from None


def _held(value: float, fraction: int, what: str) -> int:
    """`value` with `fraction` bits. Raises CannotCompileError, naming `what` it is, where 32 bits do not hold it."""
    try:
        return to_fixed(value, fraction)
    except OverflowError:
        raise CannotCompileError(
            f"{what} of {value:g}, expected less than {2.0 ** (31 - fraction):g}; correct robot.yaml and fit again"
        ) from None


def _grid_slope(grid: Grid) -> float:
    """Largest slope of a table along any of its axes."""
    steps = [
        np.abs(np.diff(grid.values, axis=a)).max(initial=0.0) / np.diff(axis.nodes).min()
        for a, axis in enumerate(grid.axes)
    ]
    return float(max(steps))
