"""A forbidden access in the STM32F405 image ends in a reset that keeps its cause; the watchdog is started first."""

from __future__ import annotations

import pathlib
import re
import struct
import subprocess
import tempfile
import time

import pytest

from tests import qemu

NMT, FAULT, MEMORY_FAULT = 7, 8, 9
DATA_ACCESS, INSTRUCTION_ACCESS, STACKING = 1 << 1, 1 << 0, 1 << 4  # of the memory fault status


def after(what: str) -> tuple[int, ...]:
    """Cause, protection, starts, and the fault's instruction, status and address, as read after the reset."""
    elf = qemu.build_images("stm32f405", "fault_check") / "fault_check.elf"
    run = qemu.run_image(elf, what.encode())
    assert run.status == 0, f"status {run.status}; 3: nothing forbade it. {run.printed}"
    return struct.unpack("<6I", run.output)


@pytest.mark.parametrize(
    ("what", "status", "address"),
    [
        pytest.param("n", DATA_ACCESS, 4, id="write to the null page"),
        pytest.param("r", DATA_ACCESS, 0, id="read of the null page"),
        pytest.param("x", INSTRUCTION_ACCESS, None, id="execution from RAM"),
        pytest.param("g", DATA_ACCESS, None, id="write below the stack"),
        pytest.param("i", DATA_ACCESS, 0x08000400, id="write to the image"),
    ],
)
def test_forbidden_access_resets_and_records_its_place(what: str, status: int, address: int | None) -> None:
    cause, is_protected, starts, instruction, found, at = after(what)
    assert (cause, is_protected, starts) == (MEMORY_FAULT, 1, 2)
    assert found & status
    if what == "x":
        assert 0x20000000 <= instruction < 0x20020000
    else:
        assert 0x08000000 < instruction < 0x08100000
    if address is not None:
        assert at == address


def test_stack_overflow_resets_and_is_recorded() -> None:
    cause, is_protected, starts, _, status, _ = after("s")
    assert (cause, is_protected, starts) == (MEMORY_FAULT, 1, 2)
    assert status & (DATA_ACCESS | STACKING)


def test_undefined_instruction_resets_as_a_fault() -> None:
    cause, _, _, instruction, _, _ = after("u")
    assert cause == FAULT
    assert 0x08000000 < instruction < 0x08100000


def test_reset_cause_noted_by_the_program_is_kept() -> None:
    assert after("m")[0] == NMT


def test_image_starts_the_watchdog_first() -> None:
    elf = qemu.build_images("stm32f405", "armtrue_stm32f405") / "armtrue_stm32f405.elf"
    pattern = r"^(\w+): unimplemented device (\w+).*offset (0x\w+)(?:, value (0x\w+))?"
    with tempfile.TemporaryDirectory() as folder:
        log = pathlib.Path(folder) / "log"
        command = [
            "qemu-system-arm", "-M", "netduinoplus2", "-kernel", str(elf), "-display", "none",
            "-monitor", "none", "-serial", "null", "-serial", "null", "-d", "unimp,guest_errors", "-D", str(log),
        ]  # fmt: skip
        touched: list[tuple[str, str, str, str]] = []
        emulator = subprocess.Popen(command)
        try:
            give_up = time.monotonic() + 60.0
            while len(touched) < 2:
                assert time.monotonic() < give_up, "the emulator logs what it does not model"
                assert emulator.poll() is None, "the image runs for ever"
                time.sleep(0.05)
                # Only complete lines: the last one may still be incomplete.
                log_text = log.read_text(encoding="ascii").rpartition("\n")[0] if log.exists() else ""
                touched = re.findall(pattern, log_text, re.MULTILINE)
        finally:
            emulator.kill()
            emulator.wait()
    # Started by the reset handler, and once more where main() sets its time.
    for device, access, offset, value in touched[:2]:
        assert device.upper() in ("IWDG", "I2S2EXT")  # QEMU 7.2 has both at 0x40003000
        assert (access, int(offset, 16), int(value, 16)) == ("write", 0, 0xCCCC)
