"""Targets and corrections of one cycle, from the frames that the device's PDO mapping assigns to them."""

from __future__ import annotations

from dataclasses import dataclass

import can

from armtrue.device.sdo import SdoClient

TARGET_POSITION, ACTUAL_POSITION, POSITION_OFFSET = 0x607A, 0x6064, 0x60B0
RECEIVE, TRANSMIT = (0x1400, 0x1600, 19), (0x1800, 0x1A00, 9)  # communication, mapping, number of PDOs
_AXIS_STEP = 0x800
VALUE_BYTES = 4
# Frames of one set lie within this time, or within the device's own set window if that is longer: their timestamps
# may come from an adapter that delivers in batches.
_LEAST_WINDOW_S = 5e-3
# The first frame of a set is known after _PAUSES_KNOWN pauses before each frame of the mapping, if its mean pause is
# more than _STANDS_OUT times the second longest.
_PAUSES_KNOWN, _STANDS_OUT = 2, 3.0
# After this many cycles with one set of offsets each, the device has dropped the earlier targets without offsets.
_STEADY_CYCLES = 5

# Identifier and whether it is extended -> (first byte, axis from 0) of each value.
Mapping = dict[tuple[int, bool], list[tuple[int, int]]]


@dataclass
class _Set:
    """The values of one cycle that have been received so far."""

    begin: float
    seen: set[tuple[int, bool]]
    values: dict[int, int]


@dataclass
class _Pauses:
    """Mean time between one frame of a mapping and the frame of the mapping before it."""

    count: int = 0
    mean_s: float = 0.0

    def add(self, pause_s: float) -> None:
        self.count += 1
        self.mean_s += (pause_s - self.mean_s) / self.count


class FrameSets:
    """Assembles the values of all axes from the frames of one cycle; axes in `absent` have no drive and stay at 0."""

    def __init__(
        self, mapping: Mapping, joints: int, window_s: float, absent: frozenset[int] = frozenset()
    ) -> None:
        self._mapping: Mapping = mapping if axes_of(mapping) >= set(range(joints)) - absent else {}
        self._joints, self._window_s = joints, max(window_s, _LEAST_WINDOW_S)
        self._set: _Set | None = None
        self._last_s: float | None = None
        self._pauses: dict[tuple[int, bool], _Pauses] = {key: _Pauses() for key in self._mapping}

    def belongs(self, message: can.Message) -> bool:
        """Whether this frame is one of the mapping."""
        return (message.arbitration_id, message.is_extended_id) in self._mapping

    @property
    def has_begun(self) -> bool:
        """Whether part of a set has been received."""
        return self._set is not None

    def divide(self) -> None:
        """Drop an incomplete set: the next frame begins a new one."""
        self._set = None

    def take(self, message: can.Message) -> list[int] | None:
        """The values of all axes if this frame completes a set, else None."""
        key = (message.arbitration_id, message.is_extended_id)
        places, data = self._mapping[key], bytes(message.data)
        if len(data) < max(place for place, _ in places) + VALUE_BYTES:
            self.divide()
            return None
        first = self._first_of_a_set(key, message.timestamp)
        if first is not None and (key == first or self._set is None):
            self.divide()
            if key != first:
                return None
        held = self._set
        if held is None or key in held.seen or message.timestamp - held.begin > self._window_s:
            held = self._set = _Set(message.timestamp, set(), {})
        held.seen.add(key)
        for place, axis in places:
            held.values[axis] = int.from_bytes(data[place : place + VALUE_BYTES], "little", signed=True)
        if held.seen != set(self._mapping):
            return None
        self.divide()
        return [held.values.get(axis, 0) for axis in range(self._joints)]

    def _first_of_a_set(self, key: tuple[int, bool], stamp_s: float) -> tuple[int, bool] | None:
        """The frame before which the controller pauses, by the mean pauses so far; None if no frame stands out.

        Otherwise a client that begins to listen within a set would join the end of each set to the beginning of the
        next one, as long as both lie within the window.
        """
        if self._last_s is not None:
            self._pauses[key].add(stamp_s - self._last_s)
        self._last_s = stamp_s
        if len(self._pauses) < 2 or any(p.count < _PAUSES_KNOWN for p in self._pauses.values()):
            return None
        second, longest = sorted(self._pauses, key=lambda k: self._pauses[k].mean_s)[-2:]
        stands_out = self._pauses[longest].mean_s > _STANDS_OUT * self._pauses[second].mean_s
        return longest if stands_out else None


