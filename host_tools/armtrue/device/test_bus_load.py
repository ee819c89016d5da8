from __future__ import annotations

import can
import pytest

from armtrue.device.bus_load import classic_frame_bits, frame_seconds


def test_frame_length_lies_between_no_and_worst_stuffing() -> None:
    for identifier in (0, 0x080, 0x2AA, 0x555, 0x7FF):
        for data in (b"", b"\0" * 8, b"\xff" * 8, b"\x55" * 8, bytes(range(8))):
            bits = classic_frame_bits(identifier, data)
            fields = 47 + 8 * len(data)
            assert fields <= bits <= fields + (34 + 8 * len(data) - 1) // 4


def test_alternating_bits_need_little_stuffing_and_zeros_much() -> None:
    assert classic_frame_bits(0x555, b"\x55" * 8) <= 111 + 2
    assert classic_frame_bits(0x000, b"\0" * 8) >= 111 + 15


def test_frame_of_zeros_has_a_stuff_bit_after_every_five_bits() -> None:
    # Identifier 0, no data: 19 dominant bits, whose CRC is zero: 34 zeros in a row, then 13 bits unstuffed.
    assert classic_frame_bits(0, b"") == 34 + 34 // 5 + 13


def test_extended_frame_is_about_twenty_bits_longer() -> None:
    plain = classic_frame_bits(0x555, b"\x55")
    extended = classic_frame_bits(0x15555555, b"\x55", extended=True)
    assert 18 <= extended - plain <= 26


def test_fd_payload_runs_at_the_data_rate() -> None:
    message = can.Message(is_fd=True, bitrate_switch=True, data=bytes(64), is_extended_id=False)
    fast = frame_seconds(message, 1_000_000, 5_000_000)
    message.bitrate_switch = False
    assert fast < frame_seconds(message, 1_000_000, 5_000_000) / 3


@pytest.mark.parametrize("bitrate", [125_000, 1_000_000])
def test_frame_time_is_bits_divided_by_bit_rate(bitrate: int) -> None:
    message = can.Message(arbitration_id=0x123, data=b"abc", is_extended_id=False)
    assert frame_seconds(message, bitrate, bitrate) == classic_frame_bits(0x123, b"abc") / bitrate
