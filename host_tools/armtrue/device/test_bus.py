"""CAN buses opened from command-line options: valid ones reach python-can, bad ones are refused."""

from __future__ import annotations

from typing import Any

import can
import pytest

from armtrue.device.connection import BusOptions, open_bus
from armtrue.device.sdo import CommunicationError
from armtrue.errors import InputError


def test_options_become_arguments_of_python_can() -> None:
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


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"bitrate": 0}, "--bitrate: found 0, expected a whole number of bit/s above 0"),
        ({"bitrate": -125_000}, "--bitrate: found -125000, expected"),
        ({"fd": True, "data_bitrate": 0}, "--data-bitrate: found 0, expected"),
    ],
)
@pytest.mark.parametrize("interface", ["virtual", "socketcan", "slcan", "pcan"])
def test_bit_rate_of_zero_or_less_is_bad_input(interface: str, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        open_bus(BusOptions(interface, "here", **options))


def test_bit_rate_given_as_extra_option_is_checked() -> None:
    with pytest.raises(InputError, match=r"--bitrate: found 500k, expected a whole number"):
        open_bus(BusOptions("pcan", "here", extra=["bitrate=500k"]))


@pytest.mark.parametrize(
    ("interface", "typed", "meant"),
    [
        ("virtual", "rx_queue_sise=5", "rx_queue_size"),
        ("socketcan", "local_lopback=true", "local_loopback"),
    ],
)
def test_option_unknown_to_the_interface_is_bad_input(interface: str, typed: str, meant: str) -> None:
    with pytest.raises(
        InputError, match=f"--bus-option: found '{typed.split('=')[0]}'.*did you mean '{meant}'"
    ):
        open_bus(BusOptions(interface, "here", extra=[typed]))


def test_options_that_the_interface_may_have_are_accepted() -> None:
    with open_bus(BusOptions("virtual", "here", 500_000, extra=["rx_queue_size=5"])):
        pass
    assert BusOptions("slcan", "x", extra=["btr=031C"]).arguments()["btr"] == "031C"
    assert BusOptions("pcan", "x", extra=["auto_reset=true"]).arguments()["auto_reset"] is True


def test_unknown_interface_is_bad_input_with_the_nearest_name() -> None:
    with pytest.raises(InputError, match="--interface: 'soketcan'.*socketcan"):
        open_bus(BusOptions("soketcan", "can0"))


def test_bus_that_cannot_be_opened_is_a_communication_error() -> None:
    with pytest.raises(CommunicationError, match="slcan socket://127.0.0.1:1: cannot be opened"):
        open_bus(BusOptions("slcan", "socket://127.0.0.1:1"))


def test_virtual_interface_opens() -> None:
    with open_bus(BusOptions("virtual", "here")) as bus:
        assert bus.channel_info.endswith("here")


def test_frame_that_python_can_cannot_read_is_a_bus_error(monkeypatch: pytest.MonkeyPatch) -> None:
    class Damaged:
        def recv(self, timeout: float | None = None) -> can.Message | None:
            return int("t2z", 16) and None  # as python-can's slcan does with a damaged line

    monkeypatch.setattr(can, "Bus", lambda **_: Damaged())
    bus = open_bus(BusOptions("slcan", "x"))
    with pytest.raises(can.CanOperationError, match="frame that cannot be read"):
        bus.recv(0.1)
