"""SDO client (CiA 301, 7.2.4.3): expedited, segmented and block transfer over a python-can bus.

An own implementation, because tables of every size must be transferred correctly: the block writer
of PyPI canopen ends early when its chunks are not multiples of seven bytes (its issue 618).
"""

from __future__ import annotations

import binascii
import time
from collections.abc import Callable
from typing import Protocol

import can

SEGMENT = 7
# A request fails when the server has been silent for this long. The server's own timeout is 2 s; after
# half of that it reports how far a block got.
DEFAULT_TIMEOUT_S = 3.0

# More than any object of a compensator holds: an upload that announces or sends more is aborted.
_LARGEST_UPLOAD_BYTES = 64 * 1024
_SWEEP_S = 0.5
# Lost segments are sent again with the next block. After this many blocks in a row of which the server took no
# segment, the transfer is aborted.
_BARREN_BLOCKS = 4
_ABORT_TEXT = {
    0x05030000: "toggle bit not alternated",
    0x05040000: "SDO protocol timed out",
    0x05040001: "command specifier not valid",
    0x05040002: "block size not valid",
    0x05040003: "sequence number not valid",
    0x05040004: "CRC error",
    0x05040005: "out of memory",
    0x06010000: "unsupported access",
    0x06010001: "write-only object",
    0x06010002: "read-only object",
    0x06020000: "no such object",
    0x06040041: "object cannot be mapped",
    0x06040042: "PDO too long",
    0x06040043: "parameter incompatible",
    0x06060000: "hardware error",
    0x06070010: "length does not match",
    0x06070012: "too long",
    0x06070013: "too short",
    0x06090011: "no such sub-index",
    0x06090030: "value out of range",
    0x06090031: "value too high",
    0x06090032: "value too low",
    0x08000000: "general error",
    0x08000020: "cannot be stored",
    0x08000022: "not in the present state of the device",
    0x08000024: "no data",
}


