"""The loop's processes hear everything, however long they wait for a core."""

from __future__ import annotations

import threading
import time

import can
from armtrue_loop.network import open_network
from armtrue_loop.wiring import CONTROLLER_BUS

FLOOD, LAST = 0x123, 0x124
FRAMES = 5000


def test_what_comes_behind_an_upload_is_heard_by_a_process_that_stood_still() -> None:
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
