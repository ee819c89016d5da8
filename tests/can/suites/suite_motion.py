# ruff: noqa: D103 -- a test says what it checks in its name
"""The joint path on any target: corrected targets out, uncorrected positions back, no output for incomplete sets."""

from __future__ import annotations

import functools
import itertools
import math
import struct
import time
from collections.abc import Callable, Iterator

import can
import pytest
from small_table import small_table
from target import ARRIVES_WITHIN_S, FEEDBACK_IDS, NMT_PREOPERATIONAL, NMT_START, TARGET_IDS, Target

TURN = 1 << 20
SYNC = 0x080
OFFSET_IDS = (0x1A0, 0x2A0, 0x3A0)
NO_RTR = 1 << 30
MARK = 0x6E0  # an identifier that no node here uses


def at_cycle(number: int) -> list[int]:
    """Targets of a slow move."""
    return [120_000 + 30 * number * (joint + 1) for joint in range(6)]


def send_targets(target: Target, joints: list[int], pairs: tuple[int, ...] = (0, 1, 2)) -> None:
    for pair in pairs:
        target.send(TARGET_IDS[pair], struct.pack("<2i", *joints[2 * pair : 2 * pair + 2]))


def released(target: Target) -> dict[int, list[int]]:
    """Joint targets, by pair, that reached the drives' side of all that was sent before.

    MARK, which the device only passes on, is sent last: a target that has not come before it will not come.
    """
    target.send(MARK)
    found = {}
    while True:
        frame = target.downstream.recv(ARRIVES_WITHIN_S)
        assert frame is not None, "a frame of nobody's was not passed on"
        target.note_time()
        if frame.arbitration_id == MARK:
            return found
        if frame.arbitration_id in TARGET_IDS:
            found[TARGET_IDS.index(frame.arbitration_id)] = list(struct.unpack("<2i", frame.data))


def cycle(target: Target, joints: list[int], pairs: tuple[int, ...] = (0, 1, 2)) -> dict[int, list[int]]:
    """Send SYNC and targets; the targets that came out."""
    target.send(SYNC)
    send_targets(target, joints, pairs)
    return released(target)


def whole_cycle(target: Target, joints: list[int]) -> dict[int, list[int]]:
    """Send a set that must go out. If this machine halted, the stream was interrupted and the set is sent again."""
    while len(out := cycle(target, joints)) < 3:
        assert target.sets_excused > 0, f"of a whole set {out} went out, and nothing halted"
        target.sets_excused -= 1
    return out


def again_after_halts(scenario: Callable[[Target], None]) -> Callable[[Target], None]:
    """Decorate a scenario that states for each set whether it goes out, which presumes an uninterrupted stream.

    It is repeated if it failed and this machine halted during it for longer than a stream may be silent.
    """

    @functools.wraps(scenario)
    def played(inline: Target) -> None:
        for _ in range(4):
            halts = inline.halts
            try:
                return scenario(inline)
            except AssertionError:
                if inline.halts == halts:
                    raise
            whole_cycle(inline, at_cycle(40))
            inline.quiet()
        return scenario(inline)

    return played


def withheld(target: Target, joints: list[int], pairs: tuple[int, ...] = (0, 1, 2)) -> bool:
    """Send a cycle; whether none of its targets came out."""
    return cycle(target, joints, pairs) == {}


def install_table(target: Target) -> None:
    """Put a new table into force; the node is pre-operational afterwards."""
    target.nmt(NMT_PREOPERATIONAL)
    image = small_table(sequence=target.description.setdefault("sequence", 100) + 1)
    target.description["sequence"] += 1
    target.wait_until_quiet()
    target.device.stage(image, True, lambda _done, _total: None)
    for word in ("vrfy", "cmit", "actv", "cfrm"):
        target.device.command(word)


# 0x2001 sub 1.
PASS_THROUGH, ACTIVE = 0, 2
# Some thirty cycles with their answers; beside thirty busy programs an emulated chip took more than half a minute.
BLENDS_WITHIN_S = 4 * ARRIVES_WITHIN_S


