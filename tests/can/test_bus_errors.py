"""What the kernel says about the bus in error frames: reported, counted, recovered from (POSIX node on SocketCAN)."""

from __future__ import annotations

import time

import can
import canopen
import pytest

# linux/can/error.h: classes in the identifier, details of CAN_ERR_CRTL in the second byte.
CONTROLLER, BUS_OFF, RESTARTED = 0x004, 0x040, 0x100
RX_OVERFLOW, TX_WARNING, TX_PASSIVE, ACTIVE = 0x01, 0x08, 0x20, 0x40
STATE = {0: "active", 1: "warning", 2: "passive", 3: "bus-off"}


def kernel_says(error_class: int, detail: int = 0) -> None:
    """An error frame as a driver would raise it."""
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        data = [0, detail, 0, 0, 0, 0, 0, 0]
        bus.send(
            can.Message(arbitration_id=error_class, is_error_frame=True, is_extended_id=False, data=data)
        )


def bus_state(remote: canopen.RemoteNode) -> str:
    return STATE[remote.sdo["Upstream bus status"]["Bus state"].raw]


def expect_emergency(remote: canopen.RemoteNode, code: int) -> None:
    give_up = time.monotonic() + 20.0
    while code not in [error.code for error in remote.emcy.log]:
        assert time.monotonic() < give_up, f"no EMCY 0x{code:04X}"
        time.sleep(0.01)


def test_bus_off_is_recovered_from_and_reported(remote: canopen.RemoteNode) -> None:
    kernel_says(BUS_OFF)
    # The message leaves after the recovery, 100 ms later; then the condition is over.
    expect_emergency(remote, 0x8140)
    assert bus_state(remote) == "active"
    assert remote.sdo["Upstream bus status"]["Bus-off entries"].raw == 1
    assert remote.sdo["Error register"].raw == 0
    assert remote.sdo[0x1003][1].raw & 0xFFFF == 0x8140


def test_a_bus_that_the_kernel_restarts_is_active_again(remote: canopen.RemoteNode) -> None:
    kernel_says(BUS_OFF)
    kernel_says(RESTARTED)
    expect_emergency(remote, 0x8140)
    assert bus_state(remote) == "active"


@pytest.mark.parametrize(("detail", "state"), [(TX_WARNING, "warning"), (TX_PASSIVE, "passive")])
def test_error_states_are_shown_and_end(remote: canopen.RemoteNode, detail: int, state: str) -> None:
    kernel_says(CONTROLLER, detail)
    assert bus_state(remote) == state
    if state == "passive":
        expect_emergency(remote, 0x8120)
        assert remote.sdo["Error register"].raw == 0x11
    kernel_says(CONTROLLER, ACTIVE)
    assert bus_state(remote) == "active"
    assert remote.sdo["Error register"].raw == 0


def test_frames_lost_in_the_controller_are_counted(remote: canopen.RemoteNode) -> None:
    before = remote.sdo["Upstream bus status"]["Receive overruns"].raw
    kernel_says(CONTROLLER, RX_OVERFLOW)
    expect_emergency(remote, 0x8110)
    assert remote.sdo["Upstream bus status"]["Receive overruns"].raw == before + 1
