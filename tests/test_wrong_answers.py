"""A device that answers wrongly: every command ends with one sentence and status 3, and writes no file."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import can
import pytest
import typer
from armtrue.cli.device import app, upload
from armtrue.device import connection
from armtrue.device.connection import BusOptions
from armtrue.device.eds import dictionary
from armtrue.tables import layout

NODE = 32


def an_image() -> bytes:
    """A table image for six joints: valid header and checksum, arbitrary content."""
    fields = [0] * 25
    content = bytes(range(100))
    length = layout.HEADER.size + len(content) + layout.CHECKSUM.size
    fields[:7] = [layout.MAGIC, layout.VERSION, layout.HEADER.size, length, 0, 2, 6]
    fields[10:12] = [b"text", b""]
    count = len(layout.HEADER.unpack(bytes(layout.HEADER.size)))
    image = layout.HEADER.pack(*fields[:count]) + content
    return image + layout.CHECKSUM.pack(zlib.crc32(image))


IMAGE = an_image()


class FakeDevice:
    """A compensator with an active table, seen from the bus. `numbers` are its values by name, 0 where not given."""

    def __init__(self, **_: object) -> None:
        self.numbers: dict[str, int] = {
            "Identity object.Product code": int.from_bytes(b"ARMT", "big"),
            "Compensator status.Joint count": 6,
            "Compensator status.Status bits": 1 << 3 | 1,
            "Compensator control.Mode": 1,
            "Compensator control.Correction enable": 1,
            "Table status.Format version read": layout.VERSION,
            "Table status.Capacity (bytes)": 16384,
            "Table status.Active slot": 1,
            "Table status.Checksum of active image": zlib.crc32(IMAGE[:-4]),
        }
        self.held = IMAGE
        self.has_empty_segments = False
        self.acknowledged: int | None = None  # segments acknowledged of each block; None: all
        self._reading = b""
        self._in_block = False
        self._waiting: deque[can.Message] = deque()

    def shutdown(self) -> None:
        """Nothing is open."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return self._waiting.popleft() if self._waiting else None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        data = bytes(msg.data)
        answer = self._block(data) if self._in_block else self._command(data)
        if answer is not None:
            message = can.Message(
                arbitration_id=0x580 + NODE, data=answer.ljust(8, b"\0"), is_extended_id=False
            )
            self._waiting.append(message)

    def _command(self, data: bytes) -> bytes | None:
        place = data[1:4]
        if data[0] == 0x40:
            if place == b"\x11\x20\x00":
                self._reading = self.held
                return b"\x41" + place + len(self.held).to_bytes(4, "little")
            (entry,) = (
                e for e in dictionary().values() if (e.index, e.sub) == (place[0] | place[1] << 8, place[2])
            )
            if not entry.is_number:
                return b"\x43" + place + b"text"
            number = self.numbers.get(entry.name, 0) & (1 << 8 * entry.size) - 1
            return bytes([0x43 | (4 - entry.size) << 2]) + place + number.to_bytes(4, "little")
        if data[0] >> 5 == 3:
            if self.has_empty_segments:
                return bytes([data[0] & 0x10 | 7 << 1]) + bytes(7)
            piece, self._reading = self._reading[:7], self._reading[7:]
            return bytes([data[0] & 0x10 | (7 - len(piece)) << 1 | (not self._reading)]) + piece
        if data[0] == 0xC6:
            self._in_block = True
            return b"\xa4" + place + b"\x7f"
        return None if data[0] == 0x80 else b"\x60" + place

    def _block(self, data: bytes) -> bytes | None:
        if data[0] == 0x80:
            self._in_block = False
        ends = data[0] != 0x80 and (data[0] & 0x80 != 0 or data[0] == 0x7F)
        acknowledged = data[0] & 0x7F if self.acknowledged is None else self.acknowledged
        return bytes([0xA2, acknowledged, 0x7F]) if ends else None


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> FakeDevice:
    """The device that every command finds on its bus."""
    made = FakeDevice()

    def open_it(_: BusOptions) -> FakeDevice:
        return made

    monkeypatch.setattr(connection, "open_bus", open_it)
    return made


