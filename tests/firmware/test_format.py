"""docs/table-format.md, the firmware's format.h and the writer's layout.py say the same."""

from __future__ import annotations

import re
import struct
from pathlib import Path

from armtrue.tables import layout
from armtrue.tables.layout import Node, Section, State

ROOT = Path(__file__).resolve().parents[2]
HEADER = (ROOT / "firmware/core/table/format.h").read_text()
LIMITS = (ROOT / "firmware/core/table/limits.h").read_text()
TABLE = (ROOT / "firmware/core/table/table.h").read_text()
PAGE = (ROOT / "docs/table-format.md").read_text()

RECORDS = {
    "joint": layout.JOINT, "tool": layout.TOOL, "coupling": layout.COUPLING, "state": layout.STATE,
    "sensor": layout.SENSOR, "gravity": layout.GRAVITY, "node": layout.NODE, "term": layout.TERM,
    "harmonic": layout.HARMONIC, "slow_wave": layout.SLOW_WAVE, "base": layout.BASE, "header": layout.HEADER,
}  # fmt: skip


def namespace(name: str) -> dict[str, int]:
    """Constants of a namespace of format.h."""
    body = re.search(rf"namespace {name} \{{(.*?)\}}  // namespace {name}", HEADER, re.S)
    assert body, name
    return {key: int(value, 0) for key, value in re.findall(r" k(\w+) = (0x[0-9A-F]+|\d+);", body[1])}


def enum_body(header: str, name: str) -> dict[str, int]:
    """Members of an enumeration."""
    body = re.search(rf"enum class {name} : std::uint\d+_t \{{(.*?)\}};", header, re.S)
    assert body, name
    return {key: int(value) for key, value in re.findall(r" k(\w+) = (\d+),", body[1])}


def enumeration(name: str) -> dict[str, int]:
    """Members of an enumeration of format.h, in the writer's spelling."""
    return {
        re.sub(r"(?<!^)([A-Z])", r"_\1", key).upper(): value for key, value in enum_body(HEADER, name).items()
    }


def test_record_lengths_agree() -> None:
    for name, record in RECORDS.items():
        assert namespace(name)["Length"] == record.size, name


def test_kinds_agree() -> None:
    assert enumeration("Section") == {kind.name: kind.value for kind in Section}
    assert enumeration("State") == {kind.name: kind.value for kind in State}
    assert enumeration("Node") == {kind.name: kind.value for kind in Node}


def test_header_offsets_are_on_the_page() -> None:
    offsets = [int(at) for at in re.findall(r"^\| (\d+) \| [^|]+ \| ", PAGE.split("## Directory")[0], re.M)]
    named = sorted(value for key, value in namespace("header").items() if key.endswith("At"))
    assert offsets == named


def test_section_table_is_on_the_page() -> None:
    rows = dict(re.findall(r"^\| (\d+) \| [a-z ]+ \| ([\d]+) \|", PAGE.split("## Directory")[1], re.M))
    assert {int(kind) for kind in rows} == {kind.value for kind in Section} - {Section.MASS_SETS}
    sizes = {
        Section.JOINTS: layout.JOINT, Section.TOOLS: layout.TOOL, Section.COUPLING: layout.COUPLING,
        Section.STATE: layout.STATE, Section.SENSORS: layout.SENSOR, Section.GRAVITY: layout.GRAVITY,
        Section.NODES: layout.NODE, Section.TERMS: layout.TERM, Section.HARMONICS: layout.HARMONIC,
        Section.SLOW_WAVES: layout.SLOW_WAVE, Section.BASE: layout.BASE,
    }  # fmt: skip
    for kind, record in sizes.items():
        assert int(rows[str(kind.value)]) == record.size, kind


def test_every_node_kind_is_on_the_page() -> None:
    table = PAGE.split("## Nodes")[1].split("**Cubic data**")[0]
    kinds = {int(k) for row in re.findall(r"^\| ([\d, ]+) \|", table, re.M) for k in row.split(",")}
    assert kinds == {kind.value for kind in Node}


def test_limits_agree() -> None:
    def limit(name: str) -> int:
        match = re.search(rf"{name} = (\d+)(?:U \* (\d+)U)?;", LIMITS)
        assert match, name
        return int(match[1]) * int(match[2] or 1)

    assert limit("kMaxJoints") == layout.MAX_JOINTS
    assert limit("kMaxTools") == layout.MAX_TOOLS
    assert limit("kMaxSensors") == layout.MAX_SENSORS
    assert limit("kMaxMassSets") == layout.MAX_MASS_SETS
    assert limit("kMaxSlots") == layout.MAX_SLOTS
    assert limit("kMaxTerms") == layout.MAX_TERMS
    assert limit("kMaxHarmonics") == layout.MAX_HARMONICS
    assert limit("kMaxSlowWaves") == layout.MAX_SLOW_WAVES
    assert limit("kMaxGridAxes") == layout.MAX_GRID_AXES
    assert limit("kMaxImageLength") == layout.MAX_IMAGE_LENGTH
    assert limit("kSerialLength") == layout.SERIAL_LENGTH
    for slides, name in ((False, "Revolute"), (True, "Prismatic")):
        assert abs(limit(f"kMaxDelta{name}") - layout.MAX_DELTA[slides] * 2**32) < 1
        assert abs(limit(f"kMaxRate{name}") - layout.MAX_RATE[slides] * 2**32) < 1


