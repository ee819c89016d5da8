#!/usr/bin/env python3
"""Generate the C++ object dictionary and its reference page from armtrue.eds.

    generate_od.py EDS --header od_generated.h --source od_generated.cc
    generate_od.py EDS --markdown FILE

Reads CiA 306-1 with the standard library only, so that a build needs no Python package.
"""

from __future__ import annotations

import argparse
import configparser
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

# CiA 301, table 44: data type code -> (C++ enumerator, C++ type, size in bytes; 0: variable).
TYPES = {
    0x0002: ("kInteger8", "std::int8_t", 1),
    0x0003: ("kInteger16", "std::int16_t", 2),
    0x0004: ("kInteger32", "std::int32_t", 4),
    0x0005: ("kUnsigned8", "std::uint8_t", 1),
    0x0006: ("kUnsigned16", "std::uint16_t", 2),
    0x0007: ("kUnsigned32", "std::uint32_t", 4),
    0x0009: ("kVisibleString", "char", 0),
    0x000F: ("kDomain", "void", 0),
}
NODE_ID = "$NODEID"
# Bytes of the RAM image reserved for a string that the device fills in at run time.
STRING_CAPACITY = 64
# Objects that are writable but not saved by 0x1010: the error history, the save and restore commands.
NEVER_STORED = {0x1003, 0x1010, 0x1011}


class EdsError(ValueError):
    """The EDS breaks a rule of CiA 306-1 or uses a feature that this device does not have."""


@dataclass
class Leaf:
    """One readable or writable value: a variable, or one sub-index."""

    index: int
    sub: int
    name: str
    type_code: int
    access: str
    default: str
    mappable: bool
    low: str | None
    high: str | None
    offset: int = 0

    @property
    def label(self) -> str:
        """Index, sub-index and name, for messages."""
        return f"{self.index:04X}sub{self.sub:X} ({self.name})"

    @property
    def is_string(self) -> bool:
        """Whether the value is text."""
        return self.type_code == 0x0009

    @property
    def is_domain(self) -> bool:
        """Whether the content is outside the dictionary."""
        return self.type_code == 0x000F

    @property
    def in_rom(self) -> bool:
        """Whether the value is constant text, kept out of the RAM image."""
        return self.is_string and self.access == "const"

    @property
    def size(self) -> int:
        """Bytes in the RAM image or in the constant strings."""
        if self.is_domain:
            return 0
        if self.is_string:
            return len(self.default) if self.in_rom else STRING_CAPACITY
        return TYPES[self.type_code][2]

    @property
    def stored(self) -> bool:
        """Whether 0x1010 saves it."""
        return (
            self.access == "rw"
            and not self.mappable
            and not self.is_domain
            and self.index not in NEVER_STORED
        )

    @property
    def relative_to_node(self) -> bool:
        """Whether the node-ID is added to its default."""
        return NODE_ID in self.default

    def number(self) -> int:
        """The default value, without the node-ID if it is relative to it."""
        text = self.default.replace(NODE_ID, "").replace("+", "").strip()
        try:
            return int(text or "0", 0)
        except ValueError:
            raise EdsError(f"{self.label}: DefaultValue is '{self.default}', expected an integer") from None


@dataclass
class Object:
    """One index with its values."""

    index: int
    name: str
    kind: str
    leaves: list[Leaf] = field(default_factory=list)


def read_eds(path: Path) -> list[Object]:
    """All objects of the EDS in index order. Raises EdsError naming section and key."""
    parser = configparser.ConfigParser(interpolation=None, comment_prefixes=(";",), strict=True)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(path.read_text(encoding="ascii"))
    listed: list[int] = []
    for section in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        count = int(parser[section]["SupportedObjects"], 0)
        listed += [int(parser[section][str(k)], 0) for k in range(1, count + 1)]
    described = {int(name, 16) for name in parser.sections() if re.fullmatch(r"[0-9A-F]{4}", name)}
    if set(listed) != described or len(listed) != len(described):
        odd = ", ".join(f"{index:04X}" for index in sorted(set(listed) ^ described))
        raise EdsError(f"object lists and sections differ: {odd or 'an object is listed twice'}")
    return [_read_object(parser, index) for index in sorted(described)]


