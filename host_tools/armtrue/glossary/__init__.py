"""The terms of docs/glossary.md, which the wheel packs beside this module."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_ENTRY = re.compile(r"- \*\*(?P<name>[^*]+)\*\*(?: \((?P<also>[^)]+)\))?: (?P<text>.+)")


@dataclass(frozen=True)
class Entry:
    """One term: its `name`, what else it is called (empty: nothing), and what it means."""

    name: str
    also: str
    text: str

    @property
    def names(self) -> list[str]:
        """All that the term is called."""
        return [self.name, *filter(None, self.also.split(", "))]


def glossary() -> dict[str, Entry]:
    """All terms by name, in alphabetical order; text without Markdown."""
    text = Path(__file__).with_name("glossary.md").read_text(encoding="utf-8")
    entries = {}
    for line in text.replace("`", "").splitlines():
        if found := _ENTRY.fullmatch(line):
            entries[found["name"]] = Entry(found["name"], found["also"] or "", found["text"])
    return entries


def find(term: str) -> Entry | None:
    """The entry that goes by `term`, whatever its case; a plural finds the singular."""
    wanted = term.lower().replace("-", " ").replace("_", " ").strip()
    for entry in glossary().values():
        plain = [name.lower().replace("-", " ").replace("_", " ") for name in entry.names]
        if wanted in plain or wanted.removesuffix("s") in plain:
            return entry
    return None
