"""The POSIX node's program on socket pairs that carry can_frame instead of buses: no kernel with CAN is needed."""

from __future__ import annotations

import contextlib
import signal
import socket
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import can
from node_process import NODE_ID, node_program

_FRAME = struct.Struct("<IB3x8s")  # struct can_frame
_SO_TIMESTAMPNS = 35
_TIMESPEC = struct.Struct("<qq")


class SocketBus(can.BusABC):
    """One end of a pair. A frame's `timestamp` is the kernel's, taken in the sender's call."""

    def __init__(self, end: socket.socket) -> None:
        super().__init__(channel="socket pair")
        self._socket = end
        end.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """A classic data frame with an identifier of eleven bits."""
        self._socket.settimeout(timeout)
        self._socket.send(_FRAME.pack(msg.arbitration_id, len(msg.data), bytes(msg.data)))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._socket.settimeout(timeout)
        try:
            data, stamps, _, _ = self._socket.recvmsg(_FRAME.size, 64)
        except (TimeoutError, BlockingIOError):
            return None, False
        identifier, length, payload = _FRAME.unpack(data)
        seconds, nanoseconds = _TIMESPEC.unpack(stamps[0][2])
        message = can.Message(
            arbitration_id=identifier, data=payload[:length], is_extended_id=False,
            timestamp=seconds + 1e-9 * nanoseconds,
        )  # fmt: skip
        return message, False

    def shutdown(self) -> None:
        """Close this end."""
        super().shutdown()
        self._socket.close()


@contextlib.contextmanager
def node_on_sockets(
    state: Path, *options: str
) -> Iterator[tuple[subprocess.Popen[bytes], SocketBus, SocketBus]]:
    """armtrue_node between two such buses, booted: its process, the controller's side, the drives' side."""
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)]
    ends = [theirs.fileno() for _, theirs in pairs]
    command = [str(node_program()), "--upstream", f"fd:{ends[0]}", "--downstream", f"fd:{ends[1]}"]
    process = subprocess.Popen(
        [*command, "--state", str(state), *options], stderr=subprocess.PIPE, pass_fds=ends
    )
    for _, theirs in pairs:
        theirs.close()
    upstream, downstream = (SocketBus(ours) for ours, _ in pairs)
    try:
        while (frame := upstream.recv(30.0)) is None or frame.arbitration_id != 0x700 + NODE_ID:
            if process.poll() is not None or frame is None:
                raise RuntimeError(f"armtrue_node did not boot, status {process.poll()}")
        yield process, upstream, downstream
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60.0)
        upstream.shutdown()
        downstream.shutdown()
