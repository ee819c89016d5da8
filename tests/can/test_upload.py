"""armtrue upload and armtrue device, as a person calls them, against the running node."""

from __future__ import annotations

import base64
import json
import signal
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import canopen
import link
import pytest
from armtrue_loop.network import keep_all_frames
from command_line import Moment, Running, armtrue
from node_process import NODE_ID, NodeProcess, connect, disconnect
from small_table import small_table

OFFSET_COB_ID = 0x400001A0  # of joints 1 and 2; the next pairs 0x100 further


@pytest.fixture
def tables(tmp_path: Path) -> Path:
    file = tmp_path / "tables.bin"
    file.write_bytes(small_table(sequence=3))
    return file


def test_upload_verifies_activates_and_survives_a_restart(tmp_path: Path, tables: Path) -> None:
    with NodeProcess(tmp_path / "state") as node:
        done = armtrue("upload", tables, "--json", "-")
        assert done.returncode == 0, done.stderr
        document = json.loads(done.stdout)
        assert [step["name"] for step in document["steps"]] == [
            "compared", "transferred", "verified", "committed", "activated",
        ]  # fmt: skip
        assert document["on_trial"] is True
        assert document["bytes_sent"] == tables.stat().st_size
        assert armtrue("device", "confirm").returncode == 0
        assert armtrue("device", "verify", tables).returncode == 0
        node.stop()
        node.start()
        assert armtrue("device", "dump", tmp_path / "back.bin").returncode == 0
        assert (tmp_path / "back.bin").read_bytes() == tables.read_bytes()
        again = armtrue("upload", tables, "--json", "-")
        assert json.loads(again.stdout)["bytes_sent"] == 0, "already in force"


@pytest.mark.full
def test_unconfirmed_trial_is_gone_after_a_restart(tmp_path: Path, tables: Path) -> None:
    with NodeProcess(tmp_path / "state") as node:
        assert armtrue("upload", tables, "--transfer", "segmented").returncode == 0
        node.stop()
        node.start()
        refused = armtrue("device", "verify", tables)
        assert refused.returncode == 1
        assert "no table in force" in refused.stderr


@pytest.mark.full
def test_revert_returns_to_the_previous_table(tmp_path: Path, tables: Path) -> None:
    newer = tmp_path / "newer.bin"
    newer.write_bytes(small_table(sequence=4, amplitude=1 << 21))
    with NodeProcess(tmp_path / "state"):
        assert armtrue("upload", tables, "--confirm").returncode == 0
        assert armtrue("upload", newer).returncode == 0
        assert armtrue("device", "verify", newer).returncode == 0
        assert armtrue("device", "revert").returncode == 0
        assert armtrue("device", "verify", tables).returncode == 0
        refused = armtrue("device", "revert")
        assert refused.returncode == 1
        assert "no table is on trial" in refused.stderr


@pytest.mark.quick("changes2-options2-an unsigned table, the device expects a signed one")
@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({"joints": 5}, [], "5 joints, the device expects 6"),
        ({"serial": "other"}, ["--robot-serial", "mine"], "robot 'other', the device expects robot 'mine'"),
        ({}, ["--public-key", "KEY"], "an unsigned table, the device expects a signed one"),
    ],
)
def test_unacceptable_table_is_refused_before_the_transfer(
    tmp_path: Path, changes: dict[str, int], options: list[str], words: str
) -> None:
    key = tmp_path / "key"
    key.write_text(f"armtrue-ed25519-public {base64.b64encode(bytes(range(32))).decode()}\n")
    options = [str(key) if option == "KEY" else option for option in options]
    file = tmp_path / "tables.bin"
    file.write_bytes(small_table(**changes))  # type: ignore[arg-type]
    with NodeProcess(tmp_path / "state", *options):
        refused = armtrue("upload", file)
        assert refused.returncode == 2
        assert words in refused.stderr
        node = connect()
        assert node.sdo["Table status"]["Bytes staged"].raw == 0
        disconnect(node)


@pytest.mark.full
def test_an_older_export_is_refused(tmp_path: Path, tables: Path) -> None:
    older = tmp_path / "older.bin"
    older.write_bytes(small_table(sequence=2))
    with NodeProcess(tmp_path / "state"):
        assert armtrue("upload", tables, "--confirm").returncode == 0
        refused = armtrue("upload", older)
        assert refused.returncode == 2
        assert "export number 2" in refused.stderr


