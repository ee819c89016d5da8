"""The model of the flash accelerator takes the clocks that its rules say."""

from __future__ import annotations

import flash_model


def straight(begin: int, count: int) -> list[int]:
    return [begin + 4 * k for k in range(count)]


def kinds(addresses: list[int], extra: int = 0) -> dict[int, tuple[int, int]]:
    return dict.fromkeys(addresses, (4, extra))


def test_straight_code_waits_for_the_prefetch_of_every_line() -> None:
    code = straight(0x08000000, 400)  # four instructions a line, 100 lines of six clocks
    assert 590 <= flash_model.clocks(code, kinds(code)) <= 615


def test_slow_instructions_hide_the_prefetch() -> None:
    code = straight(0x08000000, 400)
    assert flash_model.clocks(code, kinds(code, extra=1)) <= 400 * 2 + 10


def test_loop_in_the_cache_costs_its_instructions_and_refills() -> None:
    loop = straight(0x08000000, 4)
    assert flash_model.clocks(loop * 100, kinds(loop)) <= 100 * (4 + 2) + 10


def test_jumps_beyond_the_cache_wait_every_time() -> None:
    far = [0x08000000 + 64 * k for k in range(65)]
    assert flash_model.clocks(far * 10, kinds(far)) == 650 * (1 + 2 + flash_model.WAIT_STATES)
    near = far[:64]
    assert flash_model.clocks(near * 10, kinds(near)) == 640 * 3 + 64 * flash_model.WAIT_STATES
