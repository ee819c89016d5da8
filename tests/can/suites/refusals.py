"""Requests that CiA 301 refuses, with their abort codes: the same for every target and client."""

from __future__ import annotations

# Index, subindex, bytes to write (None: to read), abort code.
REFUSED: list[tuple[int, int, bytes | None, int]] = [
    (0x1000, 0, b"\1\2\3\4", 0x06010002),
    (0x1000, 1, None, 0x06090011),
    (0x1004, 0, None, 0x06020000),
    (0x1017, 0, b"\1\2\3\4", 0x06070012),
    (0x1005, 0, b"\x80", 0x06070013),
    (0x1003, 0, b"\1", 0x06090031),
    (0x2000, 3, b"\1\0\0\0", 0x06090032),
    (0x2012, 0, None, 0x06010001),
    (0x2012, 0, b"nope", 0x06090030),
]
