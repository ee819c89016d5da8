"""Sections of the report for a notebook: the charts of the page itself.

    from armtrue.report import figures, gather

    report = gather([fit, best])
    figures.waterfall(report)
    figures.vectors(report)

Every function draws one section of the page and returns it as a `Picture`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from armtrue.io.files import write_file
from armtrue.report.content import Report
from armtrue.report.markup import Markup, tag
from armtrue.report.page import document
from armtrue.report.sections.data_sections import coverage_section
from armtrue.report.sections.diagnosis_sections import added_variable_section, candidates_section
from armtrue.report.sections.error_section import error_section
from armtrue.report.sections.model_sections import parameters_section
from armtrue.report.sections.residual_sections import (
    spectra_section,
    state_section,
    unexplained_section,
    vectors_section,
)

# Height in pixels until the section has loaded and its own height is known.
_HEIGHT = 480
_FIT_THE_HEIGHT = "this.style.height = this.contentDocument.documentElement.scrollHeight + 'px'"


class Picture:
    """A section of the report, which a notebook shows. `html`: as a page that needs nothing from outside."""

    def __init__(self, title: str, section: Markup | None) -> None:
        self.title = title
        self.html = document(title, tag("main", section or tag("p", f"{title}: nothing to show.")))

    def __repr__(self) -> str:
        return f"Picture: {self.title}"

    def _repr_html_(self) -> str:
        # An iframe keeps the section's style and script apart from the notebook's.
        style = f"width:100%;height:{_HEIGHT}px;border:0"
        return tag("iframe", title=self.title, srcdoc=self.html, onload=_FIT_THE_HEIGHT, style=style)

    def save(self, path: str | Path) -> None:
        """Write the page. Errors: InputError where that cannot be done."""
        write_file(Path(path), self.html)


def _drawn(name: str, title: str, section: Callable[[Report], Markup | None]) -> Callable[[Report], Picture]:
    def draw(report: Report) -> Picture:
        return Picture(title, section(report))

    draw.__name__ = draw.__qualname__ = name
    draw.__doc__ = section.__doc__
    return draw


waterfall = _drawn("waterfall", "How the error fell", error_section)
vectors = _drawn("vectors", "Where the error points", vectors_section)
state = _drawn("state", "What the error depends on", state_section)
spectra = _drawn("spectra", "Periods of the joints", spectra_section)
candidates = _drawn("candidates", "What is missing", candidates_section)
added_variables = _drawn("added_variables", "What the leading candidates would do", added_variable_section)
unexplained = _drawn("unexplained", "Structure that no effect explains", unexplained_section)
parameters = _drawn("parameters", "The model that was fitted", parameters_section)
coverage = _drawn("coverage", "Where the arm was measured", coverage_section)
