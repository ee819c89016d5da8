"""Header and checksum of a table image, read on the host before a byte is sent."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path

from armtrue.errors import InputError
from armtrue.io.files import read_bytes
from armtrue.tables import layout
from armtrue.tables.image import LARGEST_IMAGE_BYTES


@dataclass(frozen=True)
class ImageInfo:
    """The header of a table image and its content."""

    path: Path
    data: bytes
    format_version: int
    joint_count: int
    sequence: int
    robot_serial: str
    is_signed: bool
    checksum: int  # CRC-32 of all bytes before it; the device reports the same of an image that it holds


def checksum_of(image: bytes) -> int:
    """CRC-32 of all but the checksum itself, as the device reports it."""
    return zlib.crc32(image[: -layout.CHECKSUM.size])


def own_checksum(image: bytes) -> int:
    """The checksum stored in an image."""
    return int.from_bytes(image[-layout.CHECKSUM.size :], "little")


def read_image(path: Path) -> ImageInfo:
    """Read and check the envelope of an image. Raises InputError naming file and field."""
    data = read_bytes(path, LARGEST_IMAGE_BYTES)
    least = layout.HEADER.size + layout.CHECKSUM.size
    if len(data) < least:
        raise InputError(f"{path}: {len(data)} bytes, expected a table image of at least {least}")
    header = layout.header_of(data)
    if header["magic"] != layout.MAGIC:
        raise InputError(
            f"{path}: begins with {header['magic']!r}, expected the {layout.MAGIC!r} of a table image"
        )
    if header["version"] != layout.VERSION or header["header_length"] != layout.HEADER.size:
        raise InputError(f"{path}: table format {header['version']}, expected {layout.VERSION}")
    if header["length"] != len(data):
        raise InputError(f"{path}: {len(data)} bytes, the header says {header['length']}")
    stored, computed = own_checksum(data), checksum_of(data)
    if stored != computed:
        raise InputError(f"{path}: checksum 0x{stored:08X}, expected 0x{computed:08X}: the file is damaged")
    return ImageInfo(
        path, data, header["version"], header["joint_count"], header["sequence"],
        header["serial"].rstrip(b"\0").decode("ascii", "replace"), bool(header["flags"] & layout.FLAG_SIGNED), computed,
    )  # fmt: skip