def test_silent_node_and_missing_bus_exit_with_status_3(tables: Path) -> None:
    silent = armtrue("upload", tables, "--timeout", "0.2")
    assert silent.returncode == 3
    assert "node 32 did not answer within 0.2 s" in silent.stderr
    absent = armtrue("device", "info", "--channel", "vcan7")
    assert absent.returncode == 3
    assert "vcan7" in absent.stderr


def any_request(_request: bytes) -> bool:
    """Accept every request of the program."""
    return True


def is_command(word: bytes) -> Callable[[bytes], bool]:
    """Whether a request writes this table command."""
    return lambda request: request[4:8] == word


def is_segment(request: bytes) -> bool:
    """Whether a request carries padding of the image: seven zeros, which no other request has there."""
    return request[1:8] == bytes(7)


INTERRUPTIONS: dict[str, tuple[int, Callable[[bytes], bool]]] = {
    "asking": (5, any_request),
    "first segments": (3, is_segment),
    "middle segments": (200, is_segment),
    "last segments": (420, is_segment),
    "verifying": (1, is_command(b"vrfy")),
    "committing": (1, is_command(b"cmit")),
    "activating": (1, is_command(b"actv")),
    "confirming": (1, is_command(b"cfrm")),
}


@pytest.mark.full
@pytest.mark.parametrize(
    ("transfer", "moments"),
    [
        ("block", list(INTERRUPTIONS)),
        ("segmented", ["first segments", "middle segments"]),
    ],
)
def test_upload_killed_at_any_step_can_be_repeated_at_once(
    tmp_path: Path, transfer: str, moments: list[str]
) -> None:
    file = tmp_path / "tables.bin"
    with NodeProcess(tmp_path / "state"):
        for sequence, moment in enumerate(moments, 1):
            file.write_bytes(small_table(sequence=sequence, padding=3000))  # four blocks
            words = ("upload", file, "--transfer", transfer, "--confirm")
            killed = armtrue(*words, moments=[Moment(signal.SIGKILL, *INTERRUPTIONS[moment])])
            assert killed.returncode == -signal.SIGKILL, (moment, killed.stderr)
            finished = armtrue(*words)
            assert finished.returncode == 0, (moment, finished.stderr)
        assert armtrue("device", "verify", file).returncode == 0


def test_ctrl_c_aborts_the_transfer_on_the_device(tmp_path: Path) -> None:
    file = tmp_path / "tables.bin"
    file.write_bytes(small_table(padding=12000))
    with NodeProcess(tmp_path / "state"), requests_seen() as bus:
        done = armtrue(
            "upload", file, "--transfer", "segmented", moments=[Moment(signal.SIGINT, 100, is_segment)]
        )
        assert done.returncode == 130, done.stderr
        said = [bytes(message.data) for message in bus]
    assert sum(map(is_segment, said)) == 100
    assert said[-1][:4] == b"\x80\x10\x20\x00", "its last word"


@contextmanager
def requests_seen() -> Iterator[Iterator[can.Message]]:
    """Requests to the device's SDO server during the block; an ordinary socket keeps 277 frames, this one all."""
    only = [{"can_id": 0x600 + NODE_ID, "can_mask": 0x7FF, "extended": False}]
    with can.Bus(interface="socketcan", channel="vcan0", can_filters=only) as bus:
        keep_all_frames(bus)
        yield iter(lambda: bus.recv(0.0), None)


@pytest.mark.full
def test_upload_fails_without_its_bus_and_can_be_repeated(tmp_path: Path) -> None:
    file = tmp_path / "tables.bin"
    file.write_bytes(small_table(padding=12000))
    words = ("upload", file, "--transfer", "segmented")
    with NodeProcess(tmp_path / "state"):
        uploading = Running(*words, "--timeout", "0.5", moments=[Moment(signal.SIGSTOP, 100, is_segment)])
        uploading.wait_until_stopped()
        with link.down("vcan0"):
            uploading.send(signal.SIGCONT)
            interrupted = uploading.wait()
        assert interrupted.returncode == 3, interrupted.stderr
        assert len(interrupted.stderr.splitlines()) == 1
        assert armtrue(*words).returncode == 0
        verified = armtrue("device", "verify", file)
        assert verified.returncode == 0, verified.stderr


