"""A verdict in words, the same in the terminal, in a notebook and in the report."""

from __future__ import annotations

from typing import Any

_WORDS = {
    "nothing_missing": "Nothing is missing: what is left is noise.",
    "missing_effect": "An effect is missing.",
    "unexplained_structure": "What is left has structure that no effect of the catalogue explains.",
}


def verdict_words(diagnosis: dict[str, Any]) -> str:
    """The verdict of a diagnosis as a sentence. Without a noise floor nobody can say that what is left is noise."""
    verdict = str(diagnosis["verdict"])
    if verdict == "nothing_missing" and diagnosis.get("noise_floor_um") is None:
        return "Nothing to add was found; whether what is left is noise is not known."
    return _WORDS.get(verdict, verdict)
