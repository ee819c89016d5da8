"""A controller that moves axis by axis, and drives that follow another axis' target, move backwards or too far."""

from __future__ import annotations

import math
import struct

from armtrue.device import SdoClient

TARGETS, POSITIONS = (0x220, 0x320, 0x420), (0x1C0, 0x1C1, 0x1C2)
SWING = 100  # cycles in which one axis goes there and back


def targets_at(cycle: int) -> list[int]:
    """One axis after the other."""
    axis, at = divmod(cycle % (6 * SWING), SWING)
    return [
        1000 * k + (round(20_000 * math.sin(math.tau * at / SWING)) if k == axis else 0) for k in range(6)
    ]


class Drives:
    """Six position loops. Drive k follows `scale[k]` times the target of `axis[k]`."""

    def __init__(
        self, axis: tuple[int, ...] = (0, 1, 2, 3, 4, 5), scale: tuple[float, ...] = (1.0,) * 6
    ) -> None:
        self.axis, self.scale = axis, scale
        self.position = [scale[k] * targets_at(0)[axis[k]] for k in range(6)]

    def follow(self, targets: list[int]) -> list[int]:
        """The next cycle's positions."""
        for k in range(6):
            self.position[k] += 0.3 * (self.scale[k] * targets[self.axis[k]] - self.position[k])
        return [round(position) for position in self.position]


def cycle_frames(cycle: int, drives: Drives) -> list[tuple[int, bytes]]:
    """SYNC, targets, actual positions."""
    targets = targets_at(cycle)
    positions = drives.follow(targets)
    frames = [(0x80, b"")]
    for identifiers, values in ((TARGETS, targets), (POSITIONS, positions)):
        frames += [(one, struct.pack("<2i", *values[2 * k : 2 * k + 2])) for k, one in enumerate(identifiers)]
    return frames


def configure(client: SdoClient) -> None:
    """Set the identifiers of the target and position PDOs to those of the drives."""
    for pair in range(3):
        client.download(0x1400 + pair, 1, TARGETS[pair].to_bytes(4, "little"))
        client.download(0x1408 + pair, 1, POSITIONS[pair].to_bytes(4, "little"))