@pytest.mark.full
@pytest.mark.parametrize(
    "silent", [False, True], ids=["back at once", "away for longer than an answer may take"]
)
def test_upload_completes_although_the_node_restarts(tmp_path: Path, silent: bool) -> None:
    file = tmp_path / "tables.bin"
    file.write_bytes(small_table(sequence=9, padding=12000))
    gives_up = Moment(signal.SIGSTOP, 1, lambda request: request[:4] == b"\x80\x10\x20\x00")
    moments = [Moment(signal.SIGSTOP, 400, is_segment), *([gives_up] if silent else [])]
    words = ("upload", file, "--transfer", "segmented", "--confirm", "--timeout", "3")
    with NodeProcess(tmp_path / "state") as node:
        uploading = Running(*words, moments=moments)
        uploading.wait_until_stopped()
        node.stop(signal.SIGKILL)
        if silent:
            uploading.send(signal.SIGCONT)
            uploading.wait_until_stopped()
        node.start()
        uploading.send(signal.SIGCONT)
        first = uploading.wait()
        assert first.returncode == 0, first.stderr
        assert armtrue("device", "verify", file).returncode == 0


@pytest.mark.full
def test_upload_while_joints_are_commanded_is_refused(tmp_path: Path, tables: Path) -> None:
    with NodeProcess(tmp_path / "state"):
        node = connect()
        for number in range(3):
            node.sdo[0x1400 + number][1].raw = 0x200 + 0x100 * number + 0x20
            node.sdo[0x1800 + number][1].raw = OFFSET_COB_ID + 0x100 * number
        node.sdo[0x2000][1].raw = 2
        # The longest quiet time, so that no pause of this machine counts as a stop.
        node.sdo[0x2000][5].raw = 60_000
        node.sdo[0x2000][4].raw = 500_000
        node.nmt.state = "OPERATIONAL"
        tasks = [node.network.send_periodic(0x220 + 0x100 * number, bytes(8), 0.05) for number in range(3)]
        give_up = time.monotonic() + 30.0
        while node.sdo["Compensator status"]["Cycles"].raw == 0:
            assert time.monotonic() < give_up, "no set was whole"
            time.sleep(0.01)
        refused = armtrue("upload", tables)
        assert refused.returncode == 1
        assert "stop the controller" in refused.stderr
        unsaved = armtrue("device", "save")
        assert unsaved.returncode == 1
        assert "stop the controller before parameters are saved" in unsaved.stderr
        for task in tasks:
            task.stop()
        disconnect(node)
        write(0x2000, 5, 100)
        time.sleep(0.7)
        assert armtrue("upload", tables).returncode == 0


def warnings_of(*words: str | Path) -> list[str]:
    """The warnings of a command that succeeds, in JSON; the text must show as many."""
    done = armtrue("device", *words, "--json", "-")
    assert done.returncode == 0, done.stderr
    warnings = list(json.loads(done.stdout)["warnings"])
    assert armtrue("device", *words).stdout.count("! warning") == len(warnings)
    return warnings


def write(index: int, sub: int, value: int) -> None:
    """Over its own connection: an older one has received the answers to the commands in between."""
    node = connect()
    node.sdo[index][sub].raw = value
    disconnect(node)


@pytest.mark.full  # a dozen commands, half a minute in User-Mode Linux
def test_inactive_correction_and_unsaved_parameters_are_warned_of(tmp_path: Path, tables: Path) -> None:
    with NodeProcess(tmp_path / "state") as process:
        uploaded = armtrue("upload", tables, "--confirm", "--json", tmp_path / "out.json")
        assert "! warning" in uploaded.stdout
        forward = warnings_of("info")
        assert json.loads((tmp_path / "out.json").read_text())["warnings"] == forward
        assert len(forward) == 1
        assert "forward mode: nothing is corrected" in forward[0]

        write(0x2000, 1, 2)
        unmapped, unsaved = warnings_of("info")
        assert "RPDOs do not map the targets of all joints" in unmapped
        assert "parameters were written and not saved" in unsaved
        for number in range(3):
            write(0x1400 + number, 1, 0x220 + 0x100 * number)
        assert unmapped in warnings_of("info"), "and the offsets?"
        for number in range(3):
            write(0x1800 + number, 1, OFFSET_COB_ID + 0x100 * number)
        assert warnings_of("info") == [unsaved]
        assert warnings_of("save") == warnings_of("info") == []
        write(0x2000, 2, 0)
        (disabled,) = warnings_of("save")
        assert "correction is disabled" in disabled
        process.stop()
        process.start()
        assert warnings_of("info") == [disabled], "saved: mode, RPDOs and switch are as they were"


