"""Joint values of one cycle assembled from frames that arrive one by one, late, or not at all."""

from __future__ import annotations

import struct

import can
import pytest

from armtrue.device.cycle_frames import CycleFrames

INVALID = 1 << 31


class Device:
    """Three target RPDOs of two axes each, the offsets of all six in one TPDO of 24 bytes; other PDOs are invalid."""

    def __init__(self, window_us: int = 500) -> None:
        self.objects = {(0x2000, 4): window_us, (0x1005, 0): 0x80}
        for pair in range(3):
            self.objects[0x1400 + pair, 1] = 0x220 + 0x100 * pair
            self.objects[0x1600 + pair, 0] = 2
            for sub in (1, 2):
                self.objects[0x1600 + pair, sub] = 0x607A0020 + (2 * pair + sub - 1) * 0x08000000
        # An RPDO of controlword and target velocity: neither is a target position.
        self.objects |= {(0x1403, 1): 0x520, (0x1603, 0): 2, (0x1603, 1): 0x60400010, (0x1603, 2): 0x60FF0020}
        self.objects |= {(0x1800, 1): 0x1A0, (0x1A00, 0): 6}
        self.objects |= {(0x1A00, 1 + axis): 0x60B00020 + axis * 0x08000000 for axis in range(6)}

    def upload(self, index: int, sub: int) -> bytes:
        return self.objects.get((index, sub), INVALID).to_bytes(4, "little")


def following(device: Device) -> CycleFrames:
    return CycleFrames(device, 6)  # type: ignore[arg-type]


def targets(cycle: int, pair: int, stamp: float) -> can.Message:
    data = struct.pack("<2i", 100 * cycle + 2 * pair, 100 * cycle + 2 * pair + 1)
    return can.Message(arbitration_id=0x220 + 0x100 * pair, is_extended_id=False, data=data, timestamp=stamp)


def offsets(cycle: int, stamp: float) -> can.Message:
    data = struct.pack("<6i", *(-100 * cycle - axis for axis in range(6)))
    return can.Message(arbitration_id=0x1A0, is_extended_id=False, data=data, is_fd=True, timestamp=stamp)


def sync(stamp: float) -> can.Message:
    return can.Message(arbitration_id=0x80, is_extended_id=False, timestamp=stamp)


def wanted(cycle: int) -> list[int]:
    return [100 * cycle + axis for axis in range(6)]


def test_targets_are_paired_with_corrections_of_their_own_cycle() -> None:
    seen = following(Device())
    for cycle in range(1, 7):
        for pair in (1, 0, 2):
            seen.take(targets(cycle, pair, 0.1 * cycle))
        seen.take(offsets(cycle, 0.1 * cycle))
    seen.take(targets(7, 0, 0.7))
    assert seen.pair == (wanted(6), [-value for value in wanted(6)])
    seen.forget()
    assert (seen.pair, seen.targets, seen.corrections) == (None, None, None)


def take_cycle(seen: CycleFrames, cycle: int, answers: tuple[int, ...]) -> None:
    for pair in range(3):
        seen.take(targets(cycle, pair, 0.1 * cycle))
    for answer in answers:
        seen.take(offsets(answer, 0.1 * cycle))


@pytest.mark.parametrize(
    "late",
    [
        {8: (), 9: (8, 9)},
        {8: (), 9: (8,), 10: (9,), 11: (10, 11)},
        {8: (), 9: (), 10: (8, 9, 10)},
        {8: (), 9: (), 10: (8, 9), 11: (10,), 12: (11, 12)},
    ],
)
def test_late_corrections_are_never_paired_with_another_cycle(
    late: dict[int, tuple[int, ...]],
) -> None:
    seen = following(Device())
    pairs = []
    for cycle in range(1, 20):
        seen.forget()
        take_cycle(seen, cycle, late.get(cycle, (cycle,)))
        if seen.pair is not None:
            pairs.append(seen.pair)
    assert pairs
    assert all([-value for value in asked] == answered for asked, answered in pairs)
    assert pairs[-1][0] == wanted(18), "the last cycle's offsets may still come"


