"""Upload of a table to the emulated chip over a serial line, by `armtrue upload`."""

from __future__ import annotations

import pathlib
import subprocess
import sys
from collections.abc import Iterator

import arms
import can
import pytest
from armtrue.tables.export import ExportOptions, export

from tests import qemu

PROGRAM = pathlib.Path(sys.executable).parent / "armtrue"
NODE = 0x20


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    elf = qemu.build_images("stm32f405", "armtrue_stm32f405") / "armtrue_stm32f405.elf"
    with qemu.board(elf) as board:
        yield board.slcan_url(0)


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A six-axis arm with every effect, 3 degree tables and a grid."""
    path = tmp_path_factory.mktemp("tables") / "kr30.bin"
    path.write_bytes(bytes(export(arms.full_arm("kr30", grid_nodes=6), ExportOptions(sequence=5)).image))
    return path


def armtrue(url: str, *words: str | pathlib.Path) -> subprocess.CompletedProcess[str]:
    command = [str(PROGRAM), *map(str, words), "--interface", "slcan", "--channel", url, "--timeout", "30"]
    return subprocess.run(command, capture_output=True, text=True, timeout=300.0, check=False)


def restart(url: str) -> None:
    """NMT reset node (CiA 301, 7.2.8.2); returns after the boot-up message."""
    with can.Bus(interface="slcan", channel=url, bitrate=1_000_000) as bus:
        bus.send(can.Message(arbitration_id=0, data=[0x81, NODE], is_extended_id=False))
        while (frame := bus.recv(30.0)) is not None:
            if frame.arbitration_id == 0x700 + NODE:
                return
    pytest.fail("no boot-up message")


@pytest.mark.full  # with a foreign client, tests/can/test_on_stm32f405.py does the same in a tenth of the time
def test_table_is_kept_only_if_confirmed(url: str, tables: pathlib.Path, tmp_path: pathlib.Path) -> None:
    on_trial = armtrue(url, "upload", tables)
    assert on_trial.returncode == 0, on_trial.stderr
    restart(url)
    lost = armtrue(url, "device", "verify", tables)
    assert lost.returncode == 1
    assert "no table in force" in lost.stderr

    confirmed = armtrue(url, "upload", tables, "--confirm", "--transfer", "segmented")
    assert confirmed.returncode == 0, confirmed.stderr
    restart(url)
    dump = armtrue(url, "device", "dump", tmp_path / "back.bin")
    assert dump.returncode == 0, dump.stderr
    assert (tmp_path / "back.bin").read_bytes() == tables.read_bytes()