@pytest.mark.full
def test_every_command_answers_in_json(tmp_path: Path, tables: Path) -> None:
    newer = tmp_path / "newer.bin"
    newer.write_bytes(small_table(sequence=4))
    with NodeProcess(tmp_path / "state"):

        def answer(*words: str | Path) -> dict[str, object]:
            done = armtrue(*words, "--json", "-")
            assert done.returncode == 0, done.stderr
            return dict(json.loads(done.stdout))

        answer("upload", tables)
        assert answer("device", "confirm")["Table status.Trial"] == 0
        assert answer("device", "verify", tables)["sequence"] == 3
        assert answer("device", "dump", tmp_path / "back.bin")["bytes"] == tables.stat().st_size
        answer("upload", newer)
        assert answer("device", "revert")["Table status.Active table sequence"] == 3
        assert all(answer("device", "selftest").values())


@pytest.mark.full
def test_command_that_needs_an_absent_table_is_refused(tmp_path: Path, tables: Path) -> None:
    with NodeProcess(tmp_path / "state"):
        for words, reason in (
            (("device", "dump", tmp_path / "back.bin"), "no table in force"),
            (("device", "verify", tables), "no table in force"),
            (("device", "activate"), "no committed table"),
            (("device", "confirm"), "no table is on trial"),
        ):
            refused = armtrue(*words)
            assert refused.returncode == 1
            assert reason in refused.stderr
            assert len(refused.stderr.splitlines()) == 1
        assert not (tmp_path / "back.bin").exists()


@pytest.mark.full
def test_monitor_shows_targets_corrections_and_clamping(tmp_path: Path) -> None:
    file = tmp_path / "tables.bin"
    file.write_bytes(small_table(magnitude=1 << 14))  # less than the table's correction
    targets = [100_000 + 1000 * joint for joint in range(6)]
    with NodeProcess(tmp_path / "state"):
        assert armtrue("upload", file, "--confirm").returncode == 0
        node = connect()
        for pair in range(3):
            node.sdo[0x1400 + pair][1].raw = 0x220 + 0x100 * pair
            node.sdo[0x1800 + pair][1].raw = OFFSET_COB_ID + 0x100 * pair
        node.sdo[0x2000][3].raw = 1_000_000
        node.sdo[0x2000][4].raw = 500_000
        node.sdo[0x2000][1].raw = 2
        node.nmt.state = "OPERATIONAL"
        leaving = threading.Event()

        def command() -> None:
            while not leaving.wait(0.05):
                for pair in range(3):
                    frame = struct.pack("<2i", *targets[2 * pair : 2 * pair + 2])
                    node.network.send_message(0x220 + 0x100 * pair, frame)

        commanding = threading.Thread(target=command)
        commanding.start()
        watched = armtrue("device", "monitor", "--duration", "3", "--json", "-")
        leaving.set()
        commanding.join()
        disconnect(node)
    assert watched.returncode == 0, watched.stderr
    document = json.loads(watched.stdout)
    assert document["mode"] == "offset"
    assert document["streaming"] is True
    assert document["targets"] == targets
    assert all(correction != 0 for correction in document["corrections"])
    assert "magnitude limited" in document["clamps"]
    assert document["counters"]["Cycles"] > 0
    assert document["counters"]["Clamped"] > 0
    assert all(document["clamped_cycles"])


@pytest.mark.full
def test_info_selftest_and_monitor_of_an_idle_node(remote: canopen.RemoteNode, tmp_path: Path) -> None:
    told = armtrue("device", "info", "--json", "-")
    assert told.returncode == 0, told.stderr
    assert json.loads(told.stdout)["Compensator status.Joint count"] == 6
    tested = armtrue("device", "selftest")
    assert tested.returncode == 0, tested.stderr
    assert tested.stdout.count("passed") == 5
    log = tmp_path / "run.log"
    watched = armtrue("device", "monitor", "--duration", "1", "--record", log, "--json", "-")
    assert watched.returncode == 0, watched.stderr
    document = json.loads(watched.stdout)
    assert document["state"] == "pass-through"
    assert document["targets"] == document["corrections"] == [0] * 6
    assert document["clamps"] == []
    assert document["counters"]["Cycles"] == 0
    assert 0.0 < document["bus_load"] < 1.0
    recorded = list(can.LogReader(str(log)))
    assert {0x600 + NODE_ID, 0x580 + NODE_ID} <= {message.arbitration_id for message in recorded}
