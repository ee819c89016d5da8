"""python every_size.py [--jobs N]: transfers of every size from one byte to the largest table, by PyPI canopen.

The node's own sources run in this process (in_process.py); the client is PyPI's, unmodified. Each size has its own
bytes, which are written, read back and compared; every answer is checked. Prints the section of docs/results.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import multiprocessing
import os
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import can
import canopen

sys.path.insert(0, str(Path(__file__).resolve().parent / "support"))

from in_process import InProcessBus, InProcessNode, in_process

STAGING = 0x2010
# Up to this size the client downloads expedited unless told otherwise, and the server always uploads expedited.
EXPEDITED_UP_TO = 4
_REQUEST, _ANSWER = 0x600, 0x580
_TOGGLE = 0x10


class WrongTransferError(Exception):
    """The bytes read back differ from those sent, or the transfer took another number of frames than its size needs."""


@dataclasses.dataclass
class Swept:
    """Counts of a sweep."""

    sizes: int = 0
    downloads: int = 0
    uploads: int = 0
    bytes_each_way: int = 0
    requests: int = 0
    seconds: float = 0.0

    def __add__(self, other: Swept) -> Swept:
        ours, theirs = dataclasses.astuple(self), dataclasses.astuple(other)
        return Swept(*(a + b for a, b in zip(ours, theirs, strict=True)))


class WatchedBus(InProcessBus):
    """Checks what the client does not: one answer for each request, and the acknowledgement of each segment."""

    def __init__(self, node: InProcessNode) -> None:
        super().__init__(node)
        self.requests = 0
        self.segments = 0  # requests of segments, both ways
        self.wrong = ""
        self._answers: list[bytes] = []
        self.listeners.append(self._listen)

    def _listen(self, answer: can.Message) -> None:
        if answer.arbitration_id & 0x780 == _ANSWER:
            self._answers.append(bytes(answer.data))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send as a bus does, then check the answers."""
        self._answers.clear()
        super().send(msg, timeout)
        if msg.arbitration_id & 0x780 != _REQUEST:
            return
        self.requests += 1
        command = msg.data[0]
        kind = command >> 5
        if kind in (0, 3):
            self.segments += 1
        if len(self._answers) != 1:
            self._note(msg, f"{len(self._answers)} answers")
        elif kind == 0 and self._answers[0] != _ACKNOWLEDGED[command & _TOGGLE]:
            self._note(msg, f"acknowledged by {self._answers[0].hex(' ')}")

    def _note(self, msg: can.Message, what: str) -> None:
        self.wrong = self.wrong or f"request {self.requests}, {bytes(msg.data).hex(' ')}: {what}"


_ACKNOWLEDGED = {toggle: bytes([0x20 | toggle, *bytes(7)]) for toggle in (0, _TOGGLE)}


def content(size: int) -> bytes:
    """Bytes that no other size has."""
    return hashlib.shake_128(size.to_bytes(4, "little")).digest(size)


def capacity(remote: canopen.RemoteNode) -> int:
    """Size of the largest table, as the device reports it."""
    return int(remote.sdo["Table status"]["Capacity (bytes)"].raw)


def there_and_back(remote: canopen.RemoteNode, bus: WatchedBus, size: int, segmented: bool = True) -> None:
    """Write, read and compare one size. Raises WrongTransferError on any deviation."""
    image = content(size)
    bus.requests = bus.segments = 0
    bus.wrong = ""
    try:
        remote.sdo.download(STAGING, 0, image, force_segment=segmented)
        back = remote.sdo.upload(STAGING, 0)
    except (canopen.SdoAbortedError, canopen.SdoCommunicationError) as problem:
        raise WrongTransferError(f"{size} bytes: {problem} ({bus.wrong})") from problem
    pieces = -(-size // 7)
    segments = pieces * segmented + pieces * (size > EXPEDITED_UP_TO)
    if bus.wrong:
        raise WrongTransferError(f"{size} bytes: {bus.wrong}")
    if back != image:
        raise WrongTransferError(f"{size} bytes came back otherwise, {len(back)} of them")
    if (bus.segments, bus.requests) != (segments, segments + 2):
        raise WrongTransferError(
            f"{size} bytes: {bus.requests} requests, {bus.segments} of segments, expected {segments + 2}, {segments}"
        )


def sweep(sizes: Iterable[int], bus: WatchedBus) -> Swept:
    """All sizes on one node, segmented; the shortest also as the client sends them by default."""
    begin = time.monotonic()
    done = Swept()
    with in_process(bus) as remote:
        for size in sizes:
            for segmented in (True, False) if size <= EXPEDITED_UP_TO else (True,):
                there_and_back(remote, bus, size, segmented)
                done.downloads += 1
                done.uploads += 1
                done.bytes_each_way += size
                done.requests += bus.requests
            done.sizes += 1
    done.seconds = time.monotonic() - begin
    return done


def largest_table() -> int:
    """Capacity of a new node, which must refuse one byte more."""
    with in_process(WatchedBus(InProcessNode())) as remote:
        largest = capacity(remote)
        try:
            remote.sdo.download(STAGING, 0, bytes(largest + 1))
        except canopen.SdoAbortedError:
            return largest
    raise WrongTransferError(f"{largest + 1} bytes were taken, capacity {largest}")


def _share(sizes: range) -> Swept:
    return sweep(sizes, WatchedBus(InProcessNode()))


def main() -> int:
    """Sweep every size; exit status 1 if one does not come back as sent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    jobs = parser.parse_args().jobs
    begin = time.monotonic()
    total = Swept()
    try:
        largest = largest_table()
        shares = [range(first, largest + 1, jobs) for first in range(1, jobs + 1)]
        with multiprocessing.Pool(jobs) as pool:
            for part in pool.imap_unordered(_share, shares):
                total += part
    except WrongTransferError as wrong:
        print(wrong, file=sys.stderr)
        return 1
    if total.sizes != largest:
        print(f"{total.sizes} sizes, expected {largest}", file=sys.stderr)
        return 1
    print(report(total, largest))
    print(
        f"{time.monotonic() - begin:.0f} s with {jobs} processes, {1e6 * total.seconds / total.requests:.1f} µs for a "
        "request and its answer",
        file=sys.stderr,
    )
    return 0


def report(total: Swept, largest: int) -> str:
    """The section of docs/results.md."""
    grouped = {
        name: f"{value:,}".replace(",", " ") for name, value in vars(total).items() if name != "seconds"
    }
    return (
        f"PyPI `canopen` {canopen.__version__} (unmodified; `RemoteNode`, python-can messages) against the node's "
        f"sources in one process, no frame lost: every size from 1 to {largest} written, read back, compared, and "
        f"every answer watched: {grouped['downloads']} downloads and {grouped['uploads']} uploads, "
        f"{grouped['bytes_each_way']} bytes each way, {grouped['requests']} requests, each with its one answer; "
        f"nothing came back other than sent. All segmented, but uploads of up to {EXPEDITED_UP_TO} bytes, which the "
        "server answers expedited; downloads of those sizes also expedited."
    )


if __name__ == "__main__":
    sys.exit(main())
