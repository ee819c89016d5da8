"""The Cortex-R5F image on its emulated CAN controllers: CAN0 on vcan0, CAN1 on vcan1."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import can
import pytest

from tests import qemu

NODE = 0x20
BUILD_FIRST = functools.partial(qemu.build_images, "r5f", "armtrue_r5f")
pytestmark = pytest.mark.full  # an emulator inside User-Mode Linux


@pytest.fixture(scope="module")
def buses() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    image = qemu.build_images("r5f", "armtrue_r5f") / "armtrue_r5f.elf"
    with (
        can.Bus(interface="socketcan", channel="vcan0") as upstream,
        can.Bus(interface="socketcan", channel="vcan1") as downstream,
        qemu.real_time_board(image, ["vcan0", "vcan1"]) as board,
    ):
        board.wait_for_text("ready")
        yield upstream, downstream


def receive(bus: can.BusABC, identifier: int, timeout_s: float = 30.0) -> can.Message:
    while (frame := bus.recv(timeout_s)) is not None:
        if frame.arbitration_id == identifier:
            return frame
    pytest.fail(f"no frame 0x{identifier:X} within {timeout_s} s")


def read_object(bus: can.BusABC, index: int, subindex: int = 0) -> bytes:
    """Expedited SDO upload (CiA 301, 7.2.4.3)."""
    request = bytes([0x40, index & 0xFF, index >> 8, subindex, 0, 0, 0, 0])
    bus.send(can.Message(arbitration_id=0x600 + NODE, data=request, is_extended_id=False))
    answer = bytes(receive(bus, 0x580 + NODE).data)
    assert answer[0] & 0xE3 == 0x43, f"aborted: {answer.hex()}"
    return answer[4 : 8 - (answer[0] >> 2 & 3)]


def test_boot_up_message_is_on_the_bus(buses: tuple[can.BusABC, can.BusABC]) -> None:
    assert bytes(receive(buses[0], 0x700 + NODE).data) == b"\0"


def test_answers_sdo_requests(buses: tuple[can.BusABC, can.BusABC]) -> None:
    for _ in range(20):
        assert int.from_bytes(read_object(buses[0], 0x1000)[:2], "little") == 402


@pytest.mark.parametrize("towards_drives", [True, False])
def test_passes_frames_on_bit_identical(buses: tuple[can.BusABC, can.BusABC], towards_drives: bool) -> None:
    source, sink = buses if towards_drives else buses[::-1]
    frames = [
        can.Message(arbitration_id=0x77F - k, data=bytes(range(k, k + k % 9)), is_extended_id=False)
        for k in range(20)
    ]
    frames += [
        can.Message(arbitration_id=0x1ABCDE00 + k, data=bytes([k, 2, 3, 4, 5, 6, 7, 8]), is_extended_id=True)
        for k in range(10)
    ]
    for sent in frames:
        source.send(sent)
        got = receive(sink, sent.arbitration_id)
        assert (got.is_extended_id, bytes(got.data)) == (sent.is_extended_id, bytes(sent.data))


def test_nmt_reset_restarts_the_image(buses: tuple[can.BusABC, can.BusABC]) -> None:
    upstream, _ = buses
    for _ in range(2):
        upstream.send(can.Message(arbitration_id=0, data=[0x81, NODE], is_extended_id=False))
        assert bytes(receive(upstream, 0x700 + NODE).data) == b"\0"
        assert read_object(upstream, 0x1000)