def cycle_until(target: Target, state: int, one_cycle: Callable[[], object]) -> None:
    """Run cycles until the device's correction is in `state`.

    Blending takes the time given in the table, on the device's own clock, not a number of cycles: cycles run as fast
    as this machine can, and twenty of them may take less than twenty milliseconds.
    """
    give_up = time.monotonic() + BLENDS_WITHIN_S
    while (found := target.read(0x2001, 1)) != state:
        assert time.monotonic() < give_up, f"0x2001 sub 1 is {found}, expected {state}"
        one_cycle()


@pytest.fixture
def inline(target: Target) -> Target:
    """Inline mode with a table in force, blended in."""
    install_table(target)
    target.configure(1)
    assert withheld(target, at_cycle(0)), "a stream begins with its second set"
    for number in range(1, 40):
        whole_cycle(target, at_cycle(number))
    cycle_until(target, ACTIVE, lambda: whole_cycle(target, at_cycle(40)))
    return target


def test_targets_are_corrected_by_the_table(inline: Target) -> None:
    joints = at_cycle(41)
    out = whole_cycle(inline, joints)
    for pair in range(3):
        for place in range(2):
            joint = joints[2 * pair + place]
            delta = out[pair][place] - joint
            assert delta != 0
            assert abs(delta) < 1000
            assert math.copysign(1, delta) == -math.copysign(1, math.sin(2 * math.pi * joint / TURN))


def test_feedback_at_corrected_targets_reads_as_commanded(inline: Target) -> None:
    joints = at_cycle(41)
    out = whole_cycle(inline, joints)
    inline.quiet()
    for pair, identifier in enumerate(FEEDBACK_IDS):
        inline.send_from_drives(identifier, struct.pack("<2i", *out[pair]))
        assert list(struct.unpack("<2i", inline.expect(identifier))) == joints[2 * pair : 2 * pair + 2]


@again_after_halts
def test_lost_target_withholds_its_set_and_the_next(inline: Target) -> None:
    before = inline.read(0x2001, 8)
    assert withheld(inline, at_cycle(41), pairs=(0, 2))
    assert withheld(inline, at_cycle(42)), "the frame could have been late, not lost"
    assert len(cycle(inline, at_cycle(43))) == 3
    assert inline.read(0x2001, 8) == before + 2


@again_after_halts
def test_late_target_is_not_used_in_the_next_set(inline: Target) -> None:
    assert withheld(inline, at_cycle(41), pairs=(0, 1))
    inline.send(SYNC)
    send_targets(inline, at_cycle(41), pairs=(2,))
    send_targets(inline, at_cycle(42))
    assert released(inline) == {}
    assert withheld(inline, at_cycle(43))
    assert len(cycle(inline, at_cycle(44))) == 3


@again_after_halts
def test_second_controllers_targets_are_dropped_and_reported(inline: Target) -> None:
    cycle(inline, at_cycle(41))
    send_targets(inline, [99, 98, 97, 96, 95, 94])
    assert released(inline) == {}
    until_emergency(inline, 0xFF14)


@again_after_halts
def test_a_repeated_target_changes_nothing(inline: Target) -> None:
    before = inline.read(0x2001, 8)
    assert len(cycle(inline, at_cycle(41), pairs=(0, 0, 1, 2))) == 3
    assert len(cycle(inline, at_cycle(42))) == 3
    assert inline.read(0x2001, 8) == before


@again_after_halts
def test_stopped_commands_are_reported_until_they_resume(inline: Target) -> None:
    # The stale time-out, written while commands come: short for this test, longer than a slow emulator's cycle.
    assert inline.write(0x2000, 3, 900_000, 4) == 0
    cycle(inline, at_cycle(41))
    until_emergency(inline, 0xFF10)
    assert released(inline) == {}
    assert withheld(inline, at_cycle(42))
    assert len(cycle(inline, at_cycle(43))) == 3
    until_emergency(inline, 0)


def until_emergency(target: Target, code: int) -> None:
    """Wait for an emergency with this code; on a slow machine another late command may have caused others before."""
    for _ in range(6):
        emergency = target.expect(0x80 + target.node_id)
        if int.from_bytes(emergency[:2], "little") == code:
            return
    pytest.fail(f"no emergency {code:#06x} among six")


