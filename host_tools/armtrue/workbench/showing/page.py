"""The page itself, which stays while its pieces change, with its script and style."""

from __future__ import annotations

import re
from importlib.resources import files


def page() -> str:
    """The whole page without its figures, which the script asks for."""
    # The indentation would show as gaps between buttons.
    return re.sub(r"\n +", "", _text("armtrue.workbench.showing", "page.html"))


def script() -> str:
    """The page's script: the report's picture in space, then the workbench's own."""
    of_the_report = [_text("armtrue.report", name) for name in ("geometry.js", "viewer.js")]
    own = [_text("armtrue.workbench.showing", name) for name in ("looking.js", "workbench.js")]
    return "".join([*of_the_report, *own])


def style() -> str:
    """The report's style, then the workbench's own."""
    return _text("armtrue.report", "style.css") + _text("armtrue.workbench.showing", "workbench.css")


def _text(package: str, name: str) -> str:
    return files(package).joinpath(name).read_text(encoding="utf-8")
