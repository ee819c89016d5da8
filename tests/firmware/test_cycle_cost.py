"""The longest control cycle of any accepted table: the reader's count against instructions measured in QEMU.

`cycle_cost` (firmware/core/table/table_cost.h) sums over a table's records. Here each kind of record fills a table as
far as the reader accepts, with inputs at the ends of their ranges, on the emulated STM32F405: no cycle may take more
instructions than counted by the reader, and the count may not be so high that it refuses tables that would fit.
"""

from __future__ import annotations

import adversarial
import numpy as np
import pytest
import recording
from armtrue.tables import validate
from armtrue.tables.fixed import cycle_budget, cycle_cost

from tests import qemu

_ENDS = np.array([0, 1 << 20, -(1 << 31), (1 << 31) - 1, 123456789, -987654321, 555, -(1 << 22), 1 << 22, -5, 1 << 30,
                  -(1 << 30)])  # fmt: skip
ARMS = [(6, False), (8, False), (8, True)]


def extreme_cycles() -> np.ndarray:
    """Cycles with targets, temperatures and payload at the ends of what the bus can carry."""
    rows = recording.blank_cycles(len(_ENDS))
    for k in range(recording.SLOTS):
        rows["target"][:, k] = np.roll(_ENDS, 5 * k)
        rows["temperature_mdegc"][:, k] = np.roll(_ENDS, 3 * k)
    rows["temperature_valid"] = 255
    rows["payload_g"] = np.roll(_ENDS, 4)
    rows["time_ms"] = np.linspace(0, 2**32 - 1, len(_ENDS))
    rows["request"][0] = recording.ACTIVATE_A
    return rows


def measured(images: list[bytes]) -> list[int]:
    """Instructions of the longest cycle with each image."""
    cycles = extreme_cycles()
    stream = b"".join(recording.Recording(image[20], image, cycles=cycles).to_bytes() for image in images)
    elf = qemu.build_images("stm32f405", "cycle_replay") / "cycle_replay.elf"
    run = qemu.run_image(elf, stream, timeout_s=600.0)
    assert run.status == 0, run.printed
    played = recording.played(run.output)["instructions"].reshape(len(images), -1)
    return [int(longest) for longest in played.max(axis=1)]


@pytest.mark.parametrize(("joints", "full_pose"), ARMS, ids=["six", "eight", "eight, pose"])
def test_no_accepted_table_takes_longer_than_counted(joints: int, full_pose: bool) -> None:
    names = list(adversarial.KINDS)
    images = [adversarial.fullest(name, joints, full_pose, lambda i: validate(i).accepted) for name in names]
    counted = [cycle_cost(image) for image in images]
    found = measured(images)
    worst = max(found)
    for name, count, longest in zip(names, counted, found, strict=True):
        print(f"{name:45} counted {count:6} measured {longest:6}")
    print(f"longest cycle of any: {worst} of {cycle_budget()}")
    for name, count, longest in zip(names, counted, found, strict=True):
        assert longest <= count <= cycle_budget(), name
        assert count <= 1.4 * longest + 500, name


def test_table_of_300_grids_is_refused_as_too_much_work() -> None:
    """From an issue: 300 grids of four axes, 40 cycles' worth of instructions in 12 KB."""
    table = adversarial.plain(6)
    adversarial.KINDS["steep grid of 4 axes"](table, 300)
    image = table.image()
    verdict = validate(image)
    assert (verdict.refusal, verdict.reason) == (20, "too much work for a control cycle")
    assert len(image) < 16384
    assert cycle_cost(image) > 15 * cycle_budget()
