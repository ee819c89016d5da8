"""Ten thousand random tables that the reader accepts but that describe no arm, on host and emulated STM32F405.

`senseless_tables` (firmware/core/senseless/senseless_main.cc) makes them, checks on the host that corrections keep to
the maxima, and writes recordings. The chip must accept and refuse the same tables and give the same output within the
cycle budget.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import recording
from armtrue.tables.fixed import cycle_budget

from tests import qemu

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build/release/firmware"
COUNT = 10_000
BATCH = 2_500


@pytest.mark.full  # with every change, senseless_test.cc tests some of them on the host
def test_random_tables_agree_on_host_and_chip_within_the_budget(tmp_path: Path) -> None:
    subprocess.run(
        ["cmake", "--build", "--preset", "release", "--target", "senseless_tables", "cycle_replay"],
        cwd=ROOT,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    elf = qemu.build_images("stm32f405", "cycle_replay") / "cycle_replay.elf"
    worst, cycles = 0, 0
    for first in range(0, COUNT, BATCH):
        made, host_result = tmp_path / "recordings", tmp_path / "result"
        subprocess.run([BUILD / "core/senseless_tables", str(first), str(BATCH), made], check=True)
        subprocess.run([BUILD / "replay/cycle_replay", made, host_result], check=True)
        run = qemu.run_image(elf, made.read_bytes(), timeout_s=900.0)
        assert run.status == 0, run.printed
        host, chip = recording.played(host_result.read_bytes()), recording.played(run.output)
        for field in ("corrected", "delta", "flags", "state"):
            assert np.array_equal(host[field], chip[field]), field
        worst = max(worst, int(chip["instructions"].max()))
        cycles += len(chip)
    print(f"{COUNT} tables, {cycles} cycles, the longest {worst} instructions of {cycle_budget()}")
    assert worst <= cycle_budget()
    assert cycles > 5 * COUNT  # most were accepted and ran
