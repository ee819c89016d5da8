"""Reader of table images on the host, for `tables info` and `compensate`."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.io.files import read_bytes
from armtrue.tables import layout
from armtrue.tables.chain import Chain, transform
from armtrue.tables.fixed import cycle_budget, cycle_cost, validate
from armtrue.tables.layout import Node, Section, State

# Largest file that is read; no device holds more.
LARGEST_IMAGE_BYTES = 16 * 1024 * 1024


_STATE_NAMES = {
    State.ONE: "1", State.MOTOR: "q", State.LINK: "th", State.TORQUE: "tau", State.MOMENT_X: "gmx",
    State.MOMENT_Y: "gmy", State.BASE_MOMENT_X: "bmx", State.BASE_MOMENT_Y: "bmy", State.PAYLOAD: "payload",
    State.DIRECTION: "dir", State.TIME: "time",
}  # fmt: skip
_OF_THE_ARM = (State.ONE, State.BASE_MOMENT_X, State.BASE_MOMENT_Y, State.PAYLOAD, State.TIME)


@dataclass(frozen=True)
class JointRecord:
    """A joint's record in SI units (rad or m)."""

    fixed: Array
    offset: float
    prismatic: bool
    passive: bool  # without a drive
    increments: float  # per rad or m
    magnitude: float
    rate: float
    dead_band_increments: int


@dataclass(frozen=True)
class GridRecord:
    """A multilinear table: its node number, axes (slot, nodes), and stored integers (nodes of axis 1, …, outputs)."""

    node: int
    axes: list[tuple[int, Array]]
    values: NDArray[np.int16]
    covered: NDArray[np.bool_]


