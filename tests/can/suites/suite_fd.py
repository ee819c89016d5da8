# ruff: noqa: D103 -- a test says what it checks in its name
"""The joint path with CAN FD frames, or FD and classic ones: up to 64 bytes, every bit-rate switch and error state.

For targets whose buses carry FD frames; the emulated controllers are classic ones.
"""

from __future__ import annotations

import copy
import itertools
import math
import random
import struct
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import can
import pytest
from suite_motion import ACTIVE, MARK, SYNC, TURN, at_cycle, cycle_until, install_table, until_emergency
from target import ARRIVES_WITHIN_S, NMT_PREOPERATIONAL, NMT_START, Target

AMPLITUDE = -TURN / 1024 / math.tau  # small_table's
TARGET_POSITION, ACTUAL_POSITION, POSITION_OFFSET = 0x607A, 0x6064, 0x60B0
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
DUMMIES = {8: 0x0005, 16: 0x0006, 32: 0x0007}  # CiA 301, 7.4.7: bytes for another node
KINDS = [(brs, esi) for brs in (False, True) for esi in (False, True)]


@dataclass(frozen=True)
class Part:
    """One PDO of a layout: the axes whose values it holds, in this order, and the frame that carries it."""

    number: int  # of its PDO, from 0
    identifier: int
    axes: tuple[int | str, ...]  # from 0; a text is a number of bits for another node
    length: int  # of the frame in bytes; above 8, or with `fd`, a CAN FD frame
    fd: bool = False

    @property
    def is_fd(self) -> bool:
        """Whether a CAN FD frame carries it."""
        return self.fd or self.length > 8

    def words(self, index: int) -> list[int]:
        """The mapping entries: the object `index` of each axis, dummies between them."""
        return [
            DUMMIES[int(axis)] << 16 | int(axis)
            if isinstance(axis, str)
            else (index + 0x800 * axis) << 16 | 32
            for axis in self.axes
        ]

    def places(self) -> dict[int, int]:
        """The first byte of each axis."""
        found, at = {}, 0
        for axis in self.axes:
            if isinstance(axis, str):
                at += int(axis) // 8
            else:
                found[axis] = at
                at += 4
        return found

    def frame(self, values: Sequence[int], kind: tuple[bool, bool], noise: random.Random) -> can.Message:
        """A frame with these values of its axes; all other bytes are random."""
        data = bytearray(noise.randbytes(self.length))
        for axis, at in self.places().items():
            struct.pack_into("<i", data, at, values[axis])
        return can.Message(
            arbitration_id=self.identifier, data=data, is_extended_id=False, is_fd=self.is_fd,
            bitrate_switch=self.is_fd and kind[0], error_state_indicator=self.is_fd and kind[1],
        )  # fmt: skip

    def values(self, frame: can.Message) -> dict[int, int]:
        """The value of each axis in a frame."""
        return {axis: struct.unpack_from("<i", frame.data, at)[0] for axis, at in self.places().items()}


ALL = (0, 1, 2, 3, 4, 5)
TARGETS = {
    "one FD frame": [Part(0, 0x220, ALL, 64)],
    "one FD frame, as short as it can be": [Part(0, 0x220, ALL, 24)],
    "FD and classic frames, at odd bytes": [
        Part(0, 0x220, ("16", 0, "8", 1, 2, 3), 48),
        Part(1, 0x320, (4, "32"), 8),
        Part(2, 0x420, ("32", 5), 8, fd=True),
    ],
    "classic frames": [Part(pair, 0x220 + 0x100 * pair, (2 * pair, 2 * pair + 1), 8) for pair in range(3)],
}
FEEDBACK = [Part(8, 0x1C0, ("8", 0, 1, 2, 3), 64), Part(9, 0x1C1, (4, 5), 8)]
OFFSETS = {
    "one FD frame": [Part(0, 0x1A0, ALL, 24)],
    "FD and classic": [Part(0, 0x1A0, (0, 1, 2, 3), 16), Part(1, 0x2A0, (4, 5), 8)],
    "classic frames": [Part(pair, 0x1A0 + 0x100 * pair, (2 * pair, 2 * pair + 1), 8) for pair in range(3)],
}