_TYPE = re.compile(r"\b(u8|i8|u16|i16|u32|i32|i64|f64|char)(?:\[(\d+)\])?(?![\w\[])")
_BYTES = {"u8": 1, "i8": 1, "char": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4, "i64": 8, "f64": 8}


def fields_on_page(text: str) -> list[tuple[int, int]]:
    """(bytes of an element, elements) of every field that a sentence or a table's cell names, in order."""
    return [(_BYTES[kind], int(count or 1)) for kind, count in _TYPE.findall(text)]


def fields_of(record: struct.Struct) -> list[int]:
    """Bytes of every element of the writer's record, in order; text counts byte by byte."""
    result: list[int] = []
    for count, code in re.findall(r"(\d*)([a-zA-Z?])", record.format.lstrip("<")):
        size = struct.calcsize(f"<{code}")
        result += [size] * int(count or 1)
    return result


def elements(fields: list[tuple[int, int]]) -> list[int]:
    return [size for size, count in fields for _ in range(count)]


def table_rows(section: str) -> list[list[str]]:
    """Cells of the first table in a section whose first column is a byte offset."""
    text = PAGE.split(section)[1].split("\n\n", 2)[1]
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if re.match(r"\| \d+ \|", line)
    ]


def test_every_field_of_the_header_is_on_the_page() -> None:
    rows = table_rows("## Header")
    assert elements([field for row in rows for field in fields_on_page(row[1])]) == fields_of(layout.HEADER)
    at = 0
    for offset, kind, *_ in rows:
        assert int(offset) == at
        at += sum(size * count for size, count in fields_on_page(kind))
    assert at == layout.HEADER.size


def test_every_field_of_a_joint_is_on_the_page() -> None:
    rows = table_rows("## Joint (84)")
    assert elements([field for row in rows for field in fields_on_page(row[1])]) == fields_of(layout.JOINT)
    at = 0
    for offset, kind, *_ in rows:
        assert int(offset) == at
        at += sum(size * count for size, count in fields_on_page(kind))
    assert at == layout.JOINT.size


def test_every_field_of_the_other_records_is_on_the_page() -> None:
    sentences = {
        "Tool": layout.TOOL, "Coupling": layout.COUPLING, "Sensor": layout.SENSOR, "Base": layout.BASE,
        "Gravity": layout.GRAVITY, "Term": layout.TERM, "Harmonic": layout.HARMONIC, "Slow wave": layout.SLOW_WAVE,
    }  # fmt: skip
    for name, record in sentences.items():
        found = re.search(rf"^\*\*{name}\*\* \((\d+)\): (.*)$", PAGE, re.M)
        assert found, name
        assert int(found[1]) == record.size
        assert elements(fields_on_page(found[2])) == fields_of(record), name
    for marker, record in (("`u8 kind, u8 index", layout.STATE), ("`u8 kind, i8 s", layout.NODE)):
        code = next(line for line in PAGE.splitlines() if line.startswith(marker)).split("`")[1]
        assert elements(fields_on_page(code)) == fields_of(record)
    mass_set = re.search(r"^\*\*Mass set\*\*: (.*)", PAGE, re.M)
    assert mass_set
    head, link = mass_set[1].split("; then per joint ")
    assert elements(fields_on_page(head)) == fields_of(layout.MASS_SET_HEAD)
    assert elements(fields_on_page(link)) == fields_of(layout.MASS_SET_LINK)


def test_grid_data_is_on_the_page() -> None:
    text = PAGE.split("**Table data**")[1].split("## What acts on what")[0]
    head, axis = text.split("Per axis:")
    assert elements(fields_on_page(head)) == fields_of(layout.GRID_HEAD)
    axis = axis.split("; then, even spacing")[0]
    assert elements(fields_on_page(axis)) == [2, 2, 1, 1, 1, 1]
    assert layout.GRID_AXIS.size == 8


def test_every_state_variable_is_on_the_page_with_its_fraction() -> None:
    text = PAGE.split("## State variables (4)")[1].split("Order:")[0]
    rows = re.findall(r"^\| ([\d, ]+) \| [^|]+ \| [^|]+ \| ([^|]+) \|", text, re.M)
    fractions = {int(kind): fraction.strip() for kinds, fraction in rows for kind in kinds.split(",")}
    assert set(fractions) == {kind.value for kind in State}
    for kind in State:
        known = layout.STATE_FRACTION.get(kind)
        assert fractions[kind.value] == (str(known) if known is not None else "as its set"), kind


def test_every_reason_is_on_the_protocols_page() -> None:
    """Only the numbers: tests/can/test_object_dictionary.py compares the texts with those that the client prints."""
    codes = enum_body(TABLE, "Refusal")
    rows = (ROOT / "docs/protocol.md").read_text().split("why a table was refused")[1].split("## Status")[0]
    listed = {int(code) for code in re.findall(r"^  - (\d+): ", rows, re.M)}
    assert len(codes) > 20
    assert listed == set(codes.values()) - {0}


def test_a_changed_field_would_be_noticed() -> None:
    assert fields_on_page("i32[9] Q30") == [(4, 9)]
    assert elements(fields_on_page("u8, u8")) != fields_of(struct.Struct("<BH"))
    assert fields_of(struct.Struct("<4sHB3i")) == [1, 1, 1, 1, 2, 1, 4, 4, 4]