@again_after_halts
def test_pre_operational_holds_targets_back(inline: Target) -> None:
    inline.nmt(NMT_PREOPERATIONAL)
    inline.quiet(inline.downstream)
    assert withheld(inline, at_cycle(41))
    inline.nmt(NMT_START)
    inline.quiet(inline.downstream)
    assert withheld(inline, at_cycle(42))
    assert len(cycle(inline, at_cycle(43))) == 3


def test_unrelated_frames_pass_bit_identical(inline: Target) -> None:
    frames = [
        can.Message(arbitration_id=0x77E - k, data=bytes(range(k, k + k % 9)), is_extended_id=False)
        for k in range(12)
    ]
    frames += [
        can.Message(arbitration_id=0x1ABCDE00 + k, data=[k] * 8, is_extended_id=True) for k in range(4)
    ]
    frames.append(can.Message(arbitration_id=TARGET_IDS[0], data=bytes(8), is_extended_id=True))
    if inline.has_fd:
        data = bytes(range(48))
        frames.append(
            can.Message(
                arbitration_id=0x456, data=data, is_fd=True, bitrate_switch=True, is_extended_id=False
            )
        )
    for source, sink in ((inline.upstream, inline.downstream), (inline.downstream, inline.upstream)):
        inline.quiet(sink)
        for sent in frames:
            source.send(sent)
            got = inline.passed_on(sink)
            assert got is not None
            assert got.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)


def test_disabling_in_motion_blends_the_correction_out(inline: Target) -> None:
    numbers = itertools.count(41)
    deltas: list[list[int]] = []

    def one_cycle() -> None:
        joints = at_cycle(next(numbers))
        out = whole_cycle(inline, joints)
        deltas.append(
            [out[pair][place] - joints[2 * pair + place] for pair in range(3) for place in range(2)]
        )

    one_cycle()
    assert inline.write(0x2000, 2, 0, 1) == 0
    cycle_until(inline, PASS_THROUGH, one_cycle)
    assert min(map(abs, deltas[0])) > 50
    assert deltas[-1] == [0] * 6
    for before, after in itertools.pairwise(deltas):
        assert max(abs(new - old) for new, old in zip(after, before, strict=True)) < 60
    inline.nmt(NMT_PREOPERATIONAL)
    inline.wait_until_quiet()
    assert inline.write(0x2000, 2, 1, 1) == 0