class Line:
    """A target whose PDOs are laid out in FD and classic frames."""

    def __init__(self, target: Target, targets: list[Part], mode: int, offsets: Sequence[Part] = ()) -> None:
        self.target, self.targets, self.offsets = target, targets, offsets
        self.noise = random.Random(5)
        target.nmt(NMT_PREOPERATIONAL)
        for part in targets:
            self._map(0x1400, part, part.words(TARGET_POSITION), 0)
        for part in FEEDBACK:
            self._map(0x1400, part, part.words(ACTUAL_POSITION), 0)
        for part in offsets:
            self._map(0x1800, part, part.words(POSITION_OFFSET), 0x40000000)
        assert target.write(0x2000, 3, 1_000_000, 4) == 0
        assert target.write(0x2000, 4, 500_000, 4) == 0
        assert target.write(0x2000, 1, mode, 1) == 0
        target.nmt(NMT_START)
        assert target.read(0x2001, 2) & 1, "targets of all joints are mapped"
        target.quiet(target.downstream, timeout_s=0.0)  # a full socket would drop the MARK frame
        self.through([])  # frames still in transit

    def _map(self, base: int, part: Part, words: list[int], bits: int) -> None:
        write = self.target.write
        assert write(base + part.number, 1, 1 << 31 | bits | part.identifier, 4) == 0
        assert write(base + 0x200 + part.number, 0, 0, 1) == 0
        for sub, word in enumerate(words, 1):
            assert write(base + 0x200 + part.number, sub, word, 4) == 0
        assert write(base + 0x200 + part.number, 0, len(words), 1) == 0
        assert write(base + part.number, 1, bits | part.identifier, 4) == 0

    def through(self, frames: Sequence[can.Message]) -> list[can.Message]:
        """Send SYNC, frames and MARK from the controller's side; those of the frames that reach the drives' side."""
        target = self.target
        target.send(SYNC)
        for frame in frames:
            target.upstream.send(frame)
        target.send(MARK)
        got: list[can.Message] = []
        while True:
            frame = target.downstream.recv(ARRIVES_WITHIN_S)
            assert frame is not None, "a frame of nobody's was not passed on"
            target.note_time()
            if frame.arbitration_id == MARK:
                return got
            if frame.arbitration_id != SYNC:
                got.append(frame)

    def cycle(self, joints: list[int], kind: tuple[bool, bool] = (True, False)) -> dict[int, int]:
        """Send a set of targets; the correction of each axis. All other bits must arrive as they were sent."""
        while True:
            sent = [part.frame(joints, kind, self.noise) for part in self.targets]
            if len(got := self.through(sent)) == len(sent):
                break
            assert self.target.sets_excused > 0, f"of a whole set {got} went out, and nothing halted"
            self.target.sets_excused -= 1
        corrections = {}
        for part, before, after in zip(self.targets, sent, got, strict=True):
            expected = copy.deepcopy(before)
            for axis, at in part.places().items():
                expected.data[at : at + 4] = after.data[at : at + 4]
                corrections[axis] = part.values(after)[axis] - joints[axis]
            assert_same(after, expected)
        assert sorted(corrections) == list(ALL)
        return corrections


def assert_same(got: can.Message | None, sent: can.Message) -> None:
    assert got is not None
    assert got.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False), (got, sent)
    assert (
        got.error_state_indicator == sent.error_state_indicator
    )  # `equals` looks at it, too: of the library


def wanted(joints: Sequence[int]) -> list[float]:
    """The table's correction of each axis."""
    return [AMPLITUDE * math.sin(math.tau * joint / TURN) for joint in joints]


def of_all(corrections: dict[int, int]) -> list[int]:
    return [corrections[axis] for axis in ALL]


@pytest.fixture
def fd_target(target: Target) -> Iterator[Target]:
    """A target with a table in force; reset afterwards, with the table still installed."""
    install_table(target)
    yield target
    target.nmt(NMT_PREOPERATIONAL)
    target.reset()


@pytest.fixture(params=list(TARGETS))
def inline_fd(request: pytest.FixtureRequest, fd_target: Target) -> Line:
    """Inline mode, the table's correction blended in."""
    line = Line(fd_target, TARGETS[request.param], mode=1)
    if len(line.targets) > 1:
        sent = [part.frame(at_cycle(0), (False, False), line.noise) for part in line.targets]
        assert line.through(sent) == [], "a stream begins with its second set"
    for number in range(1, 40):
        line.cycle(at_cycle(number))
    return line


def test_fd_targets_are_corrected_in_their_own_bytes_only(inline_fd: Line) -> None:
    for number, kind in enumerate(4 * KINDS, 40):
        joints = at_cycle(number)
        # Repeated: the correction's rate is limited, and it blends out if this machine halted for too long.
        give_up = time.monotonic() + ARRIVES_WITHIN_S
        while (corrections := of_all(inline_fd.cycle(joints, kind))) != pytest.approx(wanted(joints), abs=2):
            assert time.monotonic() < give_up, f"{corrections}, expected {wanted(joints)}"


def test_fd_feedback_at_corrected_targets_reads_as_commanded(inline_fd: Line) -> None:
    target = inline_fd.target
    joints = at_cycle(40)
    corrections = of_all(inline_fd.cycle(joints))
    stand = [joint + correction for joint, correction in zip(joints, corrections, strict=True)]
    target.quiet()
    for kind, part in itertools.product(KINDS, FEEDBACK):
        sent = part.frame(stand, kind, inline_fd.noise)
        target.downstream.send(sent)
        expected = copy.deepcopy(sent)
        for axis, at in part.places().items():
            struct.pack_into("<i", expected.data, at, joints[axis])
        assert_same(target.passed_on(target.upstream), expected)


