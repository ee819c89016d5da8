"""Buses from command-line words: everything goes through to python-can as it stands."""

from __future__ import annotations

import can
import pytest

from armtrue.device.bus import BusOptions, open_bus
from armtrue.device.sdo import CommunicationError
from armtrue.errors import InputError


def test_words_become_what_python_can_takes() -> None:
    options = BusOptions(
        "slcan",
        "socket://host:3333",
        1_000_000,
        extra=["sleep_after_open=0.1", "rtscts=true", "poll_interval=2"],
    )
    assert options.arguments() == {
        "interface": "slcan", "channel": "socket://host:3333", "bitrate": 1_000_000,
        "sleep_after_open": 0.1, "rtscts": True, "poll_interval": 2,
    }  # fmt: skip
    assert BusOptions("socketcan", "can0", fd=True, data_bitrate=4_000_000).arguments() == {
        "interface": "socketcan", "channel": "can0", "fd": True, "data_bitrate": 4_000_000,
    }  # fmt: skip


def test_an_option_without_a_value_is_bad_input() -> None:
    with pytest.raises(InputError, match="--bus-option: found 'rtscts', expected KEY=VALUE"):
        BusOptions("slcan", "x", extra=["rtscts"]).arguments()


def test_an_unknown_interface_is_bad_input_with_the_nearest_name() -> None:
    with pytest.raises(InputError, match="--interface: 'soketcan'.*socketcan"):
        open_bus(BusOptions("soketcan", "can0"))


def test_a_bus_that_cannot_be_opened_is_no_communication() -> None:
    with pytest.raises(CommunicationError, match="slcan socket://127.0.0.1:1: cannot be opened"):
        open_bus(BusOptions("slcan", "socket://127.0.0.1:1"))


def test_any_interface_opens() -> None:
    with open_bus(BusOptions("virtual", "here")) as bus:
        assert bus.channel_info.endswith("here")


def test_a_frame_that_python_can_cannot_read_is_an_error_of_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    class Damaged:
        def recv(self, timeout: float | None = None) -> can.Message | None:
            return int("t2z", 16) and None  # as python-can's slcan does with a damaged line

    monkeypatch.setattr(can, "Bus", lambda **_: Damaged())
    bus = open_bus(BusOptions("slcan", "x"))
    with pytest.raises(can.CanOperationError, match="frame that cannot be read"):
        bus.recv(0.1)
