"""The node inside this process: no kernel, no thread and no lost frame between a CANopen client and the firmware."""

from __future__ import annotations

import contextlib
import ctypes
import struct
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import can
import canopen
from node_process import EDS, ROOT

# A request and its answer, eight bytes each, at 1 Mbit/s.
EXCHANGE_US = 270
_FRAME = struct.Struct("<IB3x8s")
_ROOM = 256  # frames of one answer


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """The firmware's node as a shared library (firmware/ports/host/node_in_process.h)."""
    loaded = ctypes.CDLL(str(ROOT / "build/release/firmware/ports/host/node_in_process.so"))
    loaded.armtrue_node_new.restype = ctypes.c_void_p
    loaded.armtrue_node_free.argtypes = [ctypes.c_void_p]
    loaded.armtrue_node_free.restype = None
    loaded.armtrue_node_id.restype = ctypes.c_uint8
    loaded.armtrue_node_exchange.restype = ctypes.c_size_t
    loaded.armtrue_node_exchange.argtypes = [
        ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_void_p, ctypes.c_size_t,
    ]  # fmt: skip
    return loaded


class InProcessNode:
    """A node from factory state."""

    def __init__(self) -> None:
        self._library = library()
        self._exchange = self._library.armtrue_node_exchange
        self._node = self._library.armtrue_node_new()
        self._request = ctypes.create_string_buffer(_FRAME.size)
        self._sent = ctypes.create_string_buffer(_ROOM * _FRAME.size)
        self._places = ctypes.addressof(self._request), ctypes.addressof(self._sent)

    def exchange(self, identifier: int, data: bytes) -> list[tuple[int, bytes]]:
        """Give it a frame; identifiers and data of the frames that it sends before it waits for the next."""
        _FRAME.pack_into(self._request, 0, identifier, len(data), data)
        request, sent = self._places
        count = self._exchange(self._node, request, EXCHANGE_US, sent, _ROOM)
        if count > _ROOM:
            raise RuntimeError(f"{count} frames at once, room for {_ROOM}")
        frames = []
        for place in range(0, count * _FRAME.size, _FRAME.size):
            answer, length, payload = _FRAME.unpack_from(self._sent, place)
            frames.append((answer, payload[:length]))
        return frames

    def close(self) -> None:
        """Free it; call once."""
        self._library.armtrue_node_free(self._node)


class InProcessBus(can.BusABC):
    """A python-can bus to one node, whose answers have arrived when `send` returns."""

    def __init__(self, node: InProcessNode) -> None:
        super().__init__("in process")
        self.node = node
        self.listeners: list[Any] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Give the node the frame and the listeners its answers, as a can.Notifier would."""
        for identifier, data in self.node.exchange(msg.arbitration_id, bytes(msg.data)):
            answer = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
            for listener in self.listeners:
                listener(answer)

    def shutdown(self) -> None:
        """The node ends with its bus."""
        super().shutdown()
        self.node.close()


@contextlib.contextmanager
def in_process(bus: InProcessBus) -> Iterator[canopen.RemoteNode]:
    """PyPI canopen's view of the node on a bus, to which it is the only client."""
    network = canopen.Network(bus)
    bus.listeners += network.listeners
    try:
        yield network.add_node(library().armtrue_node_id(), str(EDS))
    finally:
        network.disconnect()
