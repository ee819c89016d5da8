"""The emulated STM32F405 starts our images, exchanges data with the host and counts instructions exactly."""

from __future__ import annotations

import pathlib

import pytest

from tests import qemu


@pytest.fixture(scope="module")
def boot_check() -> pathlib.Path:
    return qemu.build_images("stm32f405", "boot_check") / "boot_check.elf"


def test_recorded_input_comes_back_as_output(boot_check: pathlib.Path) -> None:
    recorded = bytes(range(255)) * 5
    run = qemu.run_image(boot_check, recorded)
    assert run.status == 0
    assert run.output == bytes(byte + 1 for byte in recorded)


def test_instruction_count_is_exact_and_repeats(boot_check: pathlib.Path) -> None:
    counts = {int(qemu.run_image(boot_check).printed) for _ in range(3)}
    # 1000 turns of two instructions, and the one that loads the number of turns.
    assert counts == {2001}


def test_clock_runs_while_no_interrupt_is_served() -> None:
    """As during the erase of a flash sector, which takes up to two seconds: the core fetches nothing then."""
    elf = qemu.build_images("stm32f405", "clock_check") / "clock_check.elf"
    without_interrupts, with_interrupts = map(int, qemu.run_image(elf).printed.split())
    assert without_interrupts == pytest.approx(40_000, abs=50)
    assert with_interrupts == pytest.approx(40_000, abs=50)


def test_profile_lists_the_costliest_function_first(boot_check: pathlib.Path) -> None:
    profile = qemu.instructions_by_function(boot_check)
    assert next(iter(profile)) == "main"
    assert 2001 <= profile["main"] < 2200


def test_image_that_does_not_end_is_an_error(boot_check: pathlib.Path) -> None:
    with pytest.raises(qemu.QemuError, match="did not end"):
        qemu.run_image(boot_check, timeout_s=0.0)


def test_image_has_binary_hex_and_map(boot_check: pathlib.Path) -> None:
    binary = boot_check.with_suffix(".bin").read_bytes()
    stack, reset = (int.from_bytes(binary[at : at + 4], "little") for at in (0, 4))
    assert stack == 0x20020000
    assert reset & 1 == 1, "Thumb"
    assert 0x08000000 < reset < 0x08000000 + len(binary)
    assert boot_check.with_suffix(".hex").read_text("ascii").splitlines()[-1] == ":00000001FF"
    assert "reset_handler" in boot_check.with_suffix(".map").read_text("ascii")