def _read_object(parser: configparser.ConfigParser, index: int) -> Object:
    section = parser[f"{index:04X}"]
    kind = {0x2: "DOMAIN", 0x7: "VAR", 0x8: "ARRAY", 0x9: "RECORD"}[int(section["ObjectType"], 0)]
    found = Object(index, section["ParameterName"], kind)
    if kind in ("VAR", "DOMAIN"):
        found.leaves.append(_read_leaf(section, index, 0))
        return found
    prefix = f"{index:04X}sub"
    subs = sorted(int(name[len(prefix) :], 16) for name in parser.sections() if name.startswith(prefix))
    if len(subs) != int(section["SubNumber"], 0):
        raise EdsError(f"{index:04X}: SubNumber is {section['SubNumber']}, found {len(subs)} sub-indexes")
    found.leaves = [_read_leaf(parser[f"{prefix}{sub:X}"], index, sub) for sub in subs]
    return found


def _read_leaf(section: configparser.SectionProxy, index: int, sub: int) -> Leaf:
    leaf = Leaf(
        index, sub, section["ParameterName"], int(section["DataType"], 0), section["AccessType"],
        section["DefaultValue"], section["PDOMapping"] == "1", section.get("LowLimit"), section.get("HighLimit"),
    )  # fmt: skip
    if leaf.type_code not in TYPES:
        raise EdsError(f"{leaf.label}: DataType 0x{leaf.type_code:04X} is not one this device has")
    if leaf.access not in ("ro", "wo", "rw", "const"):
        raise EdsError(f"{leaf.label}: AccessType '{leaf.access}', expected ro, wo, rw or const")
    return leaf


def _camel(text: str) -> str:
    words = re.findall(r"[A-Za-z0-9]+", re.sub(r"\(.*?\)", "", text))
    return "k" + "".join(word[0].upper() + word[1:] for word in words)


def _snake(text: str) -> str:
    return "_".join(word.lower() for word in re.findall(r"[A-Za-z0-9]+", re.sub(r"\(.*?\)", "", text)))


def lay_out(objects: list[Object]) -> tuple[list[Leaf], bytearray, str]:
    """Assign every value its offset. Returns the leaves, the RAM image of defaults, the ROM strings."""
    leaves = [leaf for found in objects for leaf in found.leaves]
    image, strings = bytearray(), ""
    for leaf in leaves:
        if leaf.is_domain:
            continue
        if leaf.in_rom:
            leaf.offset = len(strings)
            strings += leaf.default
            continue
        leaf.offset = len(image)
        if leaf.is_string:
            image += leaf.default.encode("ascii").ljust(STRING_CAPACITY, b"\0")
        else:
            image += (leaf.number() % (1 << 8 * leaf.size)).to_bytes(leaf.size, "little")
    return leaves, image, strings


def _reference(leaf: Leaf) -> str:
    return f"{{0x{leaf.index:04X}, {leaf.sub}, {leaf.offset}}}"


def _reference_row(cpp: str, name: str, values: list[Leaf]) -> str:
    """A `Ref` array of the same value of every RPDO, TPDO, axis or sub-index, in order."""
    references = ", ".join(_reference(leaf) for leaf in values)
    return f"inline constexpr Ref<{cpp}> {name}[] = {{{references}}};"


def _reference_lines(objects: list[Object]) -> list[str]:
    """`Ref` constants: one per variable, an array per numbered family and per CiA 301 array."""
    families: dict[tuple[str, str, str], list[Leaf]] = {}
    lines: list[str] = []
    for found in objects:
        numbered = re.match(r"(RPDO|TPDO|Axis )(\d+) (.*)", found.name)
        if numbered:
            group, rest = numbered[1].strip().lower(), numbered[3]
            if rest.startswith("mapping"):
                first = families.setdefault((group, "kMappingCount", "std::uint8_t"), [])
                first.append(found.leaves[0])
                families.setdefault((group, "kMapping", "std::uint32_t"), []).append(found.leaves[1])
                continue
            for leaf in found.leaves:
                if leaf.sub == 0 and found.kind in ("RECORD", "ARRAY"):
                    continue
                name = re.sub(r"^Axis \d+ | used by [RT]PDO\d+", "", leaf.name)
                families.setdefault((group, _camel(name), TYPES[leaf.type_code][1]), []).append(leaf)
            continue
        if found.kind == "ARRAY" and len(found.leaves) > 2:
            values = found.leaves[1:]
            cpp = TYPES[values[0].type_code][1]
            lines.append(_reference_row(cpp, _camel(found.name), values))
            lines.append(
                f"inline constexpr Ref<std::uint8_t> {_camel(found.name)}Count = {_reference(found.leaves[0])};"
            )
        elif found.kind in ("RECORD", "ARRAY"):
            lines.append(f"namespace {_snake(found.name)} {{")
            for leaf in found.leaves[1:]:
                cpp = TYPES[leaf.type_code][1]
                lines.append(f"inline constexpr Ref<{cpp}> {_camel(leaf.name)} = {_reference(leaf)};")
            lines.append("}")
        elif not found.leaves[0].in_rom:
            leaf = found.leaves[0]
            lines.append(
                f"inline constexpr Ref<{TYPES[leaf.type_code][1]}> {_camel(found.name)} = {_reference(leaf)};"
            )
    for (group, name, cpp), values in families.items():
        lines.append(f"namespace {group} {{")
        lines.append(_reference_row(cpp, name, values))
        lines.append("}")
    return lines


