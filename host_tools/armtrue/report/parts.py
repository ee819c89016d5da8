"""Building blocks of the page that several sections share."""

from __future__ import annotations

import math
import re
from collections.abc import Container, Sequence

from armtrue.report.markup import Content, Markup, tag
from armtrue.verdicts import NOT_SCORED, with_signs

ARCSECOND = math.pi / 648000.0  # in radians
_NUMBER = "num"


def section(key: str, title: str, *content: Content) -> Markup:
    """A part of the page under a heading that links can point at."""
    return tag(
        "section", tag("h2", title, id=f"{key}-title"), *content, id=key, aria_labelledby=f"{key}-title"
    )


def lead(*content: Content) -> Markup:
    """The sentences below a heading that say how to read what follows."""
    return tag("p", *content, class_="lead")


def table(
    headers: Sequence[str],
    rows: Sequence[Sequence[Content]],
    caption: str,
    words: Container[int] = (0,),
    *,
    stacked: bool = False,
) -> Markup:
    """A table that scrolls sideways where it must. The columns `words` contain text, the others figures.

    `stacked`: on a phone every row has its name on a separate line, and its figures below without scrolling.
    """

    def kind(column: int) -> str | None:
        return None if column in words else _NUMBER

    head = tag("tr", [tag("th", text, scope="col", class_=kind(k)) for k, text in enumerate(headers)])
    body = []
    for row in rows:
        cells = [tag("th", row[0], scope="row")]
        cells += [tag("td", cell, class_=kind(k)) for k, cell in enumerate(row[1:], start=1)]
        body.append(tag("tr", cells))
    title = tag("caption", tag("span", caption))
    whole = tag("table", title, tag("thead", head), tag("tbody", body), class_="stacked" if stacked else None)
    return tag("div", whole, class_="scroll", tabindex="0", role="region", aria_label=caption)


def figure(title: Content, picture: Markup | None, *caption: Content, level: int = 3) -> Markup:
    """A picture with its title, a heading of `level`, above and words below."""
    below = tag("figcaption", *caption) if caption else None
    return tag("figure", tag(f"h{level}", title), picture, below)


def grid(*figures: Content) -> Markup:
    """Small figures side by side, as many as fit."""
    return tag("div", *figures, class_="grid")


def listed(items: Sequence[Content]) -> Markup:
    """A plain list."""
    return tag("ul", [tag("li", item) for item in items])


def folded(summary: Content, *content: Content, opened: bool = False) -> Markup:
    """Content that is folded away on a screen; on paper it stands in full."""
    return tag("details", tag("summary", summary), *content, open=opened)


def micrometres(value: float | None) -> str:
    """A length in µm with as many digits as it carries; a dash for None."""
    if value is None:
        return "–"
    if abs(value) >= 1000.0:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.{2 if abs(value) < 10.0 else 1}f}"


def scored_um(value: float | None) -> str:
    """A held-out error with its unit, or that no pose could be scored."""
    return NOT_SCORED if value is None else f"{micrometres(value)} µm"


def fixed(value: float, decimals: int) -> str:
    """A figure with so many decimals and a real minus sign; what rounds to zero has none."""
    return minus(f"{round(value, decimals) + 0.0:.{decimals}f}")


def minus(text: str) -> str:
    """Figures with a real minus sign."""
    return text.replace("-", "−")


def typeset(sentence: str) -> str:
    """A sentence of the diagnosis, which is plain ASCII, with its signs, units and figures as they are printed."""
    plain = with_signs(sentence).replace(" arcsec", "″")
    return rounded(re.sub(r"(?<=[\s(])-(?=\d)", "−", plain))


def rounded(text: str) -> str:
    """Figures in `text` with more than three decimals, as of a period that was searched for, to two."""
    return re.sub(r"\d+\.\d{4,}", lambda found: f"{float(found[0]):.2f}", text)
