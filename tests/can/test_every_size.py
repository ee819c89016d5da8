"""PyPI canopen against the node in one process: sizes over the whole range, and defects that the sweep must find.

tools/bench.d/62-sizes.sh sweeps every size.
"""

from __future__ import annotations

from collections.abc import Callable

import canopen
import every_size
import pytest
from every_size import (
    STAGING,
    WatchedBus,
    WrongTransferError,
    capacity,
    content,
    largest_table,
    sweep,
    there_and_back,
)
from in_process import InProcessNode, in_process

pytestmark = pytest.mark.without_bus

Frames = list[tuple[int, bytes]]
Exchange = Callable[[int, bytes], Frames]
Defect = Callable[[Exchange, int, bytes], Frames]
DOWN, UP = 0, 3  # segments: bits 7..5 of the request


@pytest.mark.parametrize(("below", "step"), [(30, 1910), pytest.param(201, 191, marks=pytest.mark.full)])
def test_sizes_all_over_the_range_read_back(below: int, step: int) -> None:
    largest = largest_table()
    sizes = [*range(1, below), *range(below, largest, step), *range(largest - 7, largest + 1)]
    done = sweep(sizes, WatchedBus(InProcessNode()))
    assert done.sizes == len(sizes)
    # Up to four bytes: a segment down, expedited up, then expedited both ways.
    assert done.requests == 4 * (2 + 1 + 2) + sum(2 + 2 * -(-size // 7) for size in sizes if size > 4)


def test_contents_differ_from_size_to_size() -> None:
    assert [len(content(size)) for size in (1, 8, 16384)] == [1, 8, 16384]
    assert len({content(size)[:16] for size in range(16, 16385)}) == 16384 - 15


class SpoiltNode(InProcessNode):
    """A correct node except for one defect, at the `left`th next request for a segment of `kind`."""

    def __init__(self, kind: int, defect: Defect) -> None:
        super().__init__()
        self.kind, self.defect, self.left = kind, defect, 0

    def exchange(self, identifier: int, data: bytes) -> Frames:
        if identifier & 0x780 == 0x600 and data[0] >> 5 == self.kind:
            self.left -= 1
            if self.left == 0:
                return self.defect(super().exchange, identifier, data)
        return super().exchange(identifier, data)


def flipped(data: bytes, byte: int, bit: int) -> bytes:
    changed = bytearray(data)
    changed[byte] ^= 1 << bit
    return bytes(changed)


def in_request(byte: int, bit: int) -> Defect:
    return lambda exchange, identifier, data: exchange(identifier, flipped(data, byte, bit))


def in_answer(byte: int, bit: int) -> Defect:
    return lambda exchange, identifier, data: [
        (source, flipped(answer, byte, bit)) for source, answer in exchange(identifier, data)
    ]


def lost_answer(exchange: Exchange, identifier: int, data: bytes) -> Frames:
    exchange(identifier, data)
    return []


def answered_twice(exchange: Exchange, identifier: int, data: bytes) -> Frames:
    return 2 * exchange(identifier, data)


def lost_request(exchange: Exchange, identifier: int, data: bytes) -> Frames:
    return []


def heard_twice(exchange: Exchange, identifier: int, data: bytes) -> Frames:
    return exchange(identifier, data) + exchange(identifier, data)


def acknowledged_unheard(exchange: Exchange, identifier: int, data: bytes) -> Frames:
    return [(0x580 + identifier - 0x600, bytes([0x20 | data[0] & 0x10, *bytes(7)]))]


DEFECTS = {
    "a bit of a first byte down": (DOWN, in_request(1, 0)),
    "a bit of a last byte down": (DOWN, in_request(6, 7)),
    "the toggle of a request": (DOWN, in_request(0, 4)),
    "the length of a segment down": (DOWN, in_request(0, 1)),
    "the toggle of an acknowledgement": (DOWN, in_answer(0, 4)),
    "a reserved bit of an acknowledgement": (DOWN, in_answer(7, 0)),
    "a segment acknowledged and dropped": (DOWN, acknowledged_unheard),
    "a bit of a first byte up": (UP, in_answer(1, 0)),
    "a bit of a last byte up": (UP, in_answer(6, 7)),
    "the toggle of a segment up": (UP, in_answer(0, 4)),
    "the length of a segment up": (UP, in_answer(0, 1)),
    "the end of an upload": (UP, in_answer(0, 0)),
} | {
    f"{defect.__name__} {way}": (kind, defect)
    for way, kind in (("down", DOWN), ("up", UP))
    for defect in (lost_answer, lost_request, answered_twice, heard_twice)
}


@pytest.mark.parametrize("nth", [72, *(pytest.param(n, marks=pytest.mark.full) for n in (1, 143))])
@pytest.mark.parametrize("what", DEFECTS)
def test_one_defect_in_a_thousand_bytes_is_found(what: str, nth: int) -> None:
    """1000 bytes are 143 segments, of which the last has six bytes."""
    node = SpoiltNode(*DEFECTS[what])
    bus = WatchedBus(node)
    with in_process(bus) as remote:
        remote.sdo.RESPONSE_TIMEOUT = 0.01
        there_and_back(remote, bus, 1000)
        node.left = nth
        with pytest.raises(WrongTransferError, match="1000 bytes"):
            there_and_back(remote, bus, 1000)
        there_and_back(remote, bus, 1000)


def test_node_that_returns_older_data_is_found() -> None:
    class Keeps(InProcessNode):
        older = False

        def exchange(self, identifier: int, data: bytes) -> Frames:
            frames = super().exchange(identifier, data)
            if self.older and data[0] >> 5 == UP:
                return [(source, b"%c" % answer[0] + b"\x55" * 7) for source, answer in frames]
            return frames

    node = Keeps()
    bus = WatchedBus(node)
    with in_process(bus) as remote:
        there_and_back(remote, bus, 70)
        node.older = True
        with pytest.raises(WrongTransferError, match="came back otherwise"):
            there_and_back(remote, bus, 70)


@pytest.mark.parametrize("sound", [True, False])
def test_sweep_reports_its_counts_or_the_defect(
    sound: bool, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Over 40 sizes in two processes; with the defective node each process meets one flipped bit."""

    def make() -> InProcessNode:
        node = SpoiltNode(*DEFECTS["a bit of a first byte down"])
        node.left = 0 if sound else 33
        return node

    monkeypatch.setattr(every_size, "InProcessNode", make)
    monkeypatch.setattr(every_size, "largest_table", lambda: 40)
    monkeypatch.setattr("sys.argv", ["every_size.py", "--jobs", "2"])
    assert every_size.main() == (0 if sound else 1)
    said = capfd.readouterr()
    if sound:
        assert "every size from 1 to 40 written" in said.out
        assert ": 44 downloads and 44 uploads, 830 bytes each way" in said.out
    else:
        assert "came back otherwise" in said.err
        assert said.out == ""


def test_client_is_from_pypi_and_reads_the_device_identity() -> None:
    assert canopen.RemoteNode.__module__.startswith("canopen.")
    with in_process(WatchedBus(InProcessNode())) as remote:
        assert remote.sdo["Device type"].raw == 0xFFFF0192
        assert remote.sdo["Manufacturer device name"].raw == "Armtrue compensator"
        remote.sdo.download(STAGING, 0, content(capacity(remote)))
        assert remote.sdo["Table status"]["Bytes staged"].raw == capacity(remote)
