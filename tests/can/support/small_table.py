"""A small real table image: each joint's correction is amplitude · sin(its angle)."""

from __future__ import annotations

import struct
import zlib

from armtrue.tables import layout
from armtrue.tables.layout import Section

_IDENTITY = (1 << 30, 0, 0, 0, 1 << 30, 0, 0, 0, 1 << 30)
# 2^20 increments a turn, as in docs/table-format.md: 2^30 / 2^18 units of 2^-32 turn per increment, and the inverse.
_SCALE = (1 << 30, 1 << 30, 18, 42)


def small_table(
    joints: int = 6,
    sequence: int = 1,
    serial: str = "",
    amplitude: int = 1 << 22,
    magnitude: int = 214748365,
    rate: int = 429496730,
    padding: int = 0,
) -> bytes:
    """An unsigned image. `padding`: further bytes of an unused data section, to reach a size."""
    unit, increment, unit_shift, increment_shift = _SCALE
    step = (1 << 24, 1 << 24, 1 << 24)
    joint = layout.JOINT.pack(
        *_IDENTITY, *step, 0, 0, unit, increment, unit_shift, increment_shift, 0, 0, magnitude, rate, 0
    )
    sections = {
        Section.JOINTS: (joints, joint * joints),
        Section.TOOLS: (1, layout.TOOL.pack(*_IDENTITY, *step, b"")),
        Section.STATE: (1, layout.STATE.pack(0, 0, 0, 30)),
        Section.HARMONICS: (
            joints,
            b"".join(
                layout.HARMONIC.pack(k, 0, k, 1 << layout.ORDER_FRACTION, 0, amplitude) for k in range(joints)
            ),
        ),
    }
    if padding:
        sections[Section.DATA] = (padding // 4, bytes(padding // 4 * 4))
    offset = layout.HEADER.size + len(sections) * layout.DIRECTORY_ENTRY.size
    directory = b""
    for kind, (count, body) in sections.items():
        directory += layout.DIRECTORY_ENTRY.pack(kind, count, offset)
        offset += len(body)
    length = offset + layout.CHECKSUM.size
    fields = [
        layout.MAGIC, layout.VERSION, layout.HEADER.size, length, 0, sequence, joints, 0, 1, len(sections),
        serial.encode("ascii"), bytes(32), 0, 0, 20, 1 << 24,
    ]  # fmt: skip
    unused = len(layout.HEADER.unpack(bytes(layout.HEADER.size))) - len(fields)
    header = layout.HEADER.pack(*fields, *[0] * unused)
    image = header + directory + b"".join(body for _, body in sections.values())
    return image + struct.pack("<I", zlib.crc32(image))
