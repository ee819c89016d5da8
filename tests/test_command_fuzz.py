"""Damaged calls of every command (fuzz/fuzz_commands.py): 12 in each run, two minutes of them in the full test."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

HARNESS = Path(__file__).parent / "fuzz" / "fuzz_commands.py"


def run(*arguments: str, timeout: float) -> str:
    """Run the harness, which must exit with status 0; returns its output."""
    command = [sys.executable, str(HARNESS), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=timeout)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    return done.stdout


def test_damaged_calls_end_as_documented() -> None:
    assert "12 trials, 0 faults" in run("--trials", "12", "--seed", "5", timeout=600)


@pytest.mark.full
def test_two_minutes_of_damaged_calls_end_as_documented() -> None:
    said = run("--seconds", "120", "--seed", "6", timeout=900)
    assert int(said.split()[-4]) > 50
