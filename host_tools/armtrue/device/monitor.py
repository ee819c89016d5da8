"""Live view of a compensator: targets, corrections, limits, counters and bus load."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import can
from rich.console import Group
from rich.table import Table
from rich.text import Text

from armtrue.device.bus_load import frame_seconds
from armtrue.device.compensator import BUS_STATES, COMPENSATOR_STATES, MODES, Compensator, name_of
from armtrue.device.cycle_frames import CycleFrames
from armtrue.device.recording import Recording
from armtrue.device.sdo import SdoClient

# CycleFlags of firmware/core/compensator.h, in bit order.
CLAMP_WORDS = (
    "magnitude limited", "rate limited", "near singular", "outside coverage", "input saturated", "output saturated",
)  # fmt: skip
_COUNTERS = (
    "Cycles", "Clamped", "Stale", "Refused", "Sets withheld", "Repeated frames", "Malformed frames",
    "Worst cycle (us)",
)  # fmt: skip

# Source of a snapshot's joint values: the frames of one cycle, or objects that were read one after another.
FRAMES, SAMPLES = "frames", "samples"


@dataclass(frozen=True)
class Snapshot:
    """State of device and bus at one moment."""

    seconds: float
    state: str
    mode: str
    trial: bool
    streaming: bool
    targets: list[int]  # increments
    corrections: list[int]  # increments
    targets_from: str  # FRAMES or SAMPLES; if both are FRAMES, targets and corrections are of the same cycle
    corrections_from: str
    clamps: list[str]  # of any joint, in the last cycle
    clamped_cycles: list[int]  # since its start, by joint
    counters: dict[str, int]
    bus_state: str  # of the bus that this host is on
    downstream_bus_state: str
    downstream_frames: int  # received and sent there; 0: the device has no such port, or nothing is on it
    bus_load: float  # share of the nominal bit rate since the last snapshot
    frames_per_second: float


class Monitor:
    """Takes snapshots over one bus; all frames are counted, and recorded if there is a `recording`."""

    def __init__(
        self,
        bus: can.BusABC,
        node_id: int,
        timeout_s: float,
        bitrate: int,
        data_bitrate: int,
        recording: Recording | None = None,
    ) -> None:
        """Find the device. Raises as Compensator.greet; the recording is kept once the device has answered."""
        self._bus = _Watched(bus, (bitrate, data_bitrate), recording)
        self._device = Compensator(SdoClient(self._bus, node_id, timeout_s))
        self._device.greet()
        if recording is not None:
            recording.keep()
        self._joints = self._device.read_number("Compensator status.Joint count")
        self._mapped_while: tuple[int, int] | None = None
        self._joint_path(*self._mode_and_bits())

    def snapshots(self, period_s: float, duration_s: float | None) -> Iterator[Snapshot]:
        """One snapshot per period, and one at the end of the duration (None: endless)."""
        begin = last = time.monotonic()
        end = float("inf") if duration_s is None else begin + duration_s
        while last < end:
            self._bus.watch_until(min(last + period_s, end))
            now = time.monotonic()
            yield self._take(now - begin, now - last)
            last = now

    def _take(self, seconds: float, elapsed_s: float) -> Snapshot:
        load, frames = self._bus.seconds / elapsed_s, self._bus.frames / elapsed_s
        self._bus.seconds, self._bus.frames = 0.0, 0
        read = self._device.read_number
        mode, bits = self._mode_and_bits()
        targets, corrections = self._joint_path(mode, bits)
        flags = read("Compensator status.Correction clamp bits")
        downstream = ("Frames received", "Frames sent")
        return Snapshot(
            seconds=seconds,
            state=name_of(COMPENSATOR_STATES, read("Compensator status.State")),
            mode=name_of(MODES, mode),
            trial=bool(bits & 1 << 2),
            streaming=bool(bits & 1 << 1),
            targets=targets or self._sample("target position"),
            corrections=corrections or self._sample("position offset"),
            targets_from=FRAMES if targets else SAMPLES,
            corrections_from=FRAMES if corrections else SAMPLES,
            clamps=[word for bit, word in enumerate(CLAMP_WORDS) if flags & 1 << bit],
            clamped_cycles=[
                read(f"Clamped cycles by axis.Clamped cycles of axis {axis}")
                for axis in range(1, self._joints + 1)
            ],
            counters={name: read(f"Compensator status.{name}") for name in _COUNTERS},
            bus_state=name_of(BUS_STATES, read("Upstream bus status.Bus state")),
            downstream_bus_state=name_of(BUS_STATES, read("Downstream bus status.Bus state")),
            downstream_frames=sum(read(f"Downstream bus status.{name}") for name in downstream),
            bus_load=load,
            frames_per_second=frames,
        )

    def _mode_and_bits(self) -> tuple[int, int]:
        read = self._device.read_number
        return read("Compensator control.Mode"), read("Compensator status.Status bits")

    def _sample(self, name: str) -> list[int]:
        return [self._device.read_number(f"Axis {axis} {name} (inc)") for axis in range(1, self._joints + 1)]

    def _joint_path(self, mode: int, bits: int) -> tuple[list[int] | None, list[int] | None]:
        """Targets and corrections from the frames since the last snapshot; None for those without frames."""
        seen = self._bus.cycles
        if (mode, bits & 1) != self._mapped_while:
            # The PDO mapping is read once, and again when the mode or status bit 0 (mapping complete) changes.
            self._mapped_while = (mode, bits & 1)
            self._bus.cycles = CycleFrames(self._device.client, self._joints)
        if seen is None:
            return None, None
        targets, corrections = seen.pair or (seen.targets, None if seen.targets else seen.corrections)
        seen.forget()
        return targets, corrections


class _Watched:
    """A bus whose frames, received and sent, are also counted, recorded, and searched for joint values.

    `frames` and `seconds`: how many there were, and for how long they occupied the bus.
    """

    def __init__(self, bus: can.BusABC, bitrates: tuple[int, int], recording: Recording | None) -> None:
        self._bus, self._bitrates, self._recording = bus, bitrates, recording
        self.cycles: CycleFrames | None = None
        self.seconds, self.frames = 0.0, 0

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As can.BusABC.recv."""
        message = self._bus.recv(timeout)
        if message is None:
            if self._recording is not None:
                self._recording.settle()
            return None
        self._count(message)
        if self._recording is not None:
            self._recording.received(message)
        if self.cycles is not None:
            self.cycles.take(message)
        return message

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """As can.BusABC.send; sent frames occupy the bus as well."""
        # Recorded before it is sent: an answer or Ctrl-C may arrive before `send` returns.
        if self._recording is not None:
            self._recording.sent(msg, time.time())
        try:
            self._bus.send(msg, timeout)
        except can.CanError:
            if self._recording is not None:
                self._recording.withdraw()
            raise
        self._count(msg)

    def _count(self, message: can.Message) -> None:
        self.seconds += frame_seconds(message, *self._bitrates)
        self.frames += 1

    def watch_until(self, moment: float) -> None:
        """Take frames until a time of time.monotonic()."""
        while (rest := moment - time.monotonic()) > 0:
            self.recv(rest)


