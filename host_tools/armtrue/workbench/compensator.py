"""The compensator on a CAN bus: activation of tables, and a live view of its state."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can

from armtrue.device import CommunicationError, Compensator, DeviceRefusedError, SdoAbortError, SdoClient
from armtrue.device import upload_image as bring_into_force
from armtrue.device.image import read_image
from armtrue.device.monitor import Monitor, Snapshot
from armtrue.errors import InputError
from armtrue.progress import Progress
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import minus, table
from armtrue.workbench.showing.elements import button

PERIOD_S = 0.5
# The live view ends, and frees the bus, when no page has asked for it for this long.
_UNWATCHED_S = 3.0
_NOMINAL_BITRATE = 1_000_000
_HOW = "Upload brings this model's tables into force on trial; Confirm keeps them, Revert takes them back."


class Device:
    """One compensator. The bus is opened for each task, and while a page watches."""

    def __init__(self, opened: Callable[[], can.BusABC], name: str, node: int, timeout_s: float) -> None:
        self.name = name
        self._open, self._node, self._timeout_s = opened, node, timeout_s
        self._bus = threading.Lock()
        self._state = threading.Lock()
        self._watcher: threading.Thread | None = None
        self._asked = 0.0
        self._snapshot: Snapshot | None = None
        self._failure = ""
        self._wanted_elsewhere = threading.Event()
        self._is_closed = False

    def upload(self, image: bytes, progress: Progress) -> str:
        """Activate a table image on trial; returns a sentence on the result. Errors: InputError in one sentence."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "tables.bin"
            path.write_bytes(image)
            info = read_image(path)
        with self._device() as device:
            result = bring_into_force(
                device,
                info,
                lambda step: progress(0.0, f"{step.name} {step.note}"),
                lambda done, total: progress(done / max(1, total), "transferring"),
            )
        trial = ", on trial until it is reset or confirmed" if result.on_trial else ""
        return f"Export {info.sequence} is in force on the device{trial}."

    def order(self, word: str) -> None:
        """Send one of the device's commands, such as `cfrm`. Errors: InputError in one sentence."""
        with self._device() as device:
            device.command(word)

    def view(self) -> tuple[Snapshot | None, str]:
        """The last snapshot of the device, and its failure if any; starts the live view if none runs."""
        with self._state:
            self._asked = time.monotonic()
            is_watched = self._watcher is not None and self._watcher.is_alive()
            if not is_watched and not self._is_closed:
                self._watcher = threading.Thread(target=self._watch, name="workbench device", daemon=True)
                self._watcher.start()
            return self._snapshot, self._failure

    def close(self) -> None:
        """End the live view; a page that asks later does not start it again."""
        with self._state:
            self._is_closed = True
        self._wanted_elsewhere.set()
        if self._watcher is not None:
            self._watcher.join()

    def _watch(self) -> None:
        try:
            with self._own_bus() as bus:
                monitor = Monitor(bus, self._node, self._timeout_s, _NOMINAL_BITRATE, _NOMINAL_BITRATE)
                for snapshot in monitor.snapshots(PERIOD_S, None):
                    with self._state:
                        self._snapshot, self._failure = snapshot, ""
                    unwatched = time.monotonic() - self._asked > _UNWATCHED_S
                    if unwatched or self._wanted_elsewhere.is_set():
                        return
        except InputError as error:
            with self._state:
                self._snapshot, self._failure = None, str(error)

    @contextmanager
    def _device(self) -> Iterator[Compensator]:
        """The device, on the bus that the live view releases for it."""
        self._wanted_elsewhere.set()
        try:
            with self._own_bus() as bus:
                self._wanted_elsewhere.clear()
                device = Compensator(SdoClient(bus, self._node, self._timeout_s))
                device.greet()
                yield device
        finally:
            self._wanted_elsewhere.clear()

    @contextmanager
    def _own_bus(self) -> Iterator[can.BusABC]:
        """The open bus. Errors: InputError for all that can go wrong on it."""
        with self._bus:
            try:
                bus = self._open()
                try:
                    yield bus
                finally:
                    bus.shutdown()
            except SdoAbortError as refusal:
                raise InputError(f"{self.name}: the device refused: {refusal}") from None
            except (DeviceRefusedError, CommunicationError, can.CanError) as problem:
                raise InputError(f"{self.name}: {' '.join(str(problem).split())}") from None


def device_view(device: Device) -> Markup:
    """The current state, targets, corrections and clamps."""
    snapshot, failure = device.view()
    if snapshot is None:
        return tag("p", failure or f"Waiting for the device on {device.name}.")
    streaming = "joint commands arrive" if snapshot.streaming else "no joint commands arrive"
    trial = ", table on trial" if snapshot.trial else ""
    of_axes = zip(snapshot.targets, snapshot.corrections, snapshot.clamped_cycles, strict=True)
    rows: list[list[Content]] = []
    for axis, (target, correction, clamped) in enumerate(of_axes, start=1):
        rows.append([str(axis), str(target), minus(f"{correction:+d}"), str(clamped)])
    heads = ["axis", "target [increments]", "correction [increments]", "clamped cycles"]
    counted = ", ".join(f"{name.lower()} {value}" for name, value in snapshot.counters.items())
    return tag(
        "div",
        tag("p", tag("b", snapshot.state), f", mode {snapshot.mode}, {streaming}{trial}"),
        table(heads, rows, "The device now"),
        tag("p", f"Limits in the last cycle: {', '.join(snapshot.clamps) or 'none'}."),
        tag("p", f"{counted}; bus load {100.0 * snapshot.bus_load:.1f} %.", class_="lead"),
    )


def device_section(device: Device | None) -> Markup | None:
    """The part of the page for the device; None where no bus was named."""
    if device is None:
        return None
    buttons = [button(text, text.lower()) for text in ("Upload", "Confirm", "Revert")]
    return tag(
        "section",
        tag("h2", f"Device on {device.name}"),
        tag("p", _HOW),
        tag("div", buttons, class_="buttons"),
        tag("div", class_="live", id="live", role="region", aria_label="Device"),
    )
