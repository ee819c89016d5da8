"""Errors that need no bus: interfaces that cannot be opened here, bad monitor options, damaged files."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from can.interfaces import VALID_INTERFACES
from command_line import armtrue
from small_table import small_table

pytestmark = pytest.mark.without_bus
PROGRAM = Path(sys.executable).parent / "armtrue"
# Tested with every change: the kernel's interface, and a serial line.
EVERY_TIME = ("socketcan", "slcan")


@pytest.mark.parametrize(
    "interface",
    [pytest.param(i, marks=() if i in EVERY_TIME else pytest.mark.full) for i in sorted(VALID_INTERFACES)],
)
def test_missing_bus_is_reported_in_one_sentence(interface: str) -> None:
    # All interfaces accept a number as their channel; no device and no multicast group has this one.
    words = ["--interface", interface, "--channel", "0", "--timeout", "0.05"]
    done = subprocess.run(
        [PROGRAM, "device", "info", *words], capture_output=True, text=True, timeout=60.0, check=False
    )
    assert done.returncode == 3, done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("armtrue: ")
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--duration", "0"], "--duration: found 0, expected at least 0.05 s"),
        (["--duration=-3"], "--duration: found -3, expected at least 0.05 s"),
        (["--duration", "nan"], "--duration: found nan, expected a finite number"),
        (["--period", "0"], "--period: found 0, expected at least 0.05 s"),
        (["--record", "run.xyz"], "run.xyz: found a name that ends in '.xyz', expected one of"),
    ],
)
def test_bad_monitor_option_is_reported_in_one_sentence(words: list[str], sentence: str) -> None:
    done = armtrue("device", "monitor", *words, "--json", "-", "--interface", "virtual")
    assert done.returncode == 2
    assert sentence in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda image: image[:50], "expected a table image of at least"),
        (lambda image: b"GIF8" + image[4:], "begins with b'GIF8'"),
        (lambda image: image + b"\0", "the header says"),
        (lambda image: image[:300] + bytes([image[300] ^ 1]) + image[301:], "the file is damaged"),
    ],
)
def test_damaged_file_is_reported_in_one_sentence(tmp_path: Path, spoil: object, words: str) -> None:
    file = tmp_path / "tables.bin"
    file.write_bytes(spoil(small_table()))  # type: ignore[operator]
    refused = armtrue("upload", file)
    assert refused.returncode == 2
    assert words in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
