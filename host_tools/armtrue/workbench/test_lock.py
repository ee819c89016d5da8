"""The lock on a session: one workbench at a time, and none once its process has ended."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from armtrue.errors import InputError
from armtrue.workbench.lock import SessionLocks

HOLD = """
import sys
from pathlib import Path
from armtrue.workbench.lock import SessionLocks
locks = SessionLocks()
locks.hold(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def other(tmp_path):
    """Another process that holds the session."""
    command = [sys.executable, "-c", HOLD, str(tmp_path / "session")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_session_that_another_workbench_holds_is_refused_with_what_to_do(other, tmp_path):
    with pytest.raises(
        InputError,
        match=rf"open in another workbench \(process {other.pid}\).*Ctrl-C, or keep this one elsewhere with",
    ):
        SessionLocks().hold(tmp_path / "session")


def test_lock_of_a_killed_process_bars_nobody(other, tmp_path):
    other.kill()
    other.wait()
    SessionLocks().hold(tmp_path / "session")


def test_folder_that_is_let_go_can_be_held_by_another(tmp_path):
    one, other = SessionLocks(), SessionLocks()
    one.hold(tmp_path / "session")
    one.hold(tmp_path / "session")
    with pytest.raises(InputError, match=f"process {os.getpid()}"):
        other.hold(tmp_path / "session")
    one.keep(set())
    other.hold(tmp_path / "session")
