"""A node with a table in force and its targets mapped, as the measurements of latency need it."""

from __future__ import annotations

import can
from armtrue.device import Compensator, SdoClient
from node_process import NODE_ID
from small_table import small_table

TARGET_IDS = (0x220, 0x320, 0x420)
OFFSET_IDS = (0x1A0, 0x2A0, 0x3A0)
NO_RTR = 0x40000000
INLINE, OFFSET = 1, 2


def put_to_work(bus: can.BusABC, mode: int, timeout_s: float) -> Compensator:
    """Install small_table(), map two axes to each target PDO (and offset PDO), and start the node.

    timeout_s: for each SDO answer. Errors: as armtrue.device.Compensator has them.
    """
    client = SdoClient(bus, NODE_ID, timeout_s)
    device = Compensator(client)
    device.stage(small_table(), True, lambda _done, _total: None)
    for word in ("vrfy", "cmit", "actv", "cfrm"):
        device.command(word)
    for pair, identifier in enumerate(TARGET_IDS):
        client.download(0x1400 + pair, 1, identifier.to_bytes(4, "little"))
    for pair, identifier in enumerate(OFFSET_IDS if mode == OFFSET else ()):
        client.download(0x1800 + pair, 1, (NO_RTR | identifier).to_bytes(4, "little"))
    for sub in (3, 4):  # a late cycle must not end the stream
        client.download(0x2000, sub, (1_000_000).to_bytes(4, "little"))
    client.download(0x2000, 1, bytes([mode]))
    bus.send(can.Message(arbitration_id=0, data=[1, NODE_ID], is_extended_id=False))
    return device
