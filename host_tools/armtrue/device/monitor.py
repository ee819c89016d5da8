"""Watching a compensator live: what is commanded, what is corrected, and how busy the bus is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
from rich.console import Group
from rich.table import Table
from rich.text import Text

from armtrue.device.bus_load import frame_seconds
from armtrue.device.compensator import BUS_STATES, COMPENSATOR_STATES, MODES, Compensator, name_of
from armtrue.device.sdo import SdoClient
from armtrue.errors import InputError

# CycleFlags of firmware/core/compensator.h, in bit order.
CLAMP_WORDS = (
    "magnitude limited", "rate limited", "near singular", "outside coverage", "input saturated", "output saturated",
)  # fmt: skip
_COUNTERS = (
    "Cycles", "Clamped", "Stale", "Refused", "Sets withheld", "Repeated frames", "Malformed frames",
    "Worst cycle (us)",
)  # fmt: skip


@dataclass(frozen=True)
class Snapshot:
    """What was seen at one moment."""

    seconds: float
    state: str
    mode: str
    trial: bool
    streaming: bool
    targets: list[int]  # increments
    corrections: list[int]  # increments
    clamps: list[str]
    counters: dict[str, int]
    bus_state: str
    bus_load: float  # share of the nominal bit rate since the last snapshot
    frames_per_second: float

    def document(self) -> dict[str, Any]:
        """The figures for --json."""
        return dict(vars(self))


class _Tap(can.Listener):
    """Counts what passes, and the time that it took on the wire."""

    def __init__(self, bitrate: int, data_bitrate: int) -> None:
        self._bitrate, self._data_bitrate = bitrate, data_bitrate
        self.seconds = 0.0
        self.frames = 0

    def on_message_received(self, msg: can.Message) -> None:
        self.seconds += frame_seconds(msg, self._bitrate, self._data_bitrate)
        self.frames += 1


class Monitor:
    """Takes snapshots over one bus; everything that passes meanwhile is counted and may be recorded."""

    def __init__(
        self, bus: can.BusABC, node_id: int, bitrate: int, data_bitrate: int, record: Path | None = None
    ) -> None:
        self._tap = _Tap(bitrate, data_bitrate)
        self._logger: can.Listener | None = None
        if record is not None:
            try:
                self._logger = can.Logger(str(record))
            except (ValueError, OSError) as problem:
                raise InputError(f"{record}: cannot be recorded to: {problem}") from None
        self._bus = _Watched(bus, [self._tap, *([self._logger] if self._logger else [])])
        self._device = Compensator(SdoClient(self._bus, node_id))
        self._device.greet()
        self._joints = self._device.read_number("Compensator status.Joint count")

    def snapshots(self, period_s: float, duration_s: float | None) -> Iterator[Snapshot]:
        """One snapshot a period until the duration is over (None: for ever)."""
        begin = last = time.monotonic()
        while duration_s is None or time.monotonic() - begin < duration_s:
            self._bus.watch_until(last + period_s)
            now = time.monotonic()
            yield self._take(now - begin, now - last)
            last = now

    def close(self) -> None:
        """Finish the recording."""
        if self._logger is not None:
            self._logger.stop()

    def _take(self, seconds: float, elapsed_s: float) -> Snapshot:
        load, frames = self._tap.seconds / elapsed_s, self._tap.frames / elapsed_s
        self._tap.seconds, self._tap.frames = 0.0, 0
        read = self._device.read_number
        axes = range(1, self._joints + 1)
        bits = read("Compensator status.Status bits")
        flags = read("Compensator status.Correction clamp bits")
        return Snapshot(
            seconds=seconds,
            state=name_of(COMPENSATOR_STATES, read("Compensator status.State")),
            mode=name_of(MODES, read("Compensator control.Mode")),
            trial=bool(bits & 1 << 2),
            streaming=bool(bits & 1 << 1),
            targets=[read(f"Axis {axis} target position (inc)") for axis in axes],
            corrections=[read(f"Axis {axis} position offset (inc)") for axis in axes],
            clamps=[word for bit, word in enumerate(CLAMP_WORDS) if flags & 1 << bit],
            counters={name: read(f"Compensator status.{name}") for name in _COUNTERS},
            bus_state=name_of(BUS_STATES, read("Upstream bus status.Bus state")),
            bus_load=load,
            frames_per_second=frames,
        )


class _Watched:
    """A bus whose received frames also go to listeners; what the SDO client sends and takes is seen as well."""

    def __init__(self, bus: can.BusABC, listeners: list[can.Listener]) -> None:
        self._bus = bus
        self._listeners = listeners

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As can.BusABC.recv."""
        message = self._bus.recv(timeout)
        if message is not None:
            for listener in self._listeners:
                listener.on_message_received(message)
        return message

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """As can.BusABC.send; what we send occupies the bus as well."""
        self._bus.send(msg, timeout)
        for listener in self._listeners:
            listener.on_message_received(msg)

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
    )
    axes = Table(box=None, pad_edge=False, header_style="bold")
    for header in ("axis", "target (inc)", "correction (inc)"):
        axes.add_column(header, justify="right")
    for axis, (target, correction) in enumerate(zip(snapshot.targets, snapshot.corrections, strict=True), 1):
        axes.add_row(str(axis), f"{target:,}", f"{correction:+,}")
    clamps = Text("limits: " + (", ".join(snapshot.clamps) or "none"), style="red" if snapshot.clamps else "")
    counters = Text("  ".join(f"{name} {value}" for name, value in snapshot.counters.items()), style="dim")
    return Group(head, axes, clamps, counters)
