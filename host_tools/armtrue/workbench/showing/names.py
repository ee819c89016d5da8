"""Names of effects on the workbench, spelled as everywhere else."""

from __future__ import annotations

from typing import Any

from armtrue.candidates import label, name

# The name that people read, and that by which `confounded_with` of a diagnosis lists it.
named = name
called = label


def change_words(added: list[dict[str, Any]], removed: list[dict[str, Any]]) -> str:
    """`added gear_harmonics 3; removed backlash 2`."""
    return "; ".join(
        [f"added {named(entry)}" for entry in added] + [f"removed {named(entry)}" for entry in removed]
    )
