"""The lock on a session: one workbench at a time, until its process ends."""

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


def test_session_held_by_another_workbench_is_refused_with_advice(other, tmp_path):
    with pytest.raises(
        InputError,
        match=rf"open in another workbench \(process {other.pid}\).*Ctrl-C, or keep this one elsewhere with",
    ):
        SessionLocks().hold(tmp_path / "session")


def test_refusal_names_the_address_of_the_page(tmp_path):
    SessionLocks("http://127.0.0.1:8/token/").hold(tmp_path / "session")
    with pytest.raises(InputError, match=r"continue on its page http://127\.0\.0\.1:8/token/, end it"):
        SessionLocks().hold(tmp_path / "session")


def test_lock_ends_with_its_killed_process(other, tmp_path):
    other.kill()
    other.wait()
    SessionLocks().hold(tmp_path / "session")


def test_released_folder_can_be_locked_by_another_workbench(tmp_path):
    one, other = SessionLocks(), SessionLocks()
    one.hold(tmp_path / "session")
    one.hold(tmp_path / "session")
    with pytest.raises(InputError, match=f"process {os.getpid()}"):
        other.hold(tmp_path / "session")
    one.keep(set())
    other.hold(tmp_path / "session")
