"""Recordings of control cycles for firmware/replay: written, and their results read."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

MAGIC = 0x59504C52
SLOTS = 8
_HEAD = struct.Struct("<6I")
_CYCLE = np.dtype(
    [
        ("request", "<u4"),
        ("target", "<i4", SLOTS),
        ("temperature_mdegc", "<i4", SLOTS),
        ("temperature_valid", "<u4"),
        ("payload_g", "<i4"),
        ("time_ms", "<u4"),
    ]
)
_PLAYED = np.dtype(
    [
        ("corrected", "<i4", SLOTS),
        ("delta", "<i4", SLOTS),
        ("flags", "<u2"),
        ("state", "<u2"),
        ("instructions", "<u4"),
    ]
)

ACTIVATE_A, ACTIVATE_B, DISABLE, REFUSE_A = 1, 2, 3, 4
PASS_THROUGH, BLENDING, ACTIVE = 0, 1, 2


@dataclass
class Recording:
    """Cycles for a compensator with `joints` joints. `cycles` is an array of the recorded structure."""

    joints: int
    table_a: bytes
    table_b: bytes = b""
    cycle_us: int = 1000
    cycles: np.ndarray = field(default_factory=lambda: np.zeros(0, _CYCLE))

    def to_bytes(self) -> bytes:
        """The file that cycle_replay reads."""
        head = _HEAD.pack(
            MAGIC, self.joints, self.cycle_us, len(self.cycles), len(self.table_a), len(self.table_b),
        )  # fmt: skip
        return head + self.table_a + self.table_b + self.cycles.tobytes()


def blank_cycles(count: int) -> np.ndarray:
    """Cycles at standstill at zero."""
    return np.zeros(count, _CYCLE)


def played(result: bytes) -> np.ndarray:
    """The result file as an array of cycles."""
    return np.frombuffer(result, _PLAYED)


def motion(limits: np.ndarray, cycles: int, cycle_s: float, rng: np.random.Generator) -> np.ndarray:
    """Joint paths (cycles, n) [rad or m] that sweep the limits, stop, and turn back, smooth in position."""
    time = np.arange(cycles) * cycle_s
    low, high = limits[:, 0], limits[:, 1]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    path = np.zeros((cycles, len(limits)))
    for share in (0.6, 0.3):
        rate = rng.uniform(0.3, 1.2, len(limits))
        path += share * np.sin(rate * time[:, None] + rng.uniform(0.0, 6.28, len(limits)))
    # Standstill for a while in every third second, so that direction has to be remembered.
    moving = np.cumsum(np.where((time % 3.0) < 2.5, cycle_s, 0.0))
    path = np.stack([np.interp(moving, time, path[:, k]) for k in range(path.shape[1])], axis=1)
    return middle + half * np.clip(path, -1.0, 1.0)
