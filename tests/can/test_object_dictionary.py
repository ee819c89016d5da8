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


def test_the_clients_load_the_same_file() -> None:
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
def test_an_eds_that_contradicts_itself_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
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


@pytest.mark.parametrize(
    ("source", "pattern"),
    [
        ("protocol/emcy.cc", r"\{0x([0-9A-F]{4}), kGeneric"),
        ("protocol/sdo_abort.h", r"= 0x([0-9A-F]{8}),"),
    ],
)
def test_the_protocol_page_has_every_code(source: str, pattern: str) -> None:
    codes = set(re.findall(pattern, (EDS.parents[1] / source).read_text(encoding="utf-8")))
    assert len(codes) > 10
    assert {code for code in codes if f"0x{code}" not in PROTOCOL} == set()


def test_the_protocol_page_has_every_reason_and_command() -> None:
    for reason, words in REFUSALS.items():
        number = f"0x{reason:X}" if reason >= 0x100 else str(reason)
        assert reason == 0 or f"| {number} | {words} |" in PROTOCOL, words
    header = (EDS.parents[1] / "table/table_transfer.h").read_text(encoding="utf-8")
    commands = re.findall(r'= 0x([0-9A-Fa-f]{8}), +// "(\w{4})"', header)
    assert len(commands) == 6
    for code, word in commands:
        wire = " ".join(f"{byte:02X}" for byte in int(code, 16).to_bytes(4, "little"))
        assert f'`23 12 20 00 {wire}` "{word}"' in PROTOCOL


def test_every_test_that_the_security_page_names_is_there() -> None:
    tests = (Path(__file__).with_name("test_hostile_bus.py")).read_text(encoding="utf-8")
    named = re.findall(r"`…\[([^\]]+)\]`", SECURITY)
    assert len(named) >= 9
    for case in named:
        assert f'"{case}"' in tests, case
    for function in re.findall(r"`(test_\w+)`", SECURITY):
        assert any(
            f"def {function}(" in file.read_text("utf-8") for file in Path(__file__).parents[1].rglob("*.py")
        )


def test_every_test_that_the_protocol_page_names_is_there() -> None:
    table = PROTOCOL[PROTOCOL.index("## Faults, and what is expected") :]
    firmware = "".join(file.read_text("utf-8") for file in (ROOT / "firmware").rglob("*_test.cc"))
    python = "".join(file.read_text("utf-8") for file in Path(__file__).parent.rglob("*.py"))
    named = re.findall(r"`([A-Z]\w{12,})`", table)
    assert len(named) >= 15
    assert [test for test in named if f", {test})" not in firmware] == []
    assert [test for test in re.findall(r"`(test_\w+)`", table) if f"def {test}(" not in python] == []


def test_constants_on_the_protocol_page_are_those_of_the_code() -> None:
    """Rows of name, value and file; "same" is the file of the row before."""
    page = (ROOT / "docs" / "protocol.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`[^|]*\bk[A-Z][^|]*) \| ([\d ,]+) \| ([^|]*) \|$", page, re.MULTILINE)
    assert len(rows) >= 10
    source = ""
    for names, values, where in rows:
        if (file := re.match(r"`([^`]+)`", where)) is not None:
            source = (ROOT / file[1]).read_text(encoding="utf-8").replace("'", "")
        for name, value in zip(re.findall(r"k[A-Z]\w+", names), values.split(","), strict=True):
            assert re.search(rf"\b{name} = {value.replace(' ', '')};", source), name
