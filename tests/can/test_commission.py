"""`armtrue device commission` between a controller and simulated drives on SocketCAN."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import can
import pytest
from armtrue.device import SdoClient
from command_line import armtrue
from node_process import NODE_ID, NodeProcess
from wrong_drives import POSITIONS, SWING, Drives, configure, cycle_frames

# Long, so that a frame that waits for the node on a loaded machine is late by a few cycles at most.
CYCLE_S = 0.05
DURATION_S = 1.2 * 6 * SWING * CYCLE_S


def commission_over_vcan(tmp_path: Path, drives: Drives) -> tuple[int, dict[str, object], str]:
    """Run the command with a moving controller on vcan0 and drives on vcan1: exit status, figures, text."""
    with (
        NodeProcess(tmp_path / "state", downstream="vcan1"),
        can.Bus(interface="socketcan", channel="vcan0") as controller,
        can.Bus(interface="socketcan", channel="vcan1") as drives_bus,
    ):
        configure(SdoClient(controller, NODE_ID, 30.0))
        leaving = threading.Event()

        def move() -> None:
            cycle = 0
            while not leaving.wait(CYCLE_S):
                cycle += 1
                for identifier, data in cycle_frames(cycle, drives):
                    bus = drives_bus if identifier in POSITIONS else controller
                    bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

        moving = threading.Thread(target=move)
        moving.start()
        try:
            done = armtrue(
                "device", "commission", "--duration", f"{DURATION_S}", "--json", str(tmp_path / "found.json")
            )
        finally:
            leaving.set()
            moving.join()
    return done.returncode, json.loads((tmp_path / "found.json").read_text()), done.stdout


@pytest.mark.full  # half a minute of cycles; test_commission_in_process.py does not wait for them
def test_command_finds_exchanged_drives_behind_a_node_on_socketcan(tmp_path: Path) -> None:
    status, figures, text = commission_over_vcan(tmp_path, Drives(axis=(0, 2, 1, 3, 4, 5)))
    assert status == 1
    assert figures["findings"] == ["axes 2 and 3: their drives are exchanged"], figures["axes"]
    assert "WRONG    axes 2 and 3: their drives are exchanged" in text


def test_command_without_mapped_targets_says_so(tmp_path: Path) -> None:
    with NodeProcess(tmp_path / "state"):
        done = armtrue("device", "commission", "--duration", "1")
    assert done.returncode == 1
    assert "do not map the targets of all joints" in done.stderr
