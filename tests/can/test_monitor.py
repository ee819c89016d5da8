"""armtrue device monitor: shown values are of one cycle, recorded frames were on the bus, no frame is lost."""

from __future__ import annotations

import itertools
import json
import math
import signal
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import link
import pytest
from command_line import Moment, Running, armtrue
from node_process import NODE_ID, NodeProcess, connect, disconnect
from small_table import small_table

REQUEST, ANSWER = 0x600 + NODE_ID, 0x580 + NODE_ID
ABORT = 0x80  # command byte of an SDO abort
TARGETS, OFFSETS = (0x220, 0x320, 0x420), (0x1A0, 0x2A0, 0x3A0)
STEP = 30_000  # increments that a joint advances in a cycle
TURN = 1 << 20
AMPLITUDE = -TURN / 1024 / math.tau  # small_table's


@contextmanager
def commanded(offsets_on_the_bus: bool) -> Iterator[None]:
    """A running node that corrects six joints, and a controller that moves all of them alike."""
    node = connect()
    for pair in range(3):
        node.sdo[0x1400 + pair][1].raw = TARGETS[pair]
        if offsets_on_the_bus:
            node.sdo[0x1800 + pair][1].raw = 0x40000000 | OFFSETS[pair]
    node.sdo[0x2000][3].raw = 1_000_000
    node.sdo[0x2000][4].raw = 500_000  # frames may be late here, but are not lost
    node.sdo[0x2000][1].raw = 2 if offsets_on_the_bus else 1
    node.nmt.state = "OPERATIONAL"
    leaving = threading.Event()

    def command() -> None:
        with can.Bus(interface="socketcan", channel="vcan0") as bus:
            for cycle in itertools.count(1):
                if leaving.wait(0.02):
                    return
                for pair in range(3):
                    values = struct.pack("<2i", *(STEP * cycle + joint for joint in (2 * pair, 2 * pair + 1)))
                    bus.send(can.Message(arbitration_id=TARGETS[pair], data=values, is_extended_id=False))

    commanding = threading.Thread(target=command)
    commanding.start()
    try:
        yield
    finally:
        leaving.set()
        commanding.join()
        disconnect(node)


@pytest.mark.full
@pytest.mark.parametrize("offsets_on_the_bus", [True, False])
def test_joint_values_taken_from_frames_are_of_one_cycle(tmp_path: Path, offsets_on_the_bus: bool) -> None:
    file = tmp_path / "tables.bin"
    file.write_bytes(small_table())
    with NodeProcess(tmp_path / "state", downstream="vcan1"):
        assert armtrue("upload", file, "--confirm").returncode == 0
        with commanded(offsets_on_the_bus):
            watched = armtrue("device", "monitor", "--duration", "3", "--json", "-")
    assert watched.returncode == 0, watched.stderr
    document = json.loads(watched.stdout)
    assert document["state"] == "active"
    assert document["targets_from"] == "frames"
    assert len({target - joint for joint, target in enumerate(document["targets"])}) == 1
    assert document["corrections_from"] == ("frames" if offsets_on_the_bus else "samples")
    if offsets_on_the_bus:
        wanted = [AMPLITUDE * math.sin(math.tau * target / TURN) for target in document["targets"]]
        # Corrections of the cycle before or after differ by up to AMPLITUDE * tau * STEP / TURN = 29 increments.
        assert document["corrections"] == pytest.approx(wanted, abs=2)
    assert document["downstream_bus_state"] == "active"
    assert document["downstream_frames"] > 0


@pytest.mark.full
@pytest.mark.parametrize("suffix", [".blf", ".log"])
def test_recording_reads_back_the_frames_of_the_bus(tmp_path: Path, suffix: str) -> None:
    log = tmp_path / f"run{suffix}"
    with NodeProcess(tmp_path / "state"), commanded(True):
        begin = time.time()
        watched = armtrue("device", "monitor", "--duration", "1", "--record", log, "--json", "-")
        end = time.time()
    assert watched.returncode == 0, watched.stderr
    assert json.loads(watched.stdout)["downstream_frames"] == 0, "there is no such port"
    recorded = list(can.LogReader(str(log)))
    stamps = [message.timestamp for message in recorded]
    assert begin - 0.1 <= stamps[0], "since 1970"
    assert stamps[-1] <= end + 0.1
    assert all(before <= after for before, after in itertools.pairwise(stamps))
    assert {message.is_rx for message in recorded if message.arbitration_id == REQUEST} == {False}
    assert {*TARGETS, *OFFSETS} <= {message.arbitration_id for message in recorded}
    if suffix == ".log":
        assert {message.channel for message in recorded} == {"vcan0"}
    # An abort has no answer: it clears the transfer of an interrupted client, or one that took too long.
    talk = [
        message.arbitration_id
        for message in recorded
        if message.arbitration_id in (REQUEST, ANSWER)
        and (message.arbitration_id, message.data[0]) != (REQUEST, ABORT)
    ]
    assert len(talk) > 50
    assert talk[-2:] == [REQUEST, ANSWER]
    assert talk.count(REQUEST) == talk.count(ANSWER)
    assert talk == [REQUEST, ANSWER] * (len(talk) // 2)


def test_silent_device_times_out_and_keeps_the_older_recording(
    tmp_path: Path,
) -> None:
    log = tmp_path / "run.log"
    log.write_text("an older recording\n")
    silent = armtrue("device", "monitor", "--record", log, "--timeout", "0.1")
    assert silent.returncode == 3
    assert "did not answer within 0.1 s" in silent.stderr
    assert len(silent.stderr.splitlines()) == 1
    assert log.read_text() == "an older recording\n"
    assert list(tmp_path.iterdir()) == [log]


def requests_in(log: Path) -> int:
    """Number of SDO requests in a recording."""
    return sum(message.arbitration_id == REQUEST for message in can.LogReader(str(log)))


def any_request(_request: bytes) -> bool:
    """Accept every request of the program."""
    return True


@pytest.mark.full
def test_ctrl_c_saves_the_recording_over_the_older_one(tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    log.write_text("an older recording\n")
    with NodeProcess(tmp_path / "state"):
        words = ("device", "monitor", "--record", log, "--period", "0.05")
        watching = Running(*words, moments=[Moment(signal.SIGSTOP, 100, any_request)])
        watching.wait_until_stopped()
        assert log.read_text() == "an older recording\n", "replaced at the end"
        watching.send(signal.SIGINT)
        watching.send(signal.SIGCONT)
        done = watching.wait()
    assert done.returncode == 0, done.stderr
    assert requests_in(log) >= 100
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.log", "state"]


@pytest.mark.full
def test_recording_survives_the_loss_of_the_bus(tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    with NodeProcess(tmp_path / "state"):
        words = ("device", "monitor", "--record", log, "--period", "0.05", "--timeout", "0.5")
        watching = Running(*words, moments=[Moment(signal.SIGSTOP, 100, any_request)])
        watching.wait_until_stopped()
        with link.down("vcan0"):
            watching.send(signal.SIGCONT)
            done = watching.wait()
    assert done.returncode == 3, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert requests_in(log) >= 100
