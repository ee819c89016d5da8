"""The chip's own image, unchanged, on the emulated board: a CANopen node between two SLCAN lines."""

from __future__ import annotations

import pathlib
from collections.abc import Iterator

import can
import pytest

from tests import qemu

NODE = 0x20
BOOT_UP = (0x700 + NODE, b"\x00")


@pytest.fixture(scope="module")
def image() -> pathlib.Path:
    return qemu.build_images("stm32f405", "armtrue_stm32f405") / "armtrue_stm32f405.elf"


class Lines:
    """Both lines of the board: the controller's and the drives'."""

    def __init__(self, board: qemu.Board) -> None:
        self.upstream = can.Bus(interface="slcan", channel=board.slcan_url(0), bitrate=1_000_000)
        self.downstream = can.Bus(interface="slcan", channel=board.slcan_url(1), bitrate=1_000_000)

    def close(self) -> None:
        self.upstream.shutdown()
        self.downstream.shutdown()


@pytest.fixture(scope="module")
def lines(image: pathlib.Path) -> Iterator[Lines]:
    with qemu.board(image) as board:
        opened = Lines(board)
        yield opened
        opened.close()


def message(identifier: int, data: bytes, *, extended: bool = False) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=extended)


def receive(bus: can.BusABC, identifier: int, timeout_s: float = 30.0) -> bytes:
    """The data of the next frame with this identifier; fails where none comes."""
    while (frame := bus.recv(timeout_s)) is not None:
        if frame.arbitration_id == identifier:
            return bytes(frame.data)
    pytest.fail(f"no frame 0x{identifier:X} within {timeout_s} s")


def read_object(bus: can.BusABC, index: int, subindex: int = 0) -> bytes:
    """Expedited SDO upload (CiA 301, 7.2.4.3)."""
    bus.send(message(0x600 + NODE, bytes([0x40, index & 0xFF, index >> 8, subindex, 0, 0, 0, 0])))
    answer = receive(bus, 0x580 + NODE)
    assert answer[0] & 0xE3 == 0x43, f"aborted: {answer.hex()}"
    return answer[4 : 8 - (answer[0] >> 2 & 3)]


def test_answers_as_a_canopen_device(lines: Lines) -> None:
    device_type = read_object(lines.upstream, 0x1000)
    assert int.from_bytes(device_type[:2], "little") == 402


def test_passes_frames_on_bit_identical_both_ways(lines: Lines) -> None:
    read_object(lines.upstream, 0x1000)
    frames = [message(0x77F - k, bytes(range(k % 9))) for k in range(40)]
    frames += [message(0x1ABCDE00 + k, bytes([k] * 8), extended=True) for k in range(20)]
    for source, sink in ((lines.upstream, lines.downstream), (lines.downstream, lines.upstream)):
        for sent in frames:
            source.send(sent)
            assert receive(sink, sent.arbitration_id) == bytes(sent.data)


def test_nmt_reset_restarts_the_image(lines: Lines) -> None:
    read_object(lines.upstream, 0x1000)
    for _ in range(3):
        lines.upstream.send(message(0x000, bytes([0x81, NODE])))
        assert (0x700 + NODE, receive(lines.upstream, 0x700 + NODE)) == BOOT_UP
        assert read_object(lines.upstream, 0x1000)
        assert read_object(lines.upstream, 0x2040, 1) == b"\x07", "the cause outlives the reset: NMT"


def test_protection_in_force_can_be_read(lines: Lines) -> None:
    in_force = int.from_bytes(read_object(lines.upstream, 0x2040, 8), "little")
    assert in_force & 0b1101 == 0b1101, "memory protection, voltage detector, window watchdog"
    assert not in_force & 0b0010, "the emulated board has no crystal to watch"


@pytest.mark.parametrize("requests", [100, pytest.param(300, marks=pytest.mark.full)])
def test_every_request_is_answered(lines: Lines, requests: int) -> None:
    for _ in range(requests):
        assert read_object(lines.upstream, 0x1018, 0) == b"\x04"
