"""Error frames of SocketCAN at the POSIX node: bus states are reported and counted, bus-off is recovered from."""

from __future__ import annotations

import time
from collections.abc import Iterator

import can
import canopen
import link
import pytest
from node_process import NODE_ID, NodeProcess, connect, disconnect

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
    give_up = time.monotonic() + 30.0
    while code not in [error.code for error in remote.emcy.log]:
        assert time.monotonic() < give_up, f"no EMCY 0x{code:04X}"
        time.sleep(0.01)


def heartbeats(bus: can.BusABC, seconds: float) -> int:
    """Number of the node's heartbeats within `seconds` from now."""
    while bus.recv(0.0) is not None:
        pass
    end = time.monotonic() + seconds
    count = 0
    while (left := end - time.monotonic()) > 0.0:
        message = bus.recv(left)
        count += message is not None and message.arbitration_id == 0x700 + NODE_ID
    return count


def expect_heartbeats(bus: can.BusABC) -> None:
    """Wait for five heartbeats of the node, long enough for a slow machine."""
    give_up = time.monotonic() + 30.0
    while bus.recv(0.0) is not None:
        pass
    count = 0
    while count < 5:
        assert time.monotonic() < give_up, f"{count} heartbeats"
        message = bus.recv(1.0)
        count += message is not None and message.arbitration_id == 0x700 + NODE_ID


def expect_silence(bus: can.BusABC) -> None:
    """Wait until the node's heartbeats cease; on a slow machine it reacts late."""
    give_up = time.monotonic() + 30.0
    while heartbeats(bus, 0.5) > 0:
        assert time.monotonic() < give_up, "still on the bus"


@pytest.fixture
def watcher(remote: canopen.RemoteNode) -> Iterator[can.BusABC]:
    """The bus, with a heartbeat of the node every 20 ms."""
    remote.sdo[0x1017].raw = 20
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        expect_heartbeats(bus)
        yield bus


def recovers(remote: canopen.RemoteNode, watcher: can.BusABC, entries: int) -> None:
    """The node is on the bus again and has reported its bus-off state."""
    expect_emergency(remote, 0x8140)
    expect_heartbeats(watcher)
    assert bus_state(remote) == "active"
    assert remote.sdo["Upstream bus status"]["Bus-off entries"].raw == entries
    assert remote.sdo["Error register"].raw == 0
    assert remote.sdo[0x1003][1].raw & 0xFFFF == 0x8140


def test_bus_off_lasts_until_the_kernel_restarts_the_controller(
    remote: canopen.RemoteNode, watcher: can.BusABC
) -> None:
    kernel_says(BUS_OFF)
    expect_silence(watcher)  # beyond the pause before the recovery
    assert heartbeats(watcher, 0.5) == 0, "nobody restarted anything"
    kernel_says(CONTROLLER, ACTIVE)
    assert heartbeats(watcher, 0.4) == 0, "what the driver says of its counters is no restart"
    assert remote.emcy.log == []
    kernel_says(RESTARTED)
    recovers(remote, watcher, 1)


def test_link_that_comes_up_again_ends_bus_off(running_node: NodeProcess) -> None:
    remote = connect(running_node.upstream)
    remote.sdo[0x1017].raw = 20
    disconnect(remote)  # its socket would not survive the loss of the link
    kernel_says(BUS_OFF)
    time.sleep(0.3)
    with link.down(running_node.upstream):
        time.sleep(0.3)
    with can.Bus(interface="socketcan", channel=running_node.upstream) as bus:
        expect_heartbeats(bus)
    remote = connect(running_node.upstream)
    assert bus_state(remote) == "active"
    disconnect(remote)


def test_restart_by_the_kernel_at_once_ends_bus_off(remote: canopen.RemoteNode) -> None:
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
