"""The catalogue of effects, as the fitter lists it."""

from __future__ import annotations

import functools
import json
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class EffectInfo:
    """One effect of the catalogue.

    `joints`: "none", "each", "all" (together, or each on its own), "pair" (driven, driving), "fixed" (only its own).
    `options`: name → kind of value and description, as `armtrue._core` writes them. `bound`: physical bound and its
    source, in words. `role`: "placement" (of base and tool), "geometry", "physical", "table", "measurement" or
    "custom". `exported`: False if it belongs to the measurement. `needs_drive`: which of its joints must have a
    motor: "none", "each" or "driving" (of a pair).
    """

    id: str
    joints: str
    options: dict[str, tuple[str, str]]
    summary: str
    bound: str
    role: str
    exported: bool
    needs_drive: str

    @property
    def bound_and_source(self) -> tuple[str, str]:
        """The physical bound, and where it comes from."""
        bound, _, source = self.bound.partition(": ")
        return bound, source

    def document(self) -> dict[str, Any]:
        """JSON-able form."""
        options = {name: {"type": kind, "help": text} for name, (kind, text) in self.options.items()}
        return {**asdict(self), "options": options}


def with_role(*roles: str) -> list[str]:
    """Ids of the effects with one of these roles."""
    return [info.id for info in catalogue().values() if info.role in roles]


@functools.cache
def catalogue() -> dict[str, EffectInfo]:
    """All effects by id, from `armtrue._core.effects()`."""
    from armtrue import _core

    entries: list[dict[str, Any]] = json.loads(_core.effects())
    return {
        entry["id"]: EffectInfo(
            entry["id"],
            entry["joints"],
            {name: (option["type"], option["help"]) for name, option in entry["options"].items()},
            entry["summary"],
            entry["bound"],
            entry["role"],
            entry["exported"],
            entry["needs_drive"],
        )
        for entry in entries
    }