class CommunicationError(Exception):
    """The bus could not be used, or the node did not answer correctly. The message is always one line."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


class SdoAbortError(Exception):
    """The device refused a transfer. `code` is the SDO abort code."""

    def __init__(self, index: int, sub: int, code: int) -> None:
        self.index, self.sub, self.code = index, sub, code
        text = _ABORT_TEXT.get(code, "unknown code")
        super().__init__(f"object 0x{index:04X} sub {sub}: refused with 0x{code:08X} ({text})")


# progress(bytes done, bytes in all)
ByteProgress = Callable[[int, int], None]


def _no_progress(done: int, total: int) -> None:
    """Ignore the progress."""


class Bus(Protocol):
    """The methods of can.BusABC that a client uses."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue a frame."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Take the next frame; None if none came in time."""


class SdoClient:
    """Transfers with one server. Not for use by two threads at once."""

    def __init__(self, bus: Bus, node_id: int, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        self._bus = bus
        self._request_id = 0x600 + node_id
        self._response_id = 0x580 + node_id
        self.node_id = node_id
        self.timeout_s = timeout_s
        self.frames = 0  # sent and received, for judging a transfer against the protocol's limit

    def upload(self, index: int, sub: int, progress: ByteProgress = _no_progress) -> bytes:
        """Read an object. Raises SdoAbortError, CommunicationError."""
        answer = self._ask(index, sub, self._multiplexed(0x40, index, sub), is_first=True)
        command = answer[0]
        if command >> 5 != 2:
            raise self._confused(answer, "an upload response")
        if command & 0x02:
            return answer[4 : 8 - (command >> 2 & 3)] if command & 0x01 else answer[4:8]
        total = int.from_bytes(answer[4:8], "little") if command & 0x01 else 0
        if total > _LARGEST_UPLOAD_BYTES:
            raise self._given_up(
                index, sub, f"announced {total} bytes, expected at most {_LARGEST_UPLOAD_BYTES}"
            )
        data = bytearray()
        toggle = 0
        while True:
            answer = self._ask(index, sub, bytes([0x60 | toggle]).ljust(8, b"\0"))
            if answer[0] >> 5 != 0 or answer[0] & 0x10 != toggle:
                raise self._confused(answer, "an upload segment")
            piece, is_last = answer[1 : 8 - (answer[0] >> 1 & 7)], answer[0] & 0x01
            data += piece
            if len(data) > (most := total or _LARGEST_UPLOAD_BYTES):
                raise self._given_up(index, sub, f"sent more than {most} bytes")
            if not piece and not is_last:
                raise self._given_up(index, sub, "sent a segment without data that was not the last")
            progress(len(data), total)
            if is_last:
                break
            toggle ^= 0x10
        if command & 0x01 and len(data) != total:
            raise CommunicationError(
                f"object 0x{index:04X} sub {sub}: {len(data)} bytes came, {total} were announced"
            )
        return bytes(data)

    def download(self, index: int, sub: int, data: bytes, timeout_s: float | None = None) -> None:
        """Write an object of one to four bytes. Raises SdoAbortError, CommunicationError."""
        if not 1 <= len(data) <= 4:
            raise ValueError(f"{len(data)} bytes, expected one to four")
        request = self._multiplexed(0x23 | (4 - len(data)) << 2, index, sub, data.ljust(4, b"\0"))
        answer = self._ask(index, sub, request, timeout_s, is_first=True)
        if answer[0] != 0x60:
            raise self._confused(answer, "a download response")

    def download_segmented(
        self, index: int, sub: int, data: bytes, progress: ByteProgress = _no_progress
    ) -> None:
        """Write an object of any size, one segment and one confirmation at a time."""
        request = self._multiplexed(0x21, index, sub, len(data).to_bytes(4, "little"))
        answer = self._ask(index, sub, request, is_first=True)
        if answer[0] != 0x60:
            raise self._confused(answer, "a download response")
        toggle = 0
        for start in range(0, max(len(data), 1), SEGMENT):
            piece = data[start : start + SEGMENT]
            last = start + SEGMENT >= len(data)
            command = toggle | (SEGMENT - len(piece)) << 1 | last
            answer = self._ask(index, sub, bytes([command]) + piece.ljust(SEGMENT, b"\0"))
            if answer[0] != 0x20 | toggle:
                raise self._confused(answer, "a segment's confirmation")
            toggle ^= 0x10
            progress(start + len(piece), len(data))

    def download_block(
        self, index: int, sub: int, data: bytes, progress: ByteProgress = _no_progress
    ) -> None:
        """Write an object of at least one byte in blocks, with CRC; lost segments are sent again."""
        request = self._multiplexed(0xC6, index, sub, len(data).to_bytes(4, "little"))
        answer = self._ask(index, sub, request, is_first=True)
        if answer[0] >> 5 != 5 or answer[0] & 3 != 0:
            raise self._confused(answer, "a block download response")
        block_size = self._block_size(answer, 4)
        segments = [data[start : start + SEGMENT] for start in range(0, len(data), SEGMENT)]
        sent = barren = 0
        while sent < len(segments):
            block = segments[sent : sent + block_size]
            for number, piece in enumerate(block, 1):
                ends = sent + number == len(segments)
                self._send(bytes([number | ends << 7]) + piece.ljust(SEGMENT, b"\0"))
            answer = self._receive(index, sub, self.timeout_s)
            if answer[0] != 0xA2 or answer[1] > len(block):
                raise self._confused(answer, "a block's confirmation")
            barren = 0 if answer[1] else barren + 1
            if barren == _BARREN_BLOCKS:
                raise self._given_up(index, sub, f"took nothing of {barren} blocks in a row")
            sent += answer[1]
            if sent < len(segments):
                block_size = self._block_size(answer, 2)
            progress(min(sent * SEGMENT, len(data)), len(data))
        unused = -len(data) % SEGMENT
        # A block transfer ends with a CRC of the data: polynomial 0x1021, initial value 0 (CiA 301, 7.2.4.3.16).
        checksum = binascii.crc_hqx(data, 0).to_bytes(2, "little")
        answer = self._ask(index, sub, bytes([0xC1 | unused << 2]) + checksum + bytes(5))
        if answer[0] != 0xA1:
            raise self._confused(answer, "the end of a block download")

    def _block_size(self, answer: bytes, at: int) -> int:
        """Number of segments in the next block: segment numbers have seven bits (CiA 301, 7.2.4.3.9)."""
        if not 1 <= answer[at] <= 127:
            raise self._confused(answer, "a block of 1 to 127 segments")
        return answer[at]

    def abort(self, index: int, sub: int, code: int = 0x08000000) -> None:
        """Tell the server that a transfer is over."""
        self._send(self._multiplexed(0x80, index, sub, code.to_bytes(4, "little")))

    def _multiplexed(self, command: int, index: int, sub: int, data: bytes = bytes(4)) -> bytes:
        return bytes([command, index & 0xFF, index >> 8, sub]) + data

    def _ask(
        self, index: int, sub: int, request: bytes, timeout_s: float | None = None, is_first: bool = False
    ) -> bytes:
        """The answer to a request. The first of a transfer names its object: answers about other objects are ignored,
        which belong to another client or to an interrupted transfer.
        """
        # Frames received before the request do not answer it. _SWEEP_S limits the loop on a bus that is never idle.
        give_up = time.monotonic() + _SWEEP_S
        while self._bus.recv(0.0) is not None and time.monotonic() < give_up:
            pass
        self._send(request)
        place = request[1:4] if is_first else None
        return self._receive(index, sub, self.timeout_s if timeout_s is None else timeout_s, place)

    def _send(self, payload: bytes) -> None:
        message = can.Message(arbitration_id=self._request_id, is_extended_id=False, data=payload)
        give_up = time.monotonic() + self.timeout_s
        while True:
            try:
                self._bus.send(message, timeout=self.timeout_s)
            except can.CanOperationError as problem:
                # A full transmit queue empties by itself, so sending is repeated; a failed bus ends in the timeout.
                if time.monotonic() > give_up:
                    raise CommunicationError(f"cannot send on the bus: {problem}") from None
                time.sleep(0.001)
            else:
                self.frames += 1
                return

    def _receive(self, index: int, sub: int, timeout_s: float, place: bytes | None = None) -> bytes:
        give_up = time.monotonic() + timeout_s
        while (rest := give_up - time.monotonic()) > 0:
            try:
                message = self._bus.recv(rest)
            except can.CanOperationError as problem:
                raise CommunicationError(f"cannot receive from the bus: {problem}") from None
            if message is None or message.arbitration_id != self._response_id or message.is_extended_id:
                continue
            if message.is_error_frame or message.is_remote_frame or len(message.data) != 8:
                continue
            self.frames += 1
            answer = bytes(message.data)
            if place is not None and answer[1:4] != place:
                continue
            if answer[0] == 0x80:
                about = int.from_bytes(answer[1:3], "little"), answer[3]
                raise SdoAbortError(*about, int.from_bytes(answer[4:8], "little"))
            return answer
        raise CommunicationError(
            f"node {self.node_id} did not answer within {timeout_s:g} s (object 0x{index:04X} sub {sub})"
        )

    def _given_up(self, index: int, sub: int, why: str) -> CommunicationError:
        """Abort a transfer that cannot succeed; returns the error to raise."""
        self.abort(index, sub)
        return CommunicationError(f"node {self.node_id} {why} (object 0x{index:04X} sub {sub}): given up")

    def _confused(self, answer: bytes, expected: str) -> CommunicationError:
        return CommunicationError(f"node {self.node_id} sent {answer.hex(' ')}, expected {expected}")