class CycleFrames:
    """Pairs the targets and the offsets of a device's cycles, from their frames.

    Frames of offsets do not name their targets. Offsets are paired with the targets just before them only while no
    earlier targets lack their offsets: a device that is late sends the offsets of one cycle after the targets of the
    next.
    """

    def __init__(self, client: SdoClient, joints: int) -> None:
        """Read from the device which frames carry targets and offsets."""
        window_s = 1e-6 * number_of(client, 0x2000, 4)
        self._sync = number_of(client, 0x1005, 0) & 0x7FF
        targets = mapping_of(client, *RECEIVE, TARGET_POSITION)
        absent = axes_without_drives(client, joints, targets)
        self._targets = FrameSets(targets, joints, window_s, absent)
        self._offsets = FrameSets(mapping_of(client, *TRANSMIT, POSITION_OFFSET), joints, window_s, absent)
        self._asked: list[int] | None = None
        self._answers: list[list[int]] = []  # offsets received since the targets in _asked
        # Earlier sets of targets whose offsets may still arrive; unknown at the start, so one is assumed.
        self._unanswered = 1
        self._steady_cycles = 0
        self.forget()

    def forget(self) -> None:
        """Clear the values seen so far, so that the attributes hold only later ones."""
        self.targets: list[int] | None = None
        self.corrections: list[int] | None = None
        self.pair: tuple[list[int], list[int]] | None = None

    def take(self, message: can.Message) -> None:
        """Process a frame; frames come in the order of the bus."""
        if message.is_error_frame or message.is_remote_frame:
            return
        if message.arbitration_id == self._sync and not message.is_extended_id:
            self._targets.divide()
            self._offsets.divide()
        elif self._targets.belongs(message):
            if not self._targets.has_begun:
                self._conclude()
            whole = self._targets.take(message)
            if whole is not None:
                self.targets = self._asked = whole
        elif self._offsets.belongs(message):
            corrections = self._offsets.take(message)
            if corrections is not None:
                self.corrections = corrections
                self._answers.append(corrections)

    def _conclude(self) -> None:
        """End a cycle, at the first frame of the next targets; pair targets and offsets if they are of one cycle."""
        asked, answers = self._asked, self._answers
        self._asked, self._answers = None, []
        if len(answers) != 1:
            self._unanswered = max(0, self._unanswered + 1 - len(answers))
            self._steady_cycles = 0
        elif self._unanswered > 0:
            self._steady_cycles += 1
            if self._steady_cycles >= _STEADY_CYCLES:
                self._unanswered = 0
        elif asked is not None:
            self.pair = (asked, answers[0])


def number_of(client: SdoClient, index: int, sub: int) -> int:
    """The value of an unsigned object."""
    return int.from_bytes(client.upload(index, sub), "little")


def axes_of(mapping: Mapping) -> set[int]:
    """Axes, from 0, whose object a mapping contains."""
    return {axis for places in mapping.values() for _, axis in places}


def axes_without_drives(client: SdoClient, joints: int, targets: Mapping) -> frozenset[int]:
    """Axes, from 0, that the table in force calls passive: not mapped, although the device reports all targets mapped.

    Without such a table every axis counts as one with a drive.
    """
    has_all = number_of(client, 0x2001, 2) & 1
    return frozenset(set(range(joints)) - axes_of(targets)) if has_all else frozenset()


def mapping_of(client: SdoClient, communication: int, mapping: int, count: int, wanted: int) -> Mapping:
    """Places of one object of the axes in the valid PDOs of one direction."""
    found: Mapping = {}
    for number in range(count):
        identifier = number_of(client, communication + number, 1)
        if identifier & 1 << 31:
            continue
        bit = 0
        for sub in range(1, number_of(client, mapping + number, 0) + 1):
            entry = number_of(client, mapping + number, sub)
            axis, rest = divmod((entry >> 16) - wanted, _AXIS_STEP)
            if 0 <= axis < 8 and rest == 0 and entry & 0xFFFF == 8 * VALUE_BYTES:
                key = (identifier & 0x1FFFFFFF, bool(identifier & 1 << 29))
                found.setdefault(key, []).append((bit // 8, axis))
            bit += entry & 0xFF
    return found
