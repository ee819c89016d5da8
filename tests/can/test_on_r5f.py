"""The scenario suites against the target of targets/r5f.toml."""

from __future__ import annotations

import functools
import os
from pathlib import Path

from suite_conformance import *  # noqa: F403
from suite_foreign import *  # noqa: F403
from suite_motion import *  # noqa: F403
from suite_tables import *  # noqa: F403
from target import Target

from tests import qemu

TARGET = "r5f.toml"
BUILD_FIRST = functools.partial(qemu.build_images, "r5f", "armtrue_r5f")
# Set by `./dev r5f-interrupts`: the test then requires interrupts and writes their numbers into this file.
RECORD_VARIABLE = "ARMTRUE_R5F_INTERRUPTS"


def test_frames_arrive_by_interrupt_or_polling_as_reported(target: Target) -> None:
    """By interrupt only, if the image found an interrupt controller; otherwise by polling."""
    assert target.board is not None
    record = os.environ.get(RECORD_VARIABLE)
    frames = 100
    target.reset()
    start = target.board.ways_in()
    for k in range(frames):  # one at a time: no two can share an interrupt
        target.send(0x680 + k, [k])
        assert target.expect(0x680 + k, target.downstream) == bytes([k])
        target.send_from_drives(0x680 + k, [k])
        assert target.expect(0x680 + k) == bytes([k])
    end = target.board.ways_in()
    if "ready, by interrupt" in target.board.wait_for_text("ready"):
        assert end.polls == 0
        assert end.can0_interrupts - start.can0_interrupts >= frames
        assert end.can1_interrupts - start.can1_interrupts >= frames
    else:
        assert record is None, "interrupts are demanded; the image found no interrupt controller and polls"
        assert (end.can0_interrupts, end.can1_interrupts) == (0, 0)
        assert end.polls > start.polls
    if record is not None:
        Path(record).write_text(
            f"{frames} frames each way: {end.can0_interrupts - start.can0_interrupts} interrupts of CAN0, "
            f"{end.can1_interrupts - start.can1_interrupts} of CAN1, {end.polls} polls\n",
            encoding="utf-8",
        )
