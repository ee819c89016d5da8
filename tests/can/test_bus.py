"""The rig itself: two separate buses, classic and FD, seen by python-can."""

from __future__ import annotations

import can
import pytest


def _pair(channel: str, fd: bool) -> tuple[can.BusABC, can.BusABC]:
    return tuple(can.Bus(interface="socketcan", channel=channel, fd=fd) for _ in range(2))  # type: ignore[return-value]


@pytest.mark.parametrize("channel", ["vcan0", "vcan1"])
@pytest.mark.parametrize(("length", "fd"), [(0, False), (8, False), (64, True)])
def test_frame_arrives_unchanged(channel: str, length: int, fd: bool) -> None:
    sender, receiver = _pair(channel, fd)
    try:
        sent = can.Message(
            arbitration_id=0x123, is_extended_id=False, is_fd=fd, bitrate_switch=fd, data=bytes(range(length))
        )
        sender.send(sent)
        got = receiver.recv(2.0)
        assert got is not None
        assert got.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)
    finally:
        sender.shutdown()
        receiver.shutdown()


def test_the_two_buses_are_separate() -> None:
    with (
        can.Bus(interface="socketcan", channel="vcan0") as first,
        can.Bus(interface="socketcan", channel="vcan1") as second,
    ):
        first.send(can.Message(arbitration_id=1, is_extended_id=False))
        assert second.recv(0.1) is None
