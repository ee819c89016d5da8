"""armtrue upload and armtrue device over a serial line: the STM32F405 image in QEMU, SLCAN on socket://."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
from command_line import Moment, armtrue
from small_table import small_table

from tests import qemu

pytestmark = pytest.mark.without_bus
PROGRAM = Path(sys.executable).parent / "armtrue"


@pytest.fixture(scope="module")
def line() -> Iterator[tuple[str, ...]]:
    """Options that reach a running board; the board has one client at a time, as a serial port has."""
    with qemu.board(qemu.build_images("stm32f405", "armtrue_stm32f405") / "armtrue_stm32f405.elf") as board:
        # An adapter that resets when its port is opened needs a pause before the first command; ours does not.
        yield (
            "--interface", "slcan", "--channel", board.slcan_url(0), "--bitrate", "1000000",
            "--bus-option", "sleep_after_open=0.05",
        )  # fmt: skip


def answer(line: tuple[str, ...], *words: str | Path) -> dict[str, object]:
    """The JSON of a command that succeeds."""
    done: subprocess.CompletedProcess[str] = armtrue(*words, *line, "--json", "-")
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def test_every_command_works_over_a_serial_line(line: tuple[str, ...], tmp_path: Path) -> None:
    tables, newer = tmp_path / "tables.bin", tmp_path / "newer.bin"
    tables.write_bytes(small_table(sequence=3))
    newer.write_bytes(small_table(sequence=4))
    assert answer(line, "device", "info")["Compensator status.Joint count"] == 6
    assert answer(line, "upload", tables)["on_trial"] is True
    assert answer(line, "device", "confirm")["Table status.Trial"] == 0
    assert answer(line, "device", "verify", tables)["sequence"] == 3
    assert answer(line, "upload", newer, "--transfer", "segmented")["on_trial"] is True
    assert answer(line, "device", "revert")["Table status.Active table sequence"] == 3
    assert all(answer(line, "device", "selftest").values())
    log = tmp_path / "run.asc"
    watched = answer(line, "device", "monitor", "--duration", "1", "--record", log)
    assert watched["corrections"] == [0] * 6
    assert 0.0 < float(str(watched["bus_load"])) < 1.0
    recorded = [(message.arbitration_id, message.is_rx) for message in can.LogReader(str(log))]
    assert set(recorded) == {(0x620, False), (0x5A0, True)}
    assert recorded == [(0x620, False), (0x5A0, True)] * (len(recorded) // 2)


@pytest.mark.full
def test_upload_killed_on_a_serial_line_can_be_repeated(line: tuple[str, ...], tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    tables.write_bytes(small_table(sequence=9, padding=12000))
    for count in (3, 900):
        moment = Moment(signal.SIGKILL, count, lambda request: request[1:8] == bytes(7))  # padding
        assert armtrue("upload", tables, *line, moments=[moment]).returncode == -signal.SIGKILL
    finished = armtrue("upload", tables, *line, "--confirm")
    assert finished.returncode == 0, finished.stderr
    assert armtrue("device", "verify", tables, *line).returncode == 0


def test_terminal_shows_rate_and_remaining_time(line: tuple[str, ...], tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    tables.write_bytes(small_table(sequence=20, padding=15000))
    child, terminal = pty.fork()
    if child == 0:
        os.environ |= {"TERM": "xterm", "COLUMNS": "100", "LINES": "30"}
        os.execv(PROGRAM, [str(PROGRAM), "upload", str(tables), *line, "--timeout", "30"])
    seen = b""
    with contextlib.suppress(OSError):  # how a terminal says that its other end is gone
        while piece := os.read(terminal, 4096):
            seen += piece
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, seen
    words = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", seen.decode("utf-8", "replace"))
    assert re.search(r"transferring .*[\d.]+/[\d.]+ kB [\d.]+ kB/s \d:\d\d:\d\d", words), words