class OffsetDrives:
    """Six ideal drives and their controller on the device's bus; a drive holds its offset until the next one comes."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self.held = [0] * 6
        self.steps: list[int] = []  # largest change of an offset, frame by frame

    def listen(self) -> int:
        """Take the offsets sent so far; the number of frames."""
        frames = 0
        self.target.send(0x600 + self.target.node_id, [0x40, 0x01, 0x20, 0x03, 0, 0, 0, 0])
        while True:
            frame = self.target.upstream.recv(ARRIVES_WITHIN_S)
            assert frame is not None, "no answer"
            self.target.note_time()
            if frame.arbitration_id == 0x580 + self.target.node_id:
                return frames
            if frame.arbitration_id not in OFFSET_IDS:
                continue
            pair = OFFSET_IDS.index(frame.arbitration_id)
            offsets = struct.unpack("<2i", frame.data)
            before = self.held[2 * pair : 2 * pair + 2]
            self.steps.append(max(abs(new - old) for new, old in zip(offsets, before, strict=True)))
            self.held[2 * pair : 2 * pair + 2] = offsets
            frames += 1

    def cycle(self, joints: list[int], *, feedback: bool = True) -> int:
        """Send SYNC, positions of an arm at rest at the targets, and targets; the number of offset frames that came."""
        self.target.send(SYNC)
        for pair, identifier in enumerate(FEEDBACK_IDS if feedback else ()):
            stand = [joints[k] + self.held[k] for k in (2 * pair, 2 * pair + 1)]
            self.target.send(identifier, struct.pack("<2i", *stand))
        send_targets(self.target, joints)
        return self.listen()

    def whole_cycle(self, joints: list[int]) -> None:
        """Send a set whose offsets must come, as `whole_cycle` above."""
        while (frames := self.cycle(joints)) < 3:
            assert self.target.sets_excused > 0, (
                f"{frames} frames with offsets, expected 3, and nothing halted"
            )
            self.target.sets_excused -= 1

    def begin(self, joints: list[int]) -> None:
        """Send cycles at rest until offsets come."""
        give_up = time.monotonic() + ARRIVES_WITHIN_S
        while self.cycle(joints) == 0:
            assert time.monotonic() < give_up, "no offsets although the arm stands"

    def settle(self, joints: list[int]) -> None:
        """Send cycles at rest until the drives hold the full correction at `joints`."""
        cycle_until(self.target, ACTIVE, lambda: self.whole_cycle(joints))


@pytest.fixture
def offset(target: Target) -> Iterator[OffsetDrives]:
    """Offset mode with a table in force, the correction settled at one place."""
    install_table(target)
    target.reset()  # it was activated in inline mode, which cannot be left while drives may hold a correction
    for pair, identifier in enumerate(OFFSET_IDS):
        assert target.write(0x1800 + pair, 1, identifier | NO_RTR, 4) == 0
    target.configure(2)
    drives = OffsetDrives(target)
    drives.begin(at_cycle(0))
    drives.settle(at_cycle(0))
    assert max(map(abs, drives.held)) > 50
    yield drives
    target.nmt(NMT_PREOPERATIONAL)
    target.wait_until_quiet()
    for pair in range(3):
        assert target.write(0x1800 + pair, 1, 1 << 31 | NO_RTR | OFFSET_IDS[pair], 4) == 0


def test_offsets_follow_the_table_once_for_each_set(offset: OffsetDrives) -> None:
    for number in range(1, 20):
        joints = at_cycle(number)
        offset.whole_cycle(joints)
        for joint, held in zip(joints, offset.held, strict=True):
            assert math.copysign(1, held) == -math.copysign(1, math.sin(2 * math.pi * joint / TURN))
    offset.target.send(SYNC)
    assert offset.listen() == 0, "no set, no offset"


def test_leaving_operational_returns_the_offsets_to_zero(offset: OffsetDrives) -> None:
    offset.steps.clear()
    offset.target.nmt(NMT_PREOPERATIONAL)
    give_up = time.monotonic() + ARRIVES_WITHIN_S
    while any(offset.held):
        offset.listen()
        assert time.monotonic() < give_up, f"still held: {offset.held}"
    assert max(offset.steps) <= 106, "0.1 turn per second"


def test_disabling_at_rest_returns_the_offsets_to_zero(offset: OffsetDrives) -> None:
    offset.target.wait_until_quiet()
    held = list(offset.held)
    assert offset.target.write(0x2000, 2, 0, 1) == 0
    give_up = time.monotonic() + ARRIVES_WITHIN_S
    while any(offset.held):
        offset.listen()
        assert time.monotonic() < give_up, f"still held: {offset.held}"
    offset.target.wait_until_quiet()
    assert offset.target.write(0x2000, 2, 1, 1) == 0
    offset.begin(at_cycle(0))
    offset.settle(at_cycle(0))
    assert offset.held == held


def test_restarted_node_starts_from_the_offsets_in_the_drives(offset: OffsetDrives) -> None:
    target, held = offset.target, list(offset.held)
    # As after a power cut: the node has lost its state, the drives still hold their offsets.
    target.nmt(NMT_PREOPERATIONAL)
    target.reset()
    for pair, identifier in enumerate(OFFSET_IDS):
        assert target.write(0x1800 + pair, 1, identifier | NO_RTR, 4) == 0
    target.configure(2)
    offset.held = list(held)
    assert target.read(0x2001, 2) & 1 << 4, "not known"
    offset.steps.clear()
    offset.begin(at_cycle(0))
    assert not target.read(0x2001, 2) & 1 << 4
    offset.settle(at_cycle(0))
    assert max(offset.steps) <= 3
    assert offset.held == pytest.approx(held, abs=1)