def test_fd_unrelated_frames_pass_bit_identical(inline_fd: Line) -> None:
    noise = inline_fd.noise
    places = [(0x456, False), (0x1ABCDE00, True), (inline_fd.targets[0].identifier, True), (0x1C0, True)]
    frames = [
        can.Message(
            arbitration_id=identifier, is_extended_id=extended, data=noise.randbytes(length),
            is_fd=True, bitrate_switch=brs, error_state_indicator=esi,
        )
        for (identifier, extended), length, (brs, esi) in itertools.product(places, FD_LENGTHS, KINDS)
    ]  # fmt: skip
    frames += [
        can.Message(arbitration_id=identifier, is_extended_id=extended, data=noise.randbytes(length))
        for (identifier, extended), length in itertools.product(places, range(9))
    ]
    noise.shuffle(frames)
    target = inline_fd.target
    for source, sink in ((target.upstream, target.downstream), (target.downstream, target.upstream)):
        target.quiet(sink)
        for sent in frames:
            source.send(sent)
            assert_same(target.passed_on(sink), sent)


def test_fd_target_shorter_than_its_mapping_is_dropped(inline_fd: Line) -> None:
    whole = inline_fd.targets[0]
    needed = max(whole.places().values()) + 4
    target = inline_fd.target
    target.quiet()
    sent = [part.frame(at_cycle(40), (True, False), inline_fd.noise) for part in inline_fd.targets]
    length = max(length for length in FD_LENGTHS if length < needed)
    sent[0] = can.Message(
        arbitration_id=whole.identifier, is_extended_id=False, data=sent[0].data[:length], is_fd=True
    )
    assert inline_fd.through(sent) == []
    until_emergency(target, 0x8210)
    sent = [part.frame(at_cycle(41), (True, False), inline_fd.noise) for part in inline_fd.targets]
    # A set of one frame cannot mix two cycles. Of several frames one may be late, so the next set is withheld too.
    assert (inline_fd.through(sent) == []) == (len(sent) > 1)
    inline_fd.cycle(at_cycle(42))


OFFSET_LAYOUTS = [
    ("one FD frame", "one FD frame"),
    ("one FD frame", "classic frames"),
    ("classic frames", "one FD frame"),
    ("FD and classic frames, at odd bytes", "FD and classic"),
]


@pytest.fixture(params=OFFSET_LAYOUTS, ids=lambda names: f"targets: {names[0]}, offsets: {names[1]}")
def offset_fd(request: pytest.FixtureRequest, fd_target: Target) -> Line:
    """Offset mode, before its first set."""
    targets, offsets = request.param
    return Line(fd_target, TARGETS[targets], mode=2, offsets=OFFSETS[offsets])


def offset_cycle(line: Line, joints: list[int], held: list[int], kind: tuple[bool, bool]) -> int:
    """Send positions and targets of an arm at rest. Puts the offsets that come into `held`; the number of their frames.

    All frames sent must reach the other side unchanged.
    """
    target = line.target
    stand = [joint + offset for joint, offset in zip(joints, held, strict=True)]
    # In offset mode the drives are upstream, beside the controller; their frames pass to the other side unchanged.
    feedback = [part.frame(stand, kind, line.noise) for part in FEEDBACK]
    for frame in feedback:
        target.upstream.send(frame)
    for frame in feedback:
        while (passed := target.downstream.recv(ARRIVES_WITHIN_S)) is not None:
            if passed.arbitration_id == frame.arbitration_id:
                break
        assert_same(passed, frame)
    sent = [part.frame(joints, kind, line.noise) for part in line.targets]
    for got, frame in zip(line.through(sent), sent, strict=True):
        assert_same(got, frame)
    target.send(0x600 + target.node_id, [0x40, 0x01, 0x20, 0x03, 0, 0, 0, 0])
    frames = 0
    while True:
        got = target.upstream.recv(ARRIVES_WITHIN_S)
        assert got is not None, "no answer"
        if got.arbitration_id == 0x580 + target.node_id:
            return frames
        for part in line.offsets:
            if got.arbitration_id == part.identifier:
                assert (got.is_fd, got.bitrate_switch, len(got.data)) == (part.is_fd, part.is_fd, part.length)
                for axis, value in part.values(got).items():
                    held[axis] = value
                frames += 1


def test_fd_offsets_follow_the_table_and_targets_pass_unchanged(offset_fd: Line) -> None:
    held = [0] * 6
    give_up = time.monotonic() + ARRIVES_WITHIN_S
    while offset_cycle(offset_fd, at_cycle(0), held, (True, False)) == 0:
        assert time.monotonic() < give_up, "no offsets although the arm stands"

    def whole_cycle(joints: list[int], kind: tuple[bool, bool]) -> None:
        while offset_cycle(offset_fd, joints, held, kind) < len(offset_fd.offsets):
            assert offset_fd.target.sets_excused > 0, (
                "offsets of a whole set did not come, and nothing halted"
            )
            offset_fd.target.sets_excused -= 1

    cycle_until(offset_fd.target, ACTIVE, lambda: whole_cycle(at_cycle(0), (True, False)))
    assert held == pytest.approx(wanted(at_cycle(0)), abs=2)
    for number, kind in enumerate(2 * KINDS, 1):
        whole_cycle(at_cycle(number), kind)
        assert held == pytest.approx(wanted(at_cycle(number)), abs=2)
