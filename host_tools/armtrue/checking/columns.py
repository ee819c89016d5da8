"""What the reader of the columns did and left out."""

from __future__ import annotations

from armtrue.checking.report import Finding
from armtrue.io.dataset import Dataset


def find(data: Dataset) -> list[Finding]:
    """One note for each note of the reader."""
    return [Finding("reader", "note", note) for note in data.notes]
