"""Recordings: frames in order of time with directions; one that fails keeps the old file and leaves no other."""

from __future__ import annotations

import contextlib
import itertools
import time
from pathlib import Path

import can
import pytest

from armtrue.device import recording
from armtrue.device.recording import Recording, channel_label
from armtrue.errors import InputError


def frame(identifier: int, stamp: float = 0.0) -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=b"\1\2", timestamp=stamp)


def record(file: Path) -> float:
    """Sends at +1 s and +3 s; afterwards receives frames of +0.5 s, +2 s, +2.5 s and +4 s. Returns the time zero."""
    zero = time.time() - 10.0
    with Recording(file, "can3") as log:
        log.sent(frame(0x620), zero + 1.0)
        log.sent(frame(0x621), zero + 3.0)
        for identifier, after_s in ((0x100, 0.5), (0x5A0, 2.0), (0x101, 2.5)):
            log.received(frame(identifier, zero + after_s))
        log.settle()
        log.received(frame(0x5A1, zero + 4.0))
        log.keep()
    return zero


ORDER = [(0x100, True), (0x620, False), (0x5A0, True), (0x101, True), (0x621, False), (0x5A1, True)]


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log", ".trc", ".log.gz", ".ASC"])
def test_sent_and_received_frames_are_in_order_of_time(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"run{suffix}"
    zero = record(file)
    read = list(can.LogReader(str(file)))
    assert [(message.arbitration_id, message.is_rx) for message in read] == ORDER
    stamps = [message.timestamp for message in read]
    assert all(before <= after for before, after in itertools.pairwise(stamps))
    assert stamps[-1] - stamps[0] == pytest.approx(3.5, abs=2e-3)
    if suffix in (".blf", ".log"):
        assert stamps[0] == pytest.approx(zero + 0.5, abs=2e-3), "time since 1970"
    if suffix == ".log":
        assert {message.channel for message in read} == {"can3"}
    assert list(tmp_path.iterdir()) == [file]


def test_timestamps_of_another_clock_become_times_of_arrival(tmp_path: Path) -> None:
    file = tmp_path / "run.log"
    before = time.time()
    with Recording(file, "can0") as log:
        log.received(frame(0x100, 17.0))
        log.sent(frame(0x620), time.time())
        log.received(frame(0x5A0, 17.1))
        log.keep()
    stamps = [message.timestamp for message in can.LogReader(str(file))]
    assert before - 1e-3 <= min(stamps) <= max(stamps) <= time.time()
    assert [message.arbitration_id for message in can.LogReader(str(file))] == [0x100, 0x620, 0x5A0]


def test_recording_that_is_not_kept_leaves_only_the_old_file(tmp_path: Path) -> None:
    file = tmp_path / "run.log"
    file.write_text("an older recording")
    with Recording(file, "can0") as log:
        log.received(frame(0x100))
    assert file.read_text() == "an older recording"
    assert list(tmp_path.iterdir()) == [file]


def test_kept_recording_replaces_the_old_file_only_at_the_end(tmp_path: Path) -> None:
    file = tmp_path / "run.log"
    file.write_text("an older recording")
    with contextlib.suppress(RuntimeError), Recording(file, "can0") as log:
        log.keep()
        log.received(frame(0x100))
        assert file.read_text() == "an older recording"
        raise RuntimeError("the bus is gone")
    assert [message.arbitration_id for message in can.LogReader(str(file))] == [0x100]
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("run.xyz", "found a name that ends in '.xyz', expected one of .asc, .blf"),
        ("run", "found a name that ends in '', expected one of .asc, .blf"),
        ("run.blf.gz", "cannot be recorded to"),
        ("absent/run.log", "found no folder"),
    ],
)
def test_unusable_name_of_a_recording_is_bad_input(tmp_path: Path, name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Recording(tmp_path / name, "can0")
    assert list(tmp_path.iterdir()) == []


def test_full_disk_is_reported_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(can.Listener):
        def on_message_received(self, msg: can.Message) -> None:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(recording.can, "Logger", lambda _: Full())
    log = Recording(tmp_path / "run.log", "can0")
    with pytest.raises(InputError, match=r"run\.log: cannot be written \(No space left on device\)"):
        log.received(frame(0x100))


@pytest.mark.parametrize(
    ("interface", "channel", "label"),
    [
        ("socketcan", "can1", "can1"),
        ("pcan", "PCAN_USBBUS2", "PCAN_USBBUS2"),
        ("kvaser", "1", "kvaser1"),
        ("slcan", "/dev/ttyACM1", "slcan0"),
        ("slcan", "socket://127.0.0.1:40123", "slcan0"),
    ],
)
def test_channel_label_fits_every_recording_format(interface: str, channel: str, label: str) -> None:
    assert channel_label(interface, channel) == label
