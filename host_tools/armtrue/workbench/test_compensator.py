"""The end of the live view of the compensator."""

from __future__ import annotations

import threading
import time

import can

from .compensator import Device


def test_closed_device_does_not_restart_its_live_view() -> None:
    opened: list[float] = []

    def open_bus() -> can.BusABC:
        opened.append(time.monotonic())
        raise can.CanError("away")

    device = Device(open_bus, "can0", 32, 0.1)
    device.view()
    while not opened:
        time.sleep(0.001)
    device.close()
    seen = len(opened)
    assert device.view()[1] == "can0: away"
    assert not [thread for thread in threading.enumerate() if thread.name == "workbench device"]
    assert len(opened) == seen
