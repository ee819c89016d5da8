"""Errors that report faulty input."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(Exception):
    """The input is faulty and the user can correct it.

    The message is one sentence that names the file, the row or key, what was found and what was expected.
    The command line prints it on stderr and exits with status 2, without having written a file. Line breaks in
    quoted input become spaces, so that the message stays one line.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


class RowError(InputError):
    """One row of a file is faulty; the others can be read without it. `row`: its number as in messages."""

    def __init__(self, row: int, message: str) -> None:
        super().__init__(message)
        self.row = row


class ForeignError(InputError):
    """The file is not in the form or the units of docs/files.md; the message ends with the command that reads it."""

    def __init__(self, found: str, command: str) -> None:
        super().__init__(f"{found}; this writes the dataset.yaml that reads a foreign file: {command}")


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `" (did you mean 'x'?)"` for the nearest of `known`, or an empty string where none is near."""
    by_lower_case = {name.lower(): name for name in sorted(known)}
    near = difflib.get_close_matches(word.lower(), by_lower_case, n=1, cutoff=0.5)
    return f" (did you mean '{by_lower_case[near[0]]}'?)" if near else ""


def shorten(value: object, limit: int = 60) -> str:
    """Return `repr(value)` cut to `limit` characters, for messages that quote what was found."""
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 1] + "…"
