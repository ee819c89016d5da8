"""Control cycles on the emulated cores: the same outputs on all, and their cost with the node's CAN path.

The node runs between queues in memory: no CAN driver, no interrupts; no payload, no temperatures, no full pose.
"""

from __future__ import annotations

import arms
import numpy as np
import pytest
import recording
from armtrue.tables.export import ExportOptions, export

from tests import qemu

CYCLES = 300
# Of 168 000 clocks in a millisecond at 168 MHz. The core's own budget is tested in tests/firmware.
BUDGET_WITH_CAN = 45_000
_NODE_RESULT = np.dtype([("instructions", "<u4"), ("read", "<u4"), ("corrected", "<i4", 6)])


@pytest.fixture(scope="module")
def motion() -> recording.Recording:
    """A six-axis arm with every effect, 3 degree tables and a grid, sweeping its limits."""
    arm = arms.full_arm("kr30", grid_nodes=6)
    image = bytes(export(arm, ExportOptions()).image)
    cycles = recording.blank_cycles(CYCLES)
    path = recording.motion(arm.chain.limits, CYCLES, 1e-3, np.random.default_rng(1))
    increments_per_rad = 2**20 / (2.0 * np.pi) * 100.0
    cycles["target"][:, :6] = np.round(path * increments_per_rad)
    cycles["request"][0] = recording.ACTIVATE_A
    cycles["time_ms"] = np.arange(CYCLES) + 1  # as node_budget advances the clock
    return recording.Recording(6, image, cycles=cycles)


@pytest.fixture(scope="module")
def on_m4(motion: recording.Recording) -> np.ndarray:
    elf = qemu.build_images("stm32f405", "cycle_replay") / "cycle_replay.elf"
    run = qemu.run_image(elf, motion.to_bytes(), timeout_s=300.0)
    assert run.status == 0
    return recording.played(run.output)


@pytest.mark.full
def test_cortex_m7_gives_the_same_outputs(motion: recording.Recording, on_m4: np.ndarray) -> None:
    elf = qemu.build_images("cortex-m7", "cycle_replay") / "cycle_replay.elf"
    run = qemu.run_image(elf, motion.to_bytes(), machine="mps2-an500", timeout_s=300.0)
    assert run.status == 0
    on_m7 = recording.played(run.output)
    assert len(on_m7) == CYCLES
    for field in ("corrected", "delta", "flags", "state"):
        assert np.array_equal(on_m7[field], on_m4[field]), field


def test_node_sends_the_cores_outputs_within_budget(motion: recording.Recording, on_m4: np.ndarray) -> None:
    elf = qemu.build_images("stm32f405", "node_budget") / "node_budget.elf"
    run = qemu.run_image(elf, motion.to_bytes(), timeout_s=300.0)
    assert run.status == 0
    through_can = np.frombuffer(run.output, _NODE_RESULT)
    assert np.array_equal(through_can["corrected"], on_m4["corrected"][:, :6])
    assert not np.array_equal(through_can["corrected"], motion.cycles["target"][:, :6])
    read = through_can["read"]
    assert {0x2013 << 8 | sub for sub in range(1, 18)} <= set(
        read
    )  # a client asks for the table's state in motion
    dump = read == 0x2011 << 8
    assert dump.sum() > 140  # a whole block of it
    for what, rows in (("alone", read == 0), ("an SDO read", (read != 0) & ~dump), ("an SDO dump", dump)):
        worst = int(through_can["instructions"][rows].max())
        print(f"worst cycle with the CAN path, {what}: {worst} (core: {on_m4['instructions'].max()})")
        assert on_m4["instructions"].max() < worst <= BUDGET_WITH_CAN
