"""Tables uploaded from the workbench and a device watched live: the firmware's own node, inside this process."""

from __future__ import annotations

import collections
import re
import sys
import threading
import time
from pathlib import Path

import can
import pytest
from armtrue.errors import InputError
from armtrue.workbench.compensator import Device, device_view
from armtrue.workbench.opening.opened import open_files
from armtrue.workbench.start import start
from bench_page import Page

sys.path.append(str(Path(__file__).resolve().parents[1] / "can" / "support"))

from in_process import InProcessNode
from node_process import NODE_ID

pytestmark = pytest.mark.full


class Cable(can.BusABC):
    """A bus to a node; closing the bus does not end the node."""

    def __init__(self, node: InProcessNode) -> None:
        super().__init__("in process")
        self._node = node
        self._waiting: collections.deque[can.Message] = collections.deque()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        for identifier, data in self._node.exchange(msg.arbitration_id, bytes(msg.data)):
            self._waiting.append(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if not self._waiting:
            time.sleep(min(timeout or 0.0, 0.01))
            return None
        return self._waiting.popleft()


@pytest.fixture
def device():
    node = InProcessNode()
    made = Device(lambda: Cable(node), "in process", NODE_ID, 1.0)
    yield made
    made.close()
    node.close()


@pytest.fixture
def bench(device, campaign, tmp_path):
    """The workbench with a device, served from this process: (its page's address, the engine)."""
    opened = open_files([campaign / "data.csv"])
    server = start(opened, 0, tmp_path / "session", device=device)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.address, server.engine
    server.shutdown()


def live(page: Page) -> str:
    return str(page.browser.run("return document.getElementById('live').innerText"))


def test_a_model_is_uploaded_watched_and_confirmed(browser, bench):
    address, engine = bench
    page = Page(browser, address)
    page.until(lambda: "joint commands" in live(page), "live view")
    assert page.by_role("#live", "region", "Device")
    assert len(re.findall(r"^\d\t", live(page), re.M)) == 6, "one row an axis"
    said = page.after(page.one("main button", "button", "Upload").click)
    assert re.fullmatch(
        r"Export \d+ is in force on the device, on trial until it is reset or confirmed\.", said
    )
    page.until(lambda: "table on trial" in live(page), "trial in the live view")
    assert "confirmed" in page.after(page.one("main button", "button", "Confirm").click)
    page.until(lambda: "table on trial" not in live(page), "end of the trial")
    assert page.failure() == ""
    # A confirmed table cannot be reverted: the device refuses, and the page shows its reason.
    page.after(page.one("main button", "button", "Revert").click)
    assert "no table is on trial" in page.failure()
    assert engine.session.nodes


def test_page_without_a_device_has_no_device_part(page, workbench):
    assert page.text("device") == ""
    assert workbench.ask(f"{workbench.path}device").status == 400


def test_silent_device_is_reported_in_one_sentence(tmp_path):
    class Silent(Cable):
        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            """Drop the frame."""

    device = Device(lambda: Silent(None), "nowhere", NODE_ID, 0.05)
    end = time.monotonic() + 30.0
    while "nowhere: " not in (shown := device_view(device)):
        assert time.monotonic() < end
        time.sleep(0.05)
    assert "answer" in shown
    with pytest.raises(InputError, match="nowhere: "):
        device.order("cfrm")


def test_interface_without_a_channel_is_refused(start):
    with pytest.raises(AssertionError, match="expected both"):
        start("--interface", "socketcan")