HEADER = """\
// Generated from {eds} by generate_od.py. Do not edit.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_OD_GENERATED_H_
#define ARMTRUE_FIRMWARE_CANOPEN_OD_GENERATED_H_

#include <cstddef>

#include "firmware/canopen/protocol/od_entry.h"

namespace armtrue::canopen::od {{

inline constexpr std::size_t kImageSize = {image};
inline constexpr std::size_t kEntryCount = {entries};
inline constexpr std::size_t kStoredSize = {stored};
inline constexpr std::size_t kLimitCount = {limits};
inline constexpr std::size_t kNodeRelativeCount = {relative};
// Changes with every change of the dictionary's layout: saved parameters of another layout are refused.
inline constexpr std::uint32_t kLayoutFingerprint = 0x{fingerprint:08X}U;

extern const Entry kEntries[kEntryCount];                  // by index, then sub-index
extern const std::uint8_t kDefaults[kImageSize];           // little endian, node-ID not yet added
extern const char kStrings[];                              // constant strings, end to end
extern const Limit kLimits[kLimitCount];                   // by index, then sub-index
extern const std::uint16_t kNodeRelative[kNodeRelativeCount];  // offsets of UNSIGNED32 += node-ID

{references}

}}  // namespace armtrue::canopen::od

#endif  // ARMTRUE_FIRMWARE_CANOPEN_OD_GENERATED_H_
"""


def _flags(leaf: Leaf) -> str:
    flags = []
    if leaf.access in ("ro", "rw", "const"):
        flags.append("kReadable")
    if leaf.access in ("wo", "rw"):
        flags.append("kWritable")
    if leaf.mappable:
        flags.append("kMappable")
    if leaf.stored:
        flags.append("kStored")
    if leaf.in_rom:
        flags.append("kInRom")
    return " | ".join(flags)


def _fingerprint(leaves: list[Leaf]) -> int:
    """32-bit FNV-1a hash over everything that determines the layout of saved parameters."""
    value = 0x811C9DC5
    for leaf in leaves:
        for byte in f"{leaf.index:04X}{leaf.sub:02X}{leaf.type_code:04X}{leaf.stored:d}".encode():
            value = (value ^ byte) * 0x01000193 % (1 << 32)
    return value


def write_cpp(eds: Path, header: Path, source: Path) -> None:
    """Write the dictionary's declarations and tables."""
    objects = read_eds(eds)
    leaves, image, strings = lay_out(objects)
    limits = [leaf for leaf in leaves if leaf.low is not None or leaf.high is not None]
    relative = [leaf for leaf in leaves if leaf.relative_to_node]
    header.write_text(
        HEADER.format(
            eds=eds.name,
            image=len(image),
            entries=len(leaves),
            stored=sum(leaf.size for leaf in leaves if leaf.stored),
            limits=len(limits),
            relative=len(relative),
            fingerprint=_fingerprint(leaves),
            references="\n".join(_reference_lines(objects)),
        )
    )
    lines = [f"// Generated from {eds.name} by generate_od.py. Do not edit."]
    lines += [f'#include "{header.name}"', "", "namespace armtrue::canopen::od {", ""]
    lines.append("const Entry kEntries[kEntryCount] = {")
    for leaf in leaves:
        kind = TYPES[leaf.type_code][0]
        lines.append(
            f"    {{0x{leaf.index:04X}, {leaf.sub}, Type::{kind}, {leaf.offset}, {leaf.size}, {_flags(leaf)}}},"
        )
    lines += ["};", "", "const std::uint8_t kDefaults[kImageSize] = {"]
    for start in range(0, len(image), 16):
        lines.append("    " + ", ".join(f"0x{byte:02X}" for byte in image[start : start + 16]) + ",")
    lines += ["};", "", f'const char kStrings[] = "{strings}";', "", "const Limit kLimits[kLimitCount] = {"]
    for leaf in limits:
        low, high = int(leaf.low or "0", 0), int(leaf.high or "0xFFFFFFFF", 0)
        lines.append(f"    {{0x{leaf.index:04X}, {leaf.sub}, {low}U, {high}U}},  // {leaf.label}")
    lines += ["};", "", "const std::uint16_t kNodeRelative[kNodeRelativeCount] = {"]
    lines.append("    " + ", ".join(str(leaf.offset) for leaf in relative) + ",")
    lines += ["};", "", "}  // namespace armtrue::canopen::od"]
    source.write_text("\n".join(lines) + "\n")


