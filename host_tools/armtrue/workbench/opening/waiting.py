"""Files that were dropped while nothing was open: a server started without files restores them."""

from __future__ import annotations

import json
from pathlib import Path

from armtrue.errors import InputError
from armtrue.io.files import read_text, write_file
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.session import default_folder


def keep_waiting(drop: Drop) -> None:
    """Save the list of waiting files, or delete it if empty. Errors: InputError or OSError where that is impossible."""
    place = _place()
    if drop.names:
        place.parent.mkdir(parents=True, exist_ok=True)
        write_file(place, json.dumps(drop.as_json()) + "\n")
    else:
        place.unlink(missing_ok=True)


def go_on_waiting(drop: Drop) -> bool:
    """Restore the files of the saved list; False where there are none that can be read."""
    place = _place()
    if not place.is_file():
        return False
    try:
        drop.go_on(json.loads(read_text(place)))
    except (InputError, ValueError, KeyError, TypeError, AttributeError):
        drop.forget()
    return bool(drop.names)


def folder_of_waiting() -> Path:
    """The folder of the list of waiting files, for one server at a time."""
    return default_folder("waiting")


def _place() -> Path:
    return folder_of_waiting() / "files.json"
