"""The Cortex-R5F image starts on the emulated Zynq UltraScale+, without a bus."""

from __future__ import annotations

from tests import qemu


def test_image_starts_and_reports_polling_or_interrupts() -> None:
    elf = qemu.build_images("r5f", "armtrue_r5f") / "armtrue_r5f.elf"
    with qemu.real_time_board(elf) as board:
        printed = board.wait_for_text("\n")
    # QEMU before 10.2 has no interrupt controller for this core (firmware/ports/r5f/README.md).
    assert printed in ("armtrue: ready, polling\r\n", "armtrue: ready, by interrupt\r\n")


def test_interrupts_change_no_register_of_a_computation() -> None:
    elf = qemu.build_images("r5f", "interrupt_check") / "interrupt_check.elf"
    silent = ("-cpu", "cortex-r5f", "-audiodev", "none,id=silent")
    run = qemu.run_image(elf, machine="realview-pb-a8", extra=silent)
    assert run.status == 0
