"""A CANopen network that loses no frame while its process waits for a core."""

from __future__ import annotations

import socket

import can
import canopen

_SO_RCVBUFFORCE = 33  # asm-generic/socket.h; Python has no name for it
# An upload puts some ten thousand frames on the bus, and a socket holds 277 by default: what comes behind them to a
# process that gets no core meanwhile, such as a request that nobody repeats, would be dropped.
_RECEIVE_BUFFER_BYTES = 16 << 20


def keep_all_frames(bus: can.BusABC) -> None:
    """Let a SocketCAN bus hold 16 MB of frames that nobody has read yet. Needs CAP_NET_ADMIN."""
    bus.socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER_BYTES)


def open_network(channel: str) -> canopen.Network:
    """A CANopen network on SocketCAN interface `channel` with such a buffer; close it with `disconnect`."""
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05  # how long disconnect() waits for its thread
    network.connect(interface="socketcan", channel=channel)
    keep_all_frames(network.bus)
    return network
