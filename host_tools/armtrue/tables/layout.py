"""The layout of a table image: docs/table-format.md in code, the writer's side of firmware/core/table/format.h."""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Any

MAGIC = b"ATBL"
VERSION = 1
HEADER = struct.Struct("<4sHHIIIBBBB24s32sBBHIIHHHHHH")
HEADER_FIELDS = (
    "magic", "version", "header_length", "length", "flags", "sequence", "joint_count", "sensor_count", "tool_count",
    "section_count", "serial", "fit_digest", "active_tool", "reserved", "blend_ms", "damping", "rotation_length",
    "constant_nodes", "steep_nodes", "constant_terms", "steep_terms", "steep_harmonics", "reserved2",
)  # fmt: skip
DIRECTORY_ENTRY = struct.Struct("<HHI")
CHECKSUM = struct.Struct("<I")
SIGNATURE_LENGTH = 64
SERIAL_LENGTH = 24
TOOL_NAME_LENGTH = 32
SENSOR_NAME_LENGTH = 28

FLAG_SIGNED = 1
FLAG_FULL_POSE = 2


def header_of(image: bytes) -> dict[str, Any]:
    """The raw values of the header, by HEADER_FIELDS."""
    return dict(zip(HEADER_FIELDS, HEADER.unpack_from(image), strict=True))


class Section(IntEnum):
    """Kinds of sections, in the order in which they stand."""

    JOINTS = 1
    TOOLS = 2
    COUPLING = 3
    STATE = 4
    SENSORS = 5
    MASS_SETS = 6
    GRAVITY = 7
    NODES = 8
    TERMS = 9
    HARMONICS = 10
    SLOW_WAVES = 11
    DATA = 12
    BASE = 13


JOINT = struct.Struct("<9i3iqiiiBBBBiii")
PASSIVE = 1  # a flag of a joint: it has no drive
TOOL = struct.Struct("<9i3i32s")
COUPLING = struct.Struct("<BBHi")
STATE = struct.Struct("<BBBb")
SENSOR = struct.Struct("<i28s")
MASS_SET_HEAD = struct.Struct("<BBH")
MASS_SET_LINK = struct.Struct("<4i")
GRAVITY = struct.Struct("<3i3ii")
NODE = struct.Struct("<BbbBHHii")
TERM = struct.Struct("<BBHi")
HARMONIC = struct.Struct("<BBHiIi")
SLOW_WAVE = struct.Struct("<BBHiiii")
BASE = struct.Struct("<9d3d")
GRID_HEAD = struct.Struct("<BBH")
GRID_AXIS = struct.Struct("<HHB3x")

RATIO_FRACTION = 30
LENGTH_FRACTION = 27
COORDINATE_FRACTION = 30
TERM_SHIFT = 32  # coordinate += mantissa · slot / 2^32
POSITION_FRACTION = 32  # of joint positions, turn or metre
COUPLING_FRACTION = 28
ORDER_FRACTION = 20
GRID_FRACTION = 20
GRID_VALUE_FRACTION = 12

NONE = 0xFFFF
LINK_ANGLE = 0x100
CARRIES_PAYLOAD = 1
ACTS_AT_COMMAND = 2

AXIS_EXPLICIT = 1
AXIS_HOLD_LOW = 2
AXIS_HOLD_HIGH = 4

MAX_JOINTS = 8
MAX_TOOLS = 4
MAX_SENSORS = 8
MAX_MASS_SETS = 32
MAX_SLOTS = 384
MAX_TERMS = 512
MAX_HARMONICS = 192
MAX_SLOW_WAVES = 64
MAX_SLOW_WAVE = 0.125  # rad or m
MAX_GRID_AXES = 4
MAX_GRID_NODES = 8192
MAX_GRID_OUTPUTS = 8
MAX_IMAGE_LENGTH = 16 * 1024
MAX_SEQUENCE = 2**32 - 1

# Drive increments of a turn or a metre, without sign: the fewest and the most.
INCREMENTS_PER_UNIT = (2.0**4, 2.0**31)
DAMPING = (2.0**-8, 1.0)  # m/rad, least and most
# Compile-time caps of the firmware (limits.h) by whether a joint is prismatic: turn or m, and the same per second.
MAX_DELTA = {False: 0.05, True: 0.1}
MAX_RATE = {False: 0.1, True: 0.2}


class State(IntEnum):
    """Kinds of state variables."""

    ONE = 0
    MOTOR = 1
    LINK = 2
    TORQUE = 3
    MOMENT_X = 4
    MOMENT_Y = 5
    BASE_MOMENT_X = 6
    BASE_MOMENT_Y = 7
    TEMPERATURE = 8
    PAYLOAD = 9
    DIRECTION = 10
    TIME = 11


STATE_FRACTION = {
    State.ONE: 30,
    State.MOTOR: 28,
    State.LINK: 28,
    State.TEMPERATURE: 20,
    State.PAYLOAD: 20,
    State.DIRECTION: 30,
    State.TIME: 10,
}
GRAVITY_KINDS = (State.TORQUE, State.MOMENT_X, State.MOMENT_Y, State.BASE_MOMENT_X, State.BASE_MOMENT_Y)
POSITION_KINDS = (State.MOTOR, State.LINK)


def state_class(kind: State) -> int:
    """Rank of a state variable in the section: 0 constant during a cycle, 1 joint positions, 2 gravity."""
    return 1 if kind in POSITION_KINDS else 2 if kind in GRAVITY_KINDS else 0


class Node(IntEnum):
    """Kinds of nodes."""

    CONTINUATION = 0
    HARMONIC = 1
    ANGLE = 2
    TO_ANGLE = 3
    SINE = 4
    PRODUCT = 5
    SUM = 6
    SCALE = 7
    RECIPROCAL = 8
    ABSOLUTE = 9
    SIGN = 10
    MINIMUM = 11
    MAXIMUM = 12
    SPLINE = 13
    GRID = 14
    POWER_OF_TWO = 15


# Coordinates: motor side of joint k is k; axis c of the virtual joint f is 8 + 6 f + c.
COMPONENTS = ("tx", "ty", "tz", "rx", "ry", "rz")
TOOL_FRAME = 9
COORDINATES = 8 + 6 * 10


def coordinate_number(name: str) -> int:
    """Number of a coordinate named as in docs/model.md; `tool[T].tx` counts as `tool.tx`."""
    if name.startswith("motor"):
        return int(name[5:]) - 1
    frame, component = name.rsplit(".", 1)
    if frame == "base":
        number = 0
    elif frame.startswith("link"):
        number = int(frame[4:])
    else:
        number = TOOL_FRAME
    return 8 + 6 * number + COMPONENTS.index(component)


def coordinate_name(number: int) -> str:
    """Name of a coordinate, the inverse of `coordinate_number`."""
    if number < MAX_JOINTS:
        return f"motor{number + 1}"
    frame, component = divmod(number - 8, 6)
    stem = "base" if frame == 0 else "tool" if frame == TOOL_FRAME else f"link{frame}"
    return f"{stem}.{COMPONENTS[component]}"
