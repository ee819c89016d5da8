"""Elements that several pieces of the page share, and the check of an index in a request."""

from __future__ import annotations

import json

from armtrue.errors import InputError
from armtrue.report.markup import Content, Markup, tag

_OWN = ("class_", "id", "hidden")


def button(text: str, action: str, **words: object) -> Markup:
    """A button that asks for `action`.

    `aria_…`, `class_`, `id` and `hidden` are its attributes; all other words go with the action, lists and mappings as
    JSON.
    """
    attributes: dict[str, object] = {}
    for key, value in words.items():
        if key in _OWN or key.startswith("aria_"):
            attributes[key] = value
        else:
            attributes[f"data_{key}"] = json.dumps(value) if isinstance(value, list | dict) else value
    return tag("button", text, type="button", data_act=action, **attributes)


def card(title: str, *content: Content, first: Content = None) -> Markup:
    """A dialog in front of the page, until it is closed; `first` stands before its Close button."""
    last = tag("p", first, " " if first else None, button("Close", "close"))
    return tag("article", tag("h2", title, id="card-title"), *content, last)


def number_of(place: str, count: int, what: str) -> int:
    """The number, 0 to `count` - 1, that the page names as `place`. Errors: InputError for any other."""
    if not place.isdecimal() or int(place) >= count:
        raise InputError(f"{what}: found '{place}', expected a number from 0 to {count - 1}")
    return int(place)
