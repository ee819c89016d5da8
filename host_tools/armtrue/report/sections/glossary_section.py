"""The glossary at the end of the page: the technical terms that the page uses."""

from __future__ import annotations

import html
import re

from armtrue.glossary import glossary
from armtrue.report.markup import Markup, tag
from armtrue.report.parts import folded, section

_ELEMENT = re.compile(r"<(script|style)\b.*?</\1>|<[^>]*>", re.DOTALL)


def glossary_section(shown: Markup) -> Markup:
    """The entries of docs/glossary.md that `shown`, the other sections, uses."""
    words = html.unescape(_ELEMENT.sub(" ", shown)).lower()
    entries = [
        tag("li", tag("b", entry.name), f": {entry.text}")
        for entry in glossary().values()
        if any(re.search(rf"\b{re.escape(name.lower())}s?\b", words) for name in entry.names)
    ]
    return section(
        "glossary", "Glossary", folded("What the words of this page mean", tag("ul", entries, class_="terms"))
    )
