"""Tables that no exporter makes: many records of one kind, at the limits of what a signed table may hold.

Each is built record by record from docs/table-format.md, so that the worst cost of a cycle can be measured for each
kind of record.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field

from armtrue.tables import layout
from armtrue.tables.layout import Node, Section, State

_IDENTITY = (1 << 30, 0, 0, 0, 1 << 30, 0, 0, 0, 1 << 30)
# Unit rows, none of them a turn about x alone: every rotation takes the general path.
_GENERAL = (858993459, 644245094, 0, -644245094, 858993459, 0, 0, 0, 1 << 30)
_RATE = 429496730
_MAGNITUDE = 214748365


@dataclass
class Table:
    """Records by section, and the header's counts of constant and steep records, which stand first."""

    joints: int = 6
    full_pose: bool = False
    general: bool = True  # rotations that are not about x
    constant_nodes: int = 0
    steep_nodes: int = 0
    constant_terms: int = 0
    steep_terms: int = 0
    steep_harmonics: int = 0
    prismatic: int = 0  # bits
    records: dict[Section, list[bytes]] = field(default_factory=dict)

    def add(self, kind: Section, *records: bytes) -> None:
        """Append records to a section."""
        self.records.setdefault(kind, []).extend(records)

    def add_state(self, kind: State, index: int = 0, mass_set: int = 0, fraction: int | None = None) -> int:
        """Append a state variable; returns its slot."""
        bits = layout.STATE_FRACTION.get(kind, 20) if fraction is None else fraction
        self.add(Section.STATE, layout.STATE.pack(kind, index, mass_set, bits))
        return len(self.records[Section.STATE]) - 1

    def add_data(self, content: bytes) -> int:
        """Append words to the data section; returns the number of the first."""
        words = self.records.setdefault(Section.DATA, [])
        first = len(words)
        content += bytes(-len(content) % 4)
        words.extend(content[i : i + 4] for i in range(0, len(content), 4))
        return first

    def image(self) -> bytes:
        """The unsigned image."""
        rotation = _GENERAL if self.general else _IDENTITY
        joints = [
            layout.JOINT.pack(*rotation, 1 << 24, 1 << 24, 1 << 24, 0, 0, 1 << 30, 1 << 30, 18, 42,
                              self.prismatic >> k & 1, 0, _MAGNITUDE, _RATE, 0)
            for k in range(self.joints)
        ]  # fmt: skip
        sections = {
            Section.JOINTS: joints,
            Section.TOOLS: [layout.TOOL.pack(*rotation, 1 << 24, 0, 0, b"")],
            **self.records,
        }
        offset = layout.HEADER.size + len(sections) * layout.DIRECTORY_ENTRY.size
        directory, body = b"", b""
        for kind in sorted(sections):
            directory += layout.DIRECTORY_ENTRY.pack(kind, len(sections[kind]), offset + len(body))
            body += b"".join(sections[kind])
        header = layout.HEADER.pack(
            layout.MAGIC, layout.VERSION, layout.HEADER.size, offset + len(body) + 4,
            layout.FLAG_FULL_POSE if self.full_pose else 0, 1, self.joints,
            len(sections.get(Section.SENSORS, [])), 1, len(sections), b"", bytes(32), 0, 0, 20, 1 << 24,
            1 << 25 if self.full_pose else 0, self.constant_nodes, self.steep_nodes, self.constant_terms,
            self.steep_terms, self.steep_harmonics, 0,
        )  # fmt: skip
        image = header + directory + body
        return image + struct.pack("<I", zlib.crc32(image))


def plain(joints: int = 6, full_pose: bool = False, **options: int | bool) -> Table:
    """A table with nothing in it but the arm and the constant 1."""
    table = Table(joints=joints, full_pose=full_pose, **options)  # type: ignore[arg-type]
    table.add_state(State.ONE)
    return table


def _mass_set(joints: int, flags: int) -> bytes:
    return layout.MASS_SET_HEAD.pack(20, flags, 0) + b"".join(
        layout.MASS_SET_LINK.pack(1 << 20, 1 << 18, -(1 << 18), 1 << 18) for _ in range(joints)
    )


def _with_gravity(table: Table, sets: int, flags: int = layout.CARRIES_PAYLOAD) -> None:
    table.add(Section.MASS_SETS, *[_mass_set(table.joints, flags)] * sets)
    table.add(Section.GRAVITY, layout.GRAVITY.pack(0, 0, -1316660838, 1 << 24, 0, 0, 50 << 20))


def gravity(
    kind: State, alternating: bool, flags: int = layout.CARRIES_PAYLOAD
) -> Callable[[Table, int], None]:
    """Gravity variables of one mass set, or of two sets in turn, so that each variable sums its masses again."""

    def add(table: Table, count: int) -> None:
        _with_gravity(table, 2, flags)
        for i in range(count):
            base = kind in (State.BASE_MOMENT_X, State.BASE_MOMENT_Y)
            table.add_state(kind, 0 if base else i % table.joints, i % 2 if alternating else 0)

    return add


