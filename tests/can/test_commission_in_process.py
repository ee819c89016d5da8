"""What commissioning finds by comparing targets with positions, past an in-process node. It only reads the device."""

from __future__ import annotations

import collections

import can
import pytest
from armtrue.device import Compensator, SdoClient
from armtrue.device.commission import Listener, Report, examine
from in_process import InProcessNode
from node_process import NODE_ID
from wrong_drives import SWING, Drives, configure, cycle_frames

pytestmark = pytest.mark.without_bus
REQUEST = 0x600 + NODE_ID
CYCLE_S = 0.001
UPLOAD_REQUESTS = (0x40, 0x60, 0x70, 0x80)  # begin, two toggles of a segment, abort


class Cell(can.BusABC):
    """A bus inside this process: the node, a moving controller and drives. If no frame waits, `recv` runs a cycle."""

    def __init__(self, drives: Drives) -> None:
        super().__init__("in process")
        self.asked: list[can.Message] = []
        self._node, self._drives = InProcessNode(), drives
        self._waiting: collections.deque[can.Message] = collections.deque()
        self.cycle = 0
        self.is_moving = False

    def _pass(self, identifier: int, data: bytes) -> None:
        stamp = self.cycle * CYCLE_S
        for answer, payload in self._node.exchange(identifier, data):
            self._waiting.append(
                can.Message(arbitration_id=answer, data=payload, is_extended_id=False, timestamp=stamp)
            )

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """A frame of the client; the answer waits."""
        self.asked.append(msg)
        self._pass(msg.arbitration_id, bytes(msg.data))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The first waiting frame, else the first of the next cycle."""
        if not self._waiting and self.is_moving:
            self.cycle += 1
            for identifier, data in cycle_frames(self.cycle, self._drives):
                self._waiting.append(
                    can.Message(
                        arbitration_id=identifier,
                        data=data,
                        is_extended_id=False,
                        timestamp=self.cycle * CYCLE_S,
                    )
                )
                self._pass(identifier, data)
        return self._waiting.popleft() if self._waiting else None

    def shutdown(self) -> None:
        """The node ends with its bus."""
        super().shutdown()
        self._node.close()


def commissioned(drives: Drives) -> Report:
    """Commission over two swings of each axis, past a node inside this process."""
    cell = Cell(drives)
    client = SdoClient(cell, NODE_ID, 1.0)
    configure(client)
    cell.asked.clear()
    listener = Listener(client, Compensator(client).read_number("Compensator status.Joint count"))
    cell.is_moving = True  # only now: a client first drains its bus, which would never be empty
    end = cell.cycle + 12 * SWING
    while cell.cycle < end and (message := cell.recv()) is not None:
        listener.take(message)
    assert {message.arbitration_id for message in cell.asked} == {REQUEST}
    assert all(message.data[0] in UPLOAD_REQUESTS for message in cell.asked), "it may ask, and nothing else"
    cell.shutdown()
    return examine(*listener.recorded())


@pytest.mark.parametrize(
    ("drives", "findings"),
    [
        pytest.param(Drives(), [], id="right"),
        pytest.param(
            Drives(axis=(0, 2, 1, 3, 4, 5)), ["axes 2 and 3: their drives are exchanged"], id="order"
        ),
        pytest.param(Drives(scale=(1, 1, 1, -1, 1, 1)), ["axis 4: the drive moves backwards"], id="sign"),
        pytest.param(
            Drives(axis=(5, 1, 2, 3, 4, 0), scale=(-1, 1, 1, 1, 1, -1)),
            ["axes 1 and 6: their drives are exchanged, backwards"],
            id="order and sign",
        ),
    ],
)
def test_findings_name_exchanged_and_reversed_drives(drives: Drives, findings: list[str]) -> None:
    report = commissioned(drives)
    assert report.findings == findings
    assert report.unknown == []


def test_finding_names_a_drive_with_a_wrong_scale() -> None:
    report = commissioned(Drives(scale=(1, 1, 1, 1, 16, 1)))
    (sentence,) = report.findings
    assert sentence.startswith("axis 5: the drive moves 1")
    assert report.axes[4].slope == pytest.approx(16.0, rel=0.03)
