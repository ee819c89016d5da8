"""HTML and SVG as text: elements whose content is escaped unless it is markup already."""

from __future__ import annotations

import html
from collections.abc import Iterable


class Markup(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


Content = str | Iterable["Content"] | None

_VOID = {"br", "circle", "hr", "input", "line", "meta", "path", "polygon", "rect"}


def tag(name: str, /, *content: Content, **attributes: object) -> Markup:
    """An element.

    Names of attributes lose a trailing `_`, and `_` inside becomes `-`. None and False omit an attribute; True writes
    it without a value.
    """
    written = "".join(_attribute(key, value) for key, value in attributes.items())
    if name in _VOID and not content:
        return Markup(
            f"<{name}{written}>" if name in {"br", "hr", "input", "meta"} else f"<{name}{written}/>"
        )
    return Markup(f"<{name}{written}>{join(*content)}</{name}>")


def join(*content: Content) -> Markup:
    """Pieces one after the other; None is nothing."""
    return Markup("".join(_text(piece) for piece in content))


def _text(piece: Content) -> str:
    if piece is None:
        return ""
    if isinstance(piece, Markup):
        return piece
    if isinstance(piece, str):
        return html.escape(piece, quote=False)
    return "".join(_text(inner) for inner in piece)


def _attribute(key: str, value: object) -> str:
    name = key.rstrip("_").replace("_", "-")
    if value is None or value is False:
        return ""
    return f" {name}" if value is True else f' {name}="{html.escape(str(value))}"'
