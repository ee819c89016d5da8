"""Names of effects on the workbench: as `diagnose` gives them, `gear_mesh 3 orders [13]`."""

from __future__ import annotations

import json
from typing import Any

from armtrue.candidates import form_words, options_of
from armtrue.report.parts import rounded

_TOLD = ("orders", "cycles", "wavelengths")


def called(entry: dict[str, Any]) -> str:
    """An effect or a candidate as `diagnose` names it: with its joints, and its orders, cycles or wavelengths."""
    words = [str(entry["effect"])]
    if joints := entry.get("joints"):
        words.append(",".join(map(str, joints)))
    options = options_of(entry)
    words += [
        f"{key} {json.dumps([_short(value) for value in options[key]])}" for key in _TOLD if options.get(key)
    ]
    return " ".join(words)


def named(entry: dict[str, Any]) -> str:
    """`called` with short figures, and the options of its variant: `bending_compliance 1 shape beam`."""
    return called_among(entry, [])


def called_among(entry: dict[str, Any], others: list[dict[str, Any]]) -> str:
    """`named`, with the thermometer where `others` read several."""
    return " ".join([rounded(called(entry)), *form_words(entry, others)])


def change_words(added: list[dict[str, Any]], removed: list[dict[str, Any]]) -> str:
    """`added gear_harmonics 3, removed backlash 2`."""
    return ", ".join(
        [f"added {named(entry)}" for entry in added] + [f"removed {named(entry)}" for entry in removed]
    )


def _short(value: float) -> float:
    """Whole numbers without a point."""
    return int(value) if value == int(value) else value
