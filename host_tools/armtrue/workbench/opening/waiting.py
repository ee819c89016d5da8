"""Files that were dropped while nothing was open: a server started without files goes on with them."""

from __future__ import annotations

import json
from pathlib import Path

from armtrue.errors import InputError
from armtrue.io.files import read_text, write_file
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.session import default_folder


def keep_waiting(drop: Drop) -> None:
    """Write down which files wait; nothing where none do. Errors: InputError or OSError where it cannot be written."""
    place = _place()
    if drop.names:
        place.parent.mkdir(parents=True, exist_ok=True)
        write_file(place, json.dumps(drop.as_json()) + "\n")
    else:
        place.unlink(missing_ok=True)


def go_on_waiting(drop: Drop) -> bool:
    """Take up the files that were written down; False where there are none that can be read again."""
    place = _place()
    if not place.is_file():
        return False
    try:
        drop.go_on(json.loads(read_text(place)))
    except (InputError, ValueError, KeyError, TypeError, AttributeError):
        drop.forget()
    return bool(drop.names)


def folder_of_waiting() -> Path:
    """The folder in which one server at a time writes down the files that wait."""
    return default_folder("waiting")


def _place() -> Path:
    return folder_of_waiting() / "files.json"