@dataclass(frozen=True)
class Done:
    """Result of a command."""

    status: int
    stdout: str
    stderr: str


Run = Callable[..., Done]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command with bus options added."""

    def once(*words: str) -> Done:
        program = typer.Typer()
        program.command()(upload)
        program.add_typer(app, name="device")
        bus = ("--interface", "none", "--channel", "none", "--timeout", "0.05")
        status = program([*words, *bus], standalone_mode=False)
        said = capsys.readouterr()
        return Done(status or 0, said.out, said.err)

    return once


def expect_sentence(done: Done, words: str) -> None:
    assert done.status == 3, done
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert words in done.stderr


def test_correct_device_is_described_and_dumped(device: FakeDevice, run: Run, tmp_path: Path) -> None:
    done = run("device", "info")
    assert done.status == 0, done
    assert "slot B" in done.stdout
    done = run("device", "dump", str(tmp_path / "held.bin"))
    assert done.status == 0, done
    assert (tmp_path / "held.bin").read_bytes() == IMAGE


def test_unknown_active_slot_is_reported(device: FakeDevice, run: Run) -> None:
    device.numbers["Table status.Active slot"] = 7
    expect_sentence(
        run("device", "info"), "node 32 says 7 of 'Table status.Active slot', expected 0, 1 or 255"
    )


@pytest.mark.parametrize("joints", [0, 9, 200])
@pytest.mark.parametrize("command", ["info", "monitor", "commission"])
def test_joint_count_out_of_range_is_reported(
    device: FakeDevice, run: Run, command: str, joints: int
) -> None:
    device.numbers["Compensator status.Joint count"] = joints
    watched = () if command == "info" else ("--duration", "0.1")
    done = run("device", command, *watched)
    expect_sentence(done, f"node 32 says {joints} of 'Compensator status.Joint count', expected 1 to 8")
    assert "as commanded" not in done.stdout


@pytest.mark.parametrize("command", ["dump", "verify"])
@pytest.mark.parametrize("at", [20, len(IMAGE) - 1])
def test_table_damaged_in_transfer_is_refused(
    device: FakeDevice, run: Run, command: str, at: int, tmp_path: Path
) -> None:
    path = tmp_path / "held.bin"
    if command == "verify":
        path.write_bytes(IMAGE)
    device.held = IMAGE[:at] + bytes([IMAGE[at] ^ 1]) + IMAGE[at + 1 :]
    expect_sentence(run("device", command, str(path)), "the table was damaged on its way")
    assert path.exists() == (command == "verify")


def test_dump_of_a_table_other_than_the_active_one_writes_no_file(
    device: FakeDevice, run: Run, tmp_path: Path
) -> None:
    device.numbers["Table status.Checksum of active image"] ^= 1
    expect_sentence(run("device", "dump", str(tmp_path / "held.bin")), "the table was damaged on its way")
    assert list(tmp_path.iterdir()) == []


def test_dump_ends_on_segments_without_data(device: FakeDevice, run: Run, tmp_path: Path) -> None:
    device.has_empty_segments = True
    expect_sentence(run("device", "dump", str(tmp_path / "held.bin")), "segment without data")
    assert list(tmp_path.iterdir()) == []


def test_upload_ends_after_4_unacknowledged_blocks(device: FakeDevice, run: Run, tmp_path: Path) -> None:
    device.numbers["Table status.Active slot"] = 0xFF
    device.numbers["Table status.Checksum of active image"] = 0
    device.acknowledged = 0
    path = tmp_path / "tables.bin"
    path.write_bytes(IMAGE)
    expect_sentence(run("upload", str(path)), "node 32 took nothing of 4 blocks in a row")
