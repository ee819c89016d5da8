"""The loop's processes lose no frame, however long they wait for a core."""

from __future__ import annotations

import threading
import time

import can
from armtrue_loop.network import open_network
from armtrue_loop.wiring import CONTROLLER_BUS

FLOOD, LAST = 0x123, 0x124
FRAMES = 5000


def test_blocked_process_receives_a_frame_behind_5000_others() -> None:
    network = open_network(CONTROLLER_BUS)
    goes_on, heard = threading.Event(), threading.Event()
    network.subscribe(FLOOD, lambda *_: goes_on.wait())
    network.subscribe(LAST, lambda *_: heard.set())
    try:
        with can.Bus(interface="socketcan", channel=CONTROLLER_BUS) as sender:
            for _ in range(FRAMES):
                sender.send(can.Message(arbitration_id=FLOOD, data=bytes(8), is_extended_id=False), 10.0)
            sender.send(can.Message(arbitration_id=LAST, is_extended_id=False), 10.0)
            time.sleep(0.1)
        goes_on.set()
        assert heard.wait(30.0)
    finally:
        goes_on.set()
        network.disconnect()