def torque_with_coupling(table: Table, count: int) -> None:
    """Torques of the one motor that drives all other joints."""
    for row in range(1, table.joints):
        table.add(Section.COUPLING, layout.COUPLING.pack(row, 0, 0, 1 << 28))
    _with_gravity(table, 1)
    for _ in range(count):
        table.add_state(State.TORQUE, 0)


def coupling(table: Table, count: int) -> None:
    """Couplings, each of another pair of joints."""
    pairs = [(r, c) for c in range(table.joints) for r in range(table.joints) if r != c]
    for row, column in pairs[:count]:
        table.add(Section.COUPLING, layout.COUPLING.pack(row, column, 0, 1 << 26))


def node(part: str, make: Callable[[Table, int, int], bytes]) -> Callable[[Table, int], None]:
    """`count` nodes of one kind in a part of the list; `make(table, slot that it may read, number)` packs one."""

    def add(table: Table, count: int) -> None:
        slot = 0 if part == "constant" else table.add_state(State.MOTOR, 0)
        content = b"".join(make(table, slot, i) for i in range(count))
        made = [content[i : i + layout.NODE.size] for i in range(0, len(content), layout.NODE.size)]
        table.add(Section.NODES, *made)
        if part == "constant":
            table.constant_nodes = table.steep_nodes = len(made)
        elif part == "steep":
            table.steep_nodes = len(made)

    return add


def simple(
    kind: Node,
    shift: int = 0,
    shift2: int = 0,
    p: int = 0,
    r: int = 0,
    *,
    b: bool = False,
    source: bool = False,
) -> Callable[[Table, int, int], bytes]:
    """A node without data."""

    def make(_table: Table, slot: int, _number: int) -> bytes:
        second = slot if b else layout.NONE if kind == Node.ANGLE else 0
        return layout.NODE.pack(kind, shift, shift2, 0, layout.LINK_ANGLE if source else slot, second, p, r)

    return make


def angle_with_slot(_table: Table, slot: int, _number: int) -> bytes:
    """An angle that a slot is added to."""
    return layout.NODE.pack(Node.ANGLE, 0, 0, 0, layout.LINK_ANGLE, slot, 12345678, 77)


def spline(table: Table, slot: int, _number: int) -> bytes:
    """A cubic of one cell; all nodes share its data."""
    if Section.DATA not in table.records:
        table.add_data(struct.pack("<4i", 1 << 29, -(1 << 29), 1 << 29, 1 << 29))
    return layout.NODE.pack(Node.SPLINE, 10, 0, 1, slot, 0, -5000, 0)


