"""The EDS is the only source of the object dictionary: its page is generated from it, faults in it are named."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import canopen
import pytest
from armtrue.device.compensator import REFUSALS
from node_process import EDS, ROOT

pytestmark = pytest.mark.without_bus
GENERATOR = EDS.with_name("generate_od.py")


def generate(eds: Path, page: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(GENERATOR), str(eds), "--markdown", str(page)],
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_page_has_every_object_of_the_eds(tmp_path: Path) -> None:
    done = generate(EDS, tmp_path / "page.md")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    unnumbered = re.sub(r"(RPDO|TPDO|Axis )(\d+|n)", r"\1", page)
    objects = [found for found in canopen.import_od(str(EDS), 32).values() if found.index >= 0x1000]
    names = {re.sub(r"^(RPDO|TPDO|Axis )\d+", r"\1", found.name) for found in objects}
    assert len(names) > 40
    assert {name for name in names if name not in unnumbered} == set()
    assert "| :3 | Stale time-out (us) | UNSIGNED32 | rw | 20000 | 500…1000000 |  | yes |" in page


def test_host_tools_contain_the_same_eds() -> None:
    installed = ROOT / "host_tools" / "armtrue" / "device" / "armtrue.eds"
    assert installed.read_bytes() == EDS.read_bytes()
    assert len(canopen.import_od(str(EDS), 32)) > 150


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[1000]\nParameterName=Device type", "[1FFF]\nParameterName=Device type", "1000, 1FFF"),
        ("DataType=0x0009", "DataType=0x0008", "DataType 0x0008"),
        ("AccessType=wo", "AccessType=rwx", "AccessType 'rwx'"),
    ],
)
def test_eds_that_contradicts_itself_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = EDS.read_text(encoding="ascii")
    assert old in text
    spoilt = tmp_path / "spoilt.eds"
    spoilt.write_text(text.replace(old, new, 1), encoding="ascii")
    done = generate(spoilt, tmp_path / "page.md")
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "page.md").exists()


PROTOCOL = (ROOT / "docs" / "protocol.md").read_text(encoding="utf-8")
SECURITY = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")


def codes_of(source: str, pattern: str) -> set[str]:
    codes = set(re.findall(pattern, (EDS.parents[1] / source).read_text(encoding="utf-8")))
    assert len(codes) > 10
    return codes


def test_the_protocol_page_has_every_emergency_code() -> None:
    codes = codes_of("protocol/emcy.cc", r"\{0x([0-9A-F]{4}), kGeneric")
    assert {code for code in codes if f"0x{code}" not in PROTOCOL} == set()


def test_abort_codes_on_the_protocol_page_are_those_of_the_code() -> None:
    """The page lists codes with a particular meaning here; CiA 301 lists the others."""
    particular = set(re.findall(r"^- 0x([0-9A-F]{8}): ", PROTOCOL, re.MULTILINE))
    assert len(particular) >= 7
    assert particular <= codes_of("protocol/sdo_abort.h", r"= 0x([0-9A-F]{8}),")


def test_protocol_page_has_every_refusal_reason_and_command() -> None:
    for reason, words in REFUSALS.items():
        number = f"0x{reason:X}" if reason >= 0x100 else str(reason)
        assert reason == 0 or f"  - {number}: {words}\n" in PROTOCOL, words
    header = (EDS.parents[1] / "table/table_transfer.h").read_text(encoding="utf-8")
    commands = re.findall(r'= 0x([0-9A-Fa-f]{8}), +// "(\w{4})"', header)
    assert len(commands) == 6
    for code, word in commands:
        wire = " ".join(f"{byte:02X}" for byte in int(code, 16).to_bytes(4, "little"))
        assert f'`23 12 20 00 {wire}` "{word}"' in PROTOCOL


def test_security_page_lists_the_tried_tables_and_their_reasons() -> None:
    """In the order of tests/can/test_hostile_bus.py; a wider magnitude and a faster rate are one line."""
    tests = Path(__file__).with_name("test_hostile_bus.py").read_text(encoding="utf-8")
    named = re.search(r"^(UNSIGNED[A-Z_, ]+) = ([0-9a-fx, ]+)$", tests, re.MULTILINE)
    assert named
    code = dict(zip(named[1].split(", "), (int(value, 0) for value in named[2].split(", ")), strict=True))
    tried = [code[reason] for reason in re.findall(r"^ +\(lambda: .*, ([A-Z_]+)\),$", tests, re.MULTILINE)]
    listed = [int(reason, 0) for reason in re.findall(r"^- .*reason (0x\w+|\d+)", SECURITY, re.MULTILINE)]
    assert len(tried) >= 9
    assert tried == [*listed, listed[-1]]


_MOTION, _SDO = "canopen/motion/joint_path.h", "canopen/sdo/sdo_server.h"


@pytest.mark.parametrize(
    ("words", "constant", "source"),
    [
        ("at most 0.1 s (`kSupervisionUs`) after the turn before", "kSupervisionUs = 100000", _MOTION),
        (
            "nothing is sent until targets have stood for 0.1 s",
            "kRestUs = 100000",
            "canopen/motion/start_positions.h",
        ),
        ("after 100 clean sets", "kCleanSets = 100", _MOTION),
        (
            "Targets for 0.1 s without a set that goes out",
            "kWithheldUs = 100000",
            "canopen/motion/stream_watch.h",
        ),
        ("after 5 s in any case", "kLeaveUs = 5000000", _MOTION),
        ("more than 1/500 turn between two frames", "kJumpPart = 500", "canopen/motion/drive_states.h"),
        ("and 2 turns a second", "kFastestTurns = 2", "canopen/motion/drive_states.h"),
        ("returns to zero within 2000 control periods", "kFadeCycles = 2000", "core/compensator.h"),
        ("After 0.1 s (`kRecoveryPauseUs`)", "kRecoveryPauseUs = 100000", "canopen/node/bus_watch.h"),
        ("A silent client times out after 2 s", "kTimeOutUs = 2000000", _SDO),
        ("one a millisecond while joints are commanded", "kSegmentPauseUs = 1000", _SDO),
        ("up to four in a turn of the loop", "kSegmentsPerTurn = 4", "canopen/sdo/sdo_server.cc"),
        (
            "after a second while a request is carried out at rest",
            "kUsualMs = 1000",
            "ports/stm32f405/watchdogs.h",
        ),
        ("(eight while a sector is erased)", "kEraseMs = 8000", "ports/stm32f405/watchdogs.h"),
    ],
)
def test_times_on_the_protocol_page_are_those_of_the_code(words: str, constant: str, source: str) -> None:
    code = (ROOT / "firmware" / source).read_text(encoding="utf-8").replace("'", "")
    assert words in " ".join(PROTOCOL.split())
    assert re.search(rf"\b{constant};", code)