def _cells(leaf: Leaf) -> str:
    """The cells of a row after object and name."""
    kind = TYPES[leaf.type_code][0][1:].upper()
    limits = f"{leaf.low or ''}…{leaf.high or ''}" if leaf.low is not None or leaf.high is not None else ""
    return (
        f"{kind} | {leaf.access} | {leaf.default} | {limits} "
        f"| {'yes' if leaf.mappable else ''} | {'yes' if leaf.stored else ''} |"
    )


def _runs(leaves: list[Leaf]) -> list[list[Leaf]]:
    """Group consecutive sub-indexes that differ only by a number in their names."""
    runs: list[list[Leaf]] = []
    for leaf in leaves:
        like = re.sub(r"\d+", "", leaf.name), _cells(leaf)
        last = runs[-1][-1] if runs else None
        if last and (re.sub(r"\d+", "", last.name), _cells(last)) == like and leaf.sub == last.sub + 1:
            runs[-1].append(leaf)
        else:
            runs.append([leaf])
    return runs


def _rows(place: str, title: str, leaves: list[Leaf]) -> list[str]:
    """The rows of an object, with a heading row if there are several."""
    runs = _runs(leaves)
    lines = [f"| **{place}** | **{title}** | | | | | | |"] if len(runs) > 1 else []
    for run in runs:
        first, last = run[0], run[-1]
        sub = str(first.sub) if len(run) == 1 else f"{first.sub}…{last.sub}"
        name = first.name if len(run) == 1 else f"{first.name} … {last.name}"
        where = f"**{place}**" + (f":{sub}" if sub != "0" else "") if len(runs) == 1 else f":{sub}"
        lines.append(f"| {where} | {name} | {_cells(first)}")
    return lines


def write_markdown(eds: Path, page: Path) -> None:
    """Write the reference page. Numbered families (RPDO n, TPDO n, axis n) are shown once."""
    lines = [
        "# Object dictionary",
        "",
        f"Made from `{eds.name}` by `generate_od.py`. What the manufacturer objects mean: docs/protocol.md.",
        "",
        "| object:sub | name | type | access | default | range | PDO | saved |",
        "|---|---|---|---|---|---|---|---|",
    ]
    families: dict[str, list[Object]] = {}
    objects = read_eds(eds)
    for found in objects:
        families.setdefault(re.sub(r"^(RPDO|TPDO|Axis )\d+", r"\1n", found.name), []).append(found)
    done: set[str] = set()
    for found in objects:
        key = re.sub(r"^(RPDO|TPDO|Axis )\d+", r"\1n", found.name)
        if key in done:
            continue
        done.add(key)
        family = families[key]
        place, title = f"0x{found.index:04X}", found.name
        if len(family) > 1:
            place = f"0x{family[0].index:04X}–0x{family[-1].index:04X}"
            title = f"{key}, n = 1…{len(family)} (shown: n = 1)"
        lines += _rows(place, title, found.leaves)
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> int:
    """Command line; exit status 2 with one sentence if the EDS is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("eds", type=Path)
    parser.add_argument("--header", type=Path)
    parser.add_argument("--source", type=Path)
    parser.add_argument("--markdown", type=Path)
    arguments = parser.parse_args()
    try:
        if arguments.header and arguments.source:
            write_cpp(arguments.eds, arguments.header, arguments.source)
        if arguments.markdown:
            write_markdown(arguments.eds, arguments.markdown)
    except (EdsError, KeyError, OSError, configparser.Error) as problem:
        print(f"{arguments.eds}: {problem}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