def grid(axes: int, outputs: int, nodes: int, explicit: bool) -> Callable[[Table, int, int], bytes]:
    """A fully covered grid whose data all nodes share; with several outputs, continuation records follow it."""

    def make(table: Table, slot: int, _number: int) -> bytes:
        if Section.DATA not in table.records:
            content = layout.GRID_HEAD.pack(axes, outputs, 0)
            for _ in range(axes):
                content += layout.GRID_AXIS.pack(slot, nodes, layout.AXIS_EXPLICIT if explicit else 0)
                if explicit:
                    # Over the whole range, so that the cell must be searched for at any value of the slot.
                    content += struct.pack(
                        f"<{nodes}i", *[-(1 << 31) + i * ((1 << 32) // nodes) for i in range(nodes)]
                    )
                    content += struct.pack(f"<{nodes - 1}I", *[(1 << 31) + 1] * (nodes - 1))
                else:
                    content += struct.pack("<iI", -nodes << 26, 1 << 24)
            total = nodes**axes
            content += b"\xff" * (4 * -(-total // 32))
            content += struct.pack(
                f"<{total * outputs}h", *[(-1) ** i * 32000 for i in range(total * outputs)]
            )
            table.add_data(content)
        continued = layout.NODE.pack(0, 0, 0, 0, 0, 0, 0, 0) * (outputs - 1)
        return layout.NODE.pack(Node.GRID, 0, 0, outputs, 0, 0, 0, 0) + continued

    return make


def states(kind: State) -> Callable[[Table, int], None]:
    """State variables of one kind."""

    def add(table: Table, count: int) -> None:
        for i in range(count):
            table.add_state(
                kind, i % table.joints if kind in (*layout.POSITION_KINDS, State.DIRECTION) else 0
            )

    return add


def term(part: str) -> Callable[[Table, int], None]:
    """Terms in a part of the list."""

    def add(table: Table, count: int) -> None:
        # The constant 1 is folded at load where it stands first; an approach direction is not.
        slot = table.add_state(State.DIRECTION, 0)
        table.add(
            Section.TERMS, *[layout.TERM.pack(i % table.joints, 0, slot, 1 << 10) for i in range(count)]
        )
        if part == "constant":
            table.constant_terms = table.steep_terms = count
        elif part == "steep":
            table.steep_terms = count

    return add


def harmonic(steep: bool) -> Callable[[Table, int], None]:
    """Harmonics of link angles."""

    def add(table: Table, count: int) -> None:
        table.add(
            Section.HARMONICS,
            *[layout.HARMONIC.pack(i % table.joints, 0, layout.LINK_ANGLE + i % table.joints, 3 << 20, 5, 1 << 12)
              for i in range(count)],
        )  # fmt: skip
        table.steep_harmonics = count if steep else 0

    return add


def slow_wave(table: Table, count: int) -> None:
    """Slow waves on motor sides."""
    table.add(
        Section.SLOW_WAVES,
        *[layout.SLOW_WAVE.pack(i % table.joints, i % table.joints, 0, 1 << 12, 1 << 12, 1 << 12, 1 << 12)
          for i in range(count)],
    )  # fmt: skip


def frames(table: Table, count: int) -> None:
    """`count` virtual joints (base, links, tool) that turn further than the second-order approximation covers."""
    places = [*range(table.joints + 1), layout.TOOL_FRAME][:count]
    for place in places:
        table.add(Section.TERMS, layout.TERM.pack(8 + 6 * place + 3, 0, 0, 1 << 29))
    table.constant_terms = table.steep_terms = len(places)


def sensors(table: Table, count: int) -> None:
    """Temperature sensors, each read once; at most 100, which is more than the format allows."""
    for i in range(min(count, 100)):
        table.add(Section.SENSORS, layout.SENSOR.pack(20_000, b"s"))
        table.add_state(State.TEMPERATURE, i)


def _kinds() -> dict[str, Callable[[Table, int], None]]:
    """By name of each kind of record and node: a function that adds `count` of them to a table in the costliest way."""
    kinds: dict[str, Callable[[Table, int], None]] = {
        "direction": states(State.DIRECTION),
        "motor position": states(State.MOTOR),
        "link position": states(State.LINK),
        "torque": gravity(State.TORQUE, False),
        "moment": gravity(State.MOMENT_X, False),
        "base moment": gravity(State.BASE_MOMENT_Y, False),
        "torques of sets in turn": gravity(State.TORQUE, True),
        "torques of sets in turn, at the command": gravity(
            State.TORQUE, True, layout.CARRIES_PAYLOAD | layout.ACTS_AT_COMMAND
        ),
        "torques of a motor that drives all": torque_with_coupling,
        "coupling": coupling,
        "sensor": sensors,
        "frame": frames,
        "constant term": term("constant"),
        "steep term": term("steep"),
        "smooth term": term("smooth"),
        "steep harmonic": harmonic(True),
        "smooth harmonic": harmonic(False),
        "slow wave": slow_wave,
    }
    makers: dict[str, Callable[[Table, int, int], bytes]] = {
        "product": simple(Node.PRODUCT, b=True),
        "sum": simple(Node.SUM, shift=3, shift2=3, b=True),
        "scale": simple(Node.SCALE, shift=20, p=1 << 30, r=-5),
        "to angle": simple(Node.TO_ANGLE, shift=20, p=1 << 30, r=5),
        "sine": simple(Node.SINE, r=5),
        "reciprocal": simple(Node.RECIPROCAL, shift=31),
        "absolute": simple(Node.ABSOLUTE),
        "sign": simple(Node.SIGN),
        "minimum": simple(Node.MINIMUM, b=True),
        "maximum": simple(Node.MAXIMUM, b=True),
        "power of two": simple(Node.POWER_OF_TWO, shift=30, p=30),
        "spline": spline,
        "line": grid(1, 1, 4, False),
        "listed line": grid(1, 1, 1000, True),
        "grid of 1 axis and 8 outputs": grid(1, 8, 4, False),
        "grid of 2 listed axes": grid(2, 1, 30, True),
        "grid of 3 axes and 2 outputs": grid(3, 2, 4, False),
        "grid of 4 axes": grid(4, 1, 3, False),
        "grid of 4 listed axes": grid(4, 1, 2, True),
        "grid of 4 axes and 8 outputs": grid(4, 8, 3, False),
    }
    moving = {
        "harmonic node": simple(Node.HARMONIC, p=99999999, r=5, source=True),
        "angle": simple(Node.ANGLE, p=99999999, r=5, source=True),
        "angle with slot": angle_with_slot,
    }
    for part in ("constant", "steep", "smooth"):
        for name, make in (makers if part == "constant" else makers | moving).items():
            kinds[f"{part} {name}"] = node(part, make)
    return kinds


KINDS = _kinds()


def fullest(kind: str, joints: int, full_pose: bool, accepted: Callable[[bytes], bool]) -> bytes:
    """The image with the most records of `kind` that `accepted` takes."""

    def image(count: int) -> bytes:
        table = plain(joints, full_pose)
        KINDS[kind](table, count)
        return table.image()

    low, high = 1, 600
    assert accepted(image(low)), kind
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if accepted(image(middle)) else (low, middle)
    return image(low)