def draw(snapshot: Snapshot) -> Group:
    """A snapshot as a terminal page."""
    head = Text()
    head.append(f"{snapshot.state}", style="bold green" if snapshot.state == "active" else "bold yellow")
    head.append(f"   mode {snapshot.mode}   {'streaming' if snapshot.streaming else 'no joint commands'}")
    if snapshot.trial:
        head.append("   ON TRIAL", style="bold magenta")
    head.append(
        f"\nbus {snapshot.bus_state}, load {100 * snapshot.bus_load:.1f} %, {snapshot.frames_per_second:.0f} frames/s"
        f"   downstream {snapshot.downstream_bus_state}, {snapshot.downstream_frames} frames in all"
    )
    axes = Table(box=None, pad_edge=False, header_style="bold")
    for header in ("axis", "target (inc)", "correction (inc)", "clamped cycles"):
        axes.add_column(header, justify="right")
    rows = zip(snapshot.targets, snapshot.corrections, snapshot.clamped_cycles, strict=True)
    for axis, (target, correction, clamped) in enumerate(rows, 1):
        axes.add_row(str(axis), f"{target:,}", f"{correction:+,}", f"{clamped:,}")
    sources = Text(_sources(snapshot), style="dim")
    clamps = Text("limits: " + (", ".join(snapshot.clamps) or "none"), style="red" if snapshot.clamps else "")
    counters = Text("  ".join(f"{name} {value}" for name, value in snapshot.counters.items()), style="dim")
    return Group(head, axes, sources, clamps, counters)


def _sources(snapshot: Snapshot) -> str:
    frames, samples = "of one cycle, from its frames", "sampled one after another by SDO"
    if snapshot.targets_from == snapshot.corrections_from:
        return frames if snapshot.targets_from == FRAMES else f"{samples}: not of one cycle"
    if snapshot.targets_from == FRAMES:
        return f"targets {frames}; corrections {samples}"
    return f"corrections {frames}; targets {samples}"
