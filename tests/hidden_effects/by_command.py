"""Runs `armtrue` in a process of its own, with or without a terminal, under a time limit."""

from __future__ import annotations

import os
import pty
import resource
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ARMTRUE = str(Path(sys.executable).with_name("armtrue"))


@dataclass
class Ran:
    """Result of a command. processor: its processor time [s], which tells a deadlock from a busy machine."""

    status: int | None
    seconds: float
    said: str
    processor: float = 0.0

    @property
    def hung(self) -> bool:
        """True if it was killed at the time limit."""
        return self.status is None


def run(arguments: Sequence[str], limit: float, terminal: bool = False) -> Ran:
    """`armtrue ARGUMENTS`; terminal: on a pseudo-terminal, so that it draws its progress. limit: seconds."""
    return run_program([ARMTRUE, *arguments], limit, terminal)


def run_program(command: Sequence[str], limit: float, terminal: bool) -> Ran:
    """Run any command; its stdout and stderr come as one text."""
    ours, theirs = pty.openpty() if terminal else os.pipe()
    started, before = time.perf_counter(), _processor_of_children()
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=theirs, stderr=theirs, start_new_session=True
    )
    os.close(theirs)
    said, alive = b"", True
    while alive and time.perf_counter() - started < limit:
        if select.select([ours], [], [], 0.2)[0]:
            try:
                part = os.read(ours, 65536)
            except OSError:  # the terminal's other end is closed
                part = b""
            said, alive = said + part, bool(part)
    try:
        status: int | None = process.wait(max(limit - (time.perf_counter() - started), 0.1))
    except subprocess.TimeoutExpired:
        status = None
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    os.close(ours)
    processor = _processor_of_children() - before
    return Ran(status, time.perf_counter() - started, said.decode(errors="replace"), processor)


def _processor_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@cache
def knows(command: str, option: str) -> bool:
    """True where this build's command has the option."""
    return option in run([command, "--help"], 60.0).said
