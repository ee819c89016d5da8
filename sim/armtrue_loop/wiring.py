"""Who says what on the wires: identifiers and units that controller, drives and compensator agree on."""

from __future__ import annotations

import math

COMPENSATOR_ID = 0x20
JOINTS = 6
DRIVE_IDS = tuple(range(1, JOINTS + 1))

CONTROLLER_BUS = "vcan0"  # upstream of the compensator
DRIVE_BUS = "vcan1"  # downstream

SYNC_ID = 0x080
# Targets go two INTEGER32 to a frame: joints 1 and 2, 3 and 4, 5 and 6.
TARGET_IDS = (0x220, 0x320, 0x420)
# One frame a drive: statusword (2 bytes), actual position (4), mode display (1).
FEEDBACK_IDS = tuple(0x180 + drive for drive in DRIVE_IDS)
ACTUAL_AT = 2
# Position offsets of the compensator in offset mode, two to a frame as well.
OFFSET_IDS = (0x1A0, 0x2A0, 0x3A0)
# Thermometer: up to four INTEGER16 in 0.01 °C.
TEMPERATURE_ID = 0x1F0

# 2^24 increments a joint turn is 1.1 µm at 3 m. The common 2^20 would put a floor of 18 µm under the loop.
INCREMENTS_PER_TURN = 2**24
INCREMENTS_PER_RADIAN = INCREMENTS_PER_TURN / (2.0 * math.pi)
# The cycle's length in simulated time: what the compensator's limits of rate and its blending go by. A dozen
# cycles are then a move of a little more than a second, which is what a real arm needs.
CYCLE_US = 100_000
