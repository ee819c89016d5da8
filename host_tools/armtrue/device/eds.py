"""The device's object dictionary by name, from the EDS that the firmware itself is generated from."""

from __future__ import annotations

import configparser
import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

# CiA 301, table 44: data type -> (bytes, signed); 0 bytes: a string or a DOMAIN.
_TYPES = {
    0x0002: (1, True),
    0x0003: (2, True),
    0x0004: (4, True),
    0x0005: (1, False),
    0x0006: (2, False),
    0x0007: (4, False),
    0x0009: (0, False),
    0x000F: (0, False),
}


@dataclass(frozen=True)
class Entry:
    """One value of the dictionary."""

    index: int
    sub: int
    name: str
    size: int
    signed: bool

    @property
    def is_number(self) -> bool:
        """Whether the value is an integer (and not text or a DOMAIN)."""
        return self.size > 0


@cache
def dictionary() -> dict[str, Entry]:
    """All values by name: `Object` for a variable, `Object.Sub name` for a sub-index."""
    parser = configparser.ConfigParser(interpolation=None, comment_prefixes=(";",))
    text = files("armtrue.device").joinpath("armtrue.eds").read_text(encoding="ascii")
    parser.read_string(text)
    found: dict[str, Entry] = {}
    for section in parser.sections():
        place = re.fullmatch(r"([0-9A-Fa-f]{4})(?:sub([0-9A-Fa-f]+))?", section)
        if place is None or "DataType" not in parser[section]:
            continue
        index, sub = int(place[1], 16), int(place[2] or "0", 16)
        own_name = parser[section]["ParameterName"]
        name = own_name if place[2] is None else f"{parser[place[1]]['ParameterName']}.{own_name}"
        size, signed = _TYPES[int(parser[section]["DataType"], 0)]
        found[name] = Entry(index, sub, name, size, signed)
    return found