def test_offsets_sent_twice_per_cycle_are_not_paired() -> None:
    seen = following(Device())
    for cycle in range(1, 9):
        take_cycle(seen, cycle, (cycle, cycle))
    assert seen.pair is None


def test_listening_from_mid_set_yields_only_whole_sets() -> None:
    seen = following(Device())
    shown = []
    for cycle in range(1, 9):
        for pair in range(3):
            if cycle > 1 or pair > 0:
                seen.forget()
                seen.take(targets(cycle, pair, 0.001 * cycle + 5e-5 * pair))
                shown.append(seen.targets)
    assert shown[-1] == wanted(8)
    assert all(
        values in (None, wanted(cycle)) for values in shown[8:] for cycle in [(values or [0])[0] // 100]
    )


def test_corrections_after_an_incomplete_set_are_not_paired() -> None:
    seen = following(Device())
    seen.take(targets(1, 0, 0.1))
    seen.take(offsets(1, 0.1))
    assert seen.pair is None
    assert seen.corrections == [-value for value in wanted(1)]


@pytest.mark.parametrize("divide", ["sync", "repeat", "time"])
def test_lost_frame_is_not_replaced_by_one_of_the_next_cycle(divide: str) -> None:
    seen = following(Device())
    seen.take(targets(1, 1, 0.100))
    seen.take(targets(1, 2, 0.100))
    if divide == "sync":
        seen.take(sync(0.101))
    if divide == "repeat":
        seen.take(targets(2, 1, 0.101))
        seen.take(targets(2, 2, 0.101))
    seen.take(targets(2, 0, 0.101 if divide != "time" else 0.106))
    assert seen.targets == (wanted(2) if divide == "repeat" else None)


def test_two_incomplete_cycles_are_not_merged_into_one_set() -> None:
    seen = following(Device())
    for cycle, pair in ((1, 0), (1, 1), (2, 0), (2, 2)):
        seen.take(targets(cycle, pair, 0.1))
    assert seen.targets is None


def test_set_window_of_the_device_is_used_if_longer() -> None:
    seen = following(Device(window_us=20_000))
    for pair in range(3):
        seen.take(targets(1, pair, 0.1 + 0.009 * pair))
    assert seen.targets == wanted(1)


def test_short_frame_is_not_taken_as_a_target() -> None:
    seen = following(Device())
    short = targets(1, 0, 0.1)
    short.data = short.data[:7]
    for message in (short, targets(1, 1, 0.1), targets(1, 2, 0.1)):
        seen.take(message)
    assert seen.targets is None


@pytest.mark.parametrize(
    "change", [{"is_extended_id": True}, {"is_remote_frame": True}, {"is_error_frame": True}]
)
def test_extended_remote_and_error_frames_are_ignored(change: dict[str, bool]) -> None:
    seen = following(Device())
    foreign = targets(2, 2, 0.1)
    for name, value in change.items():
        setattr(foreign, name, value)
    for message in (targets(1, 0, 0.1), targets(1, 1, 0.1), foreign):
        seen.take(message)
    assert seen.targets is None


def test_no_targets_are_shown_if_a_joint_is_not_mapped() -> None:
    device = Device()
    device.objects[0x1402, 1] = INVALID | 0x420
    seen = following(device)
    for pair in range(3):
        seen.take(targets(1, pair, 0.1))
    assert seen.targets is None


@pytest.mark.parametrize("has_all", [0, 1], ids=["not said", "said by the device"])
def test_axis_without_a_drive_is_not_waited_for(has_all: int) -> None:
    device = Device()
    device.objects[0x1602, 0] = 1  # axis 6 has no target
    device.objects[0x2001, 2] = has_all
    seen = following(device)
    for pair in range(3):
        seen.take(targets(1, pair, 0.001 + 5e-5 * pair))
    assert seen.targets == ([*wanted(1)[:5], 0] if has_all else None)
