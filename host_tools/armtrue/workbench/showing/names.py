"""Names of effects on the workbench: effect and joints as `diagnose` names them, options as in the terminal."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from armtrue import candidates
from armtrue.candidates import entry_of, options_of

_TOLD = ("orders", "cycles", "wavelengths")


def called(entry: dict[str, Any]) -> str:
    """The label by which `confounded_with` names a candidate, with its joints, orders, cycles or wavelengths."""
    words = [str(entry["effect"])]
    if joints := entry.get("joints"):
        words.append(",".join(map(str, joints)))
    options = options_of(entry)
    words += [
        f"{key} {json.dumps([_short(value) for value in options[key]])}" for key in _TOLD if options.get(key)
    ]
    return " ".join(words)


def named(entry: dict[str, Any], others: Sequence[dict[str, Any]] = ()) -> str:
    """Effect and joints, and the options that distinguish it from `others`: `gear_mesh 3, 99.5 cycles a turn`."""
    effect = str(entry["effect"])
    whole = candidates.called({**entry, "joints": []}, others)
    options = whole.removeprefix(effect).lstrip(", ")
    numbers = ",".join(map(str, entry.get("joints") or []))
    return f"{effect} {numbers}".rstrip() + (f", {options}" if options else "")


def named_of(label: str) -> str:
    """`named` of a candidate that `diagnose` names by a label, such as `gear_mesh 3 orders [13]`."""
    return named(entry_of(label))


def change_words(added: list[dict[str, Any]], removed: list[dict[str, Any]]) -> str:
    """`added gear_harmonics 3; removed backlash 2`."""
    return "; ".join(
        [f"added {named(entry)}" for entry in added] + [f"removed {named(entry)}" for entry in removed]
    )


def _short(value: float) -> float:
    """Whole numbers without a point."""
    return int(value) if value == int(value) else value