class Image:
    """A validated image. `bytes` is the file; records are decoded on demand."""

    def __init__(self, content: bytes, path: object = "tables") -> None:
        verdict = validate(content)
        if not verdict.accepted:
            raise InputError(
                f"{path}: found {verdict.reason} (byte {verdict.field}), expected a table image made by armtrue export"
            )
        self.bytes = content
        self.header = layout.header_of(content)
        self._sections: dict[Section, tuple[int, int]] = {}
        for i in range(self.header["section_count"]):
            kind, count, offset = layout.DIRECTORY_ENTRY.unpack_from(
                content, layout.HEADER.size + i * layout.DIRECTORY_ENTRY.size
            )
            self._sections[Section(kind)] = (count, offset)

    @classmethod
    def load(cls, path: Path) -> Image:
        """Read and validate a file. Errors: InputError naming what a device would refuse."""
        return cls(read_bytes(path, LARGEST_IMAGE_BYTES), path)

    @property
    def joint_count(self) -> int:
        """Number of joints."""
        return int(self.header["joint_count"])

    @property
    def serial(self) -> str:
        """The robot that the table is for."""
        return str(self.header["serial"].rstrip(b"\0").decode())

    @property
    def is_signed(self) -> bool:
        """True where the image carries a signature."""
        return bool(self.header["flags"] & layout.FLAG_SIGNED)

    @property
    def is_full_pose(self) -> bool:
        """True where the correction holds the attitude as well as the position."""
        return bool(self.header["flags"] & layout.FLAG_FULL_POSE)

    @property
    def rotation_length_m(self) -> float | None:
        """Metres that weigh as one radian; None for position only."""
        return self.header["rotation_length"] * 2.0**-layout.LENGTH_FRACTION if self.is_full_pose else None

    @property
    def damping_m(self) -> float:
        """λ, metre per radian."""
        return float(self.header["damping"] * 2.0**-layout.LENGTH_FRACTION)

    def records(self, kind: Section, record: struct.Struct) -> list[tuple[Any, ...]]:
        """The records of a section with fixed record length."""
        count, offset = self._sections.get(kind, (0, 0))
        return [record.unpack_from(self.bytes, offset + i * record.size) for i in range(count)]

    def count(self, kind: Section) -> int:
        """Number of records of a section; 0 where it is absent."""
        return self._sections.get(kind, (0, 0))[0]

    def section_bytes(self) -> dict[Section, int]:
        """Bytes of every section that is there."""
        starts = sorted((offset, kind) for kind, (_, offset) in self._sections.items())
        trailer = layout.CHECKSUM.size + (layout.SIGNATURE_LENGTH if self.is_signed else 0)
        ends = [offset for offset, _ in starts[1:]] + [len(self.bytes) - trailer]
        return {kind: end - offset for (offset, kind), end in zip(starts, ends, strict=True)}

    def joints(self) -> list[JointRecord]:
        """The joints."""
        result = []
        for record in self.records(Section.JOINTS, layout.JOINT):
            offset, _, _, per_unit, _, shift, kind, flags, magnitude, rate, band = record[12:]
            unit = 1.0 if kind else 2.0 * np.pi
            result.append(
                JointRecord(
                    fixed=_transform(record[:12]),
                    offset=offset * 2.0**-32 * unit,
                    prismatic=bool(kind),
                    passive=bool(flags & layout.PASSIVE),
                    increments=per_unit * 2.0 ** (32 - shift) / unit,
                    magnitude=magnitude * 2.0**-32 * unit,
                    rate=rate * 2.0**-32 * unit,
                    dead_band_increments=band,
                )
            )
        return result

    def tools(self) -> dict[str, Array]:
        """last_link_from_tool by name."""
        return {
            record[12].rstrip(b"\0").decode(): _transform(record[:12])
            for record in self.records(Section.TOOLS, layout.TOOL)
        }

    def sensors(self) -> dict[str, float]:
        """Sensors by name with their reference temperatures [°C]."""
        return {
            name.rstrip(b"\0").decode(): reference / 1000.0
            for reference, name in self.records(Section.SENSORS, layout.SENSOR)
        }

    def states(self) -> list[tuple[State, int, int, int]]:
        """State variables: kind, 0-based joint or sensor, mass set, fraction bits."""
        return [
            (State(kind), index, mass_set, fraction)
            for kind, index, mass_set, fraction in self.records(Section.STATE, layout.STATE)
        ]

    def _long_angle(self, slot: int) -> tuple[str, float] | None:
        """Joint variable and radian per unit of a slot that Builder.long_angle made; None for others."""
        first, nodes = self.count(Section.STATE), self.nodes()
        kind, shift, *_, scaled, _, factor, offset = nodes[slot - first]
        if kind is not Node.SCALE or offset or scaled < first:
            return None
        inner, *_, source, onto, order, phase = nodes[scaled - first]
        if inner is not Node.ANGLE or onto != layout.NONE or phase:
            return None
        return _angle_name(source), 2.0 * np.pi * 2.0 ** (shift + layout.ORDER_FRACTION - 32) / (
            factor * order
        )

    def state_name(self, slot: int) -> str:
        """Name of a state variable as docs/model.md has it; `node N` for a slot of the other nodes."""
        states = self.states()
        if slot >= len(states):
            found = self._long_angle(slot)
            return found[0] if found else f"node {slot - len(states)}"
        kind, index, mass_set, _ = states[slot]
        if kind is State.TEMPERATURE:
            return f"dT_{list(self.sensors())[index]}"
        own = "" if mass_set == 0 else f" of mass set {mass_set}"
        joint = "" if kind in _OF_THE_ARM else index + 1
        return f"{_STATE_NAMES[kind]}{joint}{own}"

    def needs(self) -> set[str]:
        """Columns that the table reads besides the joints: `temp_NAME`, `payload`, `time`, `dirK`."""
        names: set[str] = set()
        sensors, flags = list(self.sensors()), self._mass_set_flags()
        for kind, index, mass_set, _ in self.states():
            if kind is State.TEMPERATURE:
                names.add(f"temp_{sensors[index]}")
            elif kind in layout.GRAVITY_KINDS and flags[mass_set] & layout.CARRIES_PAYLOAD:
                names.add("payload")
            elif kind in (State.PAYLOAD, State.TIME):
                names.add(_STATE_NAMES[kind])
            elif kind is State.DIRECTION:
                names.add(f"dir{index + 1}")
        return names

    def _mass_set_flags(self) -> list[int]:
        count, offset = self._sections.get(Section.MASS_SETS, (0, 0))
        size = layout.MASS_SET_HEAD.size + self.joint_count * layout.MASS_SET_LINK.size
        return [layout.MASS_SET_HEAD.unpack_from(self.bytes, offset + i * size)[1] for i in range(count)]

    def loads_act_at(self) -> str | None:
        """Where the device evaluates gravity loads: "target", or the corrected "command"; None without masses."""
        flags = self._mass_set_flags()
        if not flags:
            return None
        return "command" if flags[0] & layout.ACTS_AT_COMMAND else "target"

    def measuring_from_base(self) -> Array:
        """The fitted base; the identity where the image does not carry it."""
        for record in self.records(Section.BASE, layout.BASE):
            return transform(record[9:], np.array(record[:9]).reshape(3, 3))
        return np.eye(4)

    def chain(self) -> Chain:
        """The nominal chain as the image holds it; its end is part of the transforms in `tools`."""
        joints = self.joints()
        n = len(joints)
        coupling = np.eye(n)
        for row, column, _, ratio in self.records(Section.COUPLING, layout.COUPLING):
            coupling[row, column] = ratio * 2.0**-layout.COUPLING_FRACTION
        sensors = self.sensors()
        return Chain(
            prismatic=[joint.prismatic for joint in joints],
            fixed=[joint.fixed for joint in joints],
            end=np.eye(4),
            offset=np.array([joint.offset for joint in joints]),
            coupling=coupling,
            limits=np.tile([-np.pi, np.pi], (n, 1)),
            gear_ratio=[None] * n,
            gravity=np.zeros(3),
            masses=None,
            coms=None,
            sensors=list(sensors),
            temperature_reference=next(iter(sensors.values()), 20.0),
            passive=frozenset(k for k, joint in enumerate(joints) if joint.passive),
        )

    def nodes(self) -> list[tuple[Any, ...]]:
        """Node records: kind, shift, shift2, count, a, b, p, r."""
        return [(Node(record[0]), *record[1:]) for record in self.records(Section.NODES, layout.NODE)]

    def terms(self) -> list[tuple[str, int, float]]:
        """Terms: coordinate, slot, factor on the slot's raw value [rad or m]."""
        return [
            (
                layout.coordinate_name(coordinate),
                slot,
                mantissa * 2.0 ** -(layout.TERM_SHIFT + layout.COORDINATE_FRACTION),
            )
            for coordinate, _, slot, mantissa in self.records(Section.TERMS, layout.TERM)
        ]

    def harmonics(self) -> list[tuple[str, str, float, float, float]]:
        """Harmonics: coordinate, joint variable, cycles a turn, phase [rad], amplitude [rad or m]."""
        result = []
        for coordinate, _, source, order, phase, amplitude in self.records(
            Section.HARMONICS, layout.HARMONIC
        ):
            result.append(
                (
                    layout.coordinate_name(coordinate),
                    _angle_name(source),
                    order * 2.0**-layout.ORDER_FRACTION,
                    phase * 2.0**-32 * 2.0 * np.pi,
                    amplitude * 2.0**-layout.TERM_SHIFT,
                )
            )
        return result

    def slow_waves(self) -> list[tuple[str, str, tuple[float, ...]]]:
        """Slow waves: coordinate, link angle, factors of sin θ, cos θ, sin 2θ, cos 2θ [rad or m]."""
        return [
            (
                layout.coordinate_name(coordinate),
                f"th{joint + 1}",
                tuple(factor * 2.0**-layout.TERM_SHIFT for factor in factors),
            )
            for coordinate, joint, _, *factors in self.records(Section.SLOW_WAVES, layout.SLOW_WAVE)
        ]

    def grids(self) -> list[GridRecord]:
        """Every table and grid."""
        _, start = self._sections.get(Section.DATA, (0, 0))
        states = self.states()
        result = []
        for number, node in enumerate(self.nodes()):
            if node[0] is not Node.GRID:
                continue
            at = start + 4 * node[7]
            axis_count, outputs, _ = layout.GRID_HEAD.unpack_from(self.bytes, at)
            at += layout.GRID_HEAD.size
            axes = []
            for _ in range(axis_count):
                slot, count, flags = layout.GRID_AXIS.unpack_from(self.bytes, at)
                at += layout.GRID_AXIS.size
                if slot < len(states):
                    unit = 2.0 ** -states[slot][3]
                else:
                    found = self._long_angle(slot)
                    unit = found[1] if found else 1.0
                if flags & layout.AXIS_EXPLICIT:
                    raw = np.array(struct.unpack_from(f"<{count}i", self.bytes, at), dtype=np.float64)
                    at += 8 * count - 4
                else:
                    first, inverse = struct.unpack_from("<iI", self.bytes, at)
                    raw = first + np.arange(count) * 2.0 ** (32 + layout.GRID_FRACTION) / inverse
                    at += 8
                axes.append((slot, raw * unit))
            shape = tuple(nodes.size for _, nodes in axes)
            size = int(np.prod(shape))
            mask_bytes = 4 * ((size + 31) // 32)
            mask = np.frombuffer(self.bytes, np.uint8, mask_bytes, at)
            covered = np.unpackbits(mask, bitorder="little")[:size].astype(np.bool_).reshape(shape)
            values = np.frombuffer(self.bytes, "<i2", size * outputs, at + mask_bytes)
            result.append(GridRecord(number, axes, values.reshape(*shape, outputs), covered))
        return result


def _angle_name(source: int) -> str:
    return f"{'th' if source >= layout.LINK_ANGLE else 'q'}{source % layout.LINK_ANGLE + 1}"


def _transform(record: tuple[int, ...]) -> Array:
    rotation = np.array(record[:9], dtype=np.float64).reshape(3, 3) * 2.0**-layout.RATIO_FRACTION
    return transform(np.array(record[9:12]) * 2.0**-layout.LENGTH_FRACTION, rotation)


def lever_m(image: Image, coordinate: str) -> float:
    """Largest displacement of the tool per unit of a coordinate: 1 for lengths, the arm beyond it for angles [m]."""
    number = layout.coordinate_number(coordinate)
    joints = image.joints()
    lengths = [float(np.linalg.norm(joint.fixed[:3, 3])) for joint in joints]
    tool = max(float(np.linalg.norm(tool[:3, 3])) for tool in image.tools().values())
    if number < layout.MAX_JOINTS:
        return 1.0 if joints[number].prismatic else sum(lengths[number + 1 :]) + tool
    frame, component = divmod(number - layout.MAX_JOINTS, 6)
    if component < 3:
        return 1.0
    return tool if frame == layout.TOOL_FRAME else sum(lengths[frame:]) + tool


def describe(image: Image) -> dict[str, Any]:
    """Everything that `armtrue tables info` prints."""
    header = image.header
    nodes = image.nodes()
    tools = list(image.tools())
    return {
        "format_version": header["version"],
        "bytes": len(image.bytes),
        "cycle_instructions": cycle_cost(image.bytes),
        "cycle_instructions_budget": cycle_budget(),
        "robot_serial": image.serial,
        "sequence": header["sequence"],
        "fit_sha256": header["fit_digest"].hex(),
        "signed": image.is_signed,
        "full_pose": image.is_full_pose,
        "blend_ms": header["blend_ms"],
        "damping_m_per_rad": image.damping_m,
        "rotation_length_m": image.rotation_length_m,
        "tools": tools,
        "active_tool": tools[header["active_tool"]],
        "sensors_reference_degc": image.sensors(),
        "needs": sorted(image.needs()),
        "loads_act_at": image.loads_act_at(),
        "joints": [
            {
                "type": "prismatic" if joint.prismatic else "revolute",
                "passive": joint.passive,
                "increments_per_unit": joint.increments,
                "increment_um_at_tool": 1e6 * lever_m(image, f"motor{k + 1}") / abs(joint.increments),
                "max_correction": joint.magnitude,
                "max_rate": joint.rate,
                "dead_band_increments": joint.dead_band_increments,
            }
            for k, joint in enumerate(image.joints())
        ],
        "counts": {
            "state_variables": image.count(Section.STATE),
            "nodes": len(nodes),
            "nodes_once_a_cycle": header["constant_nodes"],
            "terms": image.count(Section.TERMS),
            "terms_once_a_cycle": header["constant_terms"],
            "harmonics": image.count(Section.HARMONICS),
            "slow_waves": image.count(Section.SLOW_WAVES),
            "mass_sets": image.count(Section.MASS_SETS),
        },
        "section_bytes": {kind.name.lower(): size for kind, size in image.section_bytes().items()},
        "tables": _tables(image),
    }


def _tables(image: Image) -> list[dict[str, Any]]:
    """Tables and grids: axes, nodes, coverage, and half a unit of the last place in µm at the tool."""
    first_slot = image.count(Section.STATE)
    terms = image.terms()
    result = []
    for grid in image.grids():
        for output in range(grid.values.shape[-1]):
            slot = first_slot + grid.node + output
            for coordinate, _, factor in (term for term in terms if term[1] == slot):
                # A slot carries GRID_VALUE_FRACTION bits below the stored integer.
                unit = abs(factor) * 2.0**layout.GRID_VALUE_FRACTION
                result.append(
                    {
                        "coordinate": coordinate,
                        "axes": [
                            {
                                "variable": image.state_name(slot_of_axis),
                                "nodes": int(nodes.size),
                                "from": float(nodes[0]),
                                "to": float(nodes[-1]),
                            }
                            for slot_of_axis, nodes in grid.axes
                        ],
                        "covered": float(grid.covered.mean()),
                        "largest": float(np.abs(grid.values[..., output]).max() * unit),
                        "quantisation_um": 0.5e6 * unit * lever_m(image, coordinate),
                    }
                )
    return result
