"""Sections of the report for a notebook: the charts of the page itself.

    from armtrue.report import figures, gather

    report = gather([fit, best])
    figures.waterfall(report)
    figures.vectors(report)

Every function returns a `Picture`.
"""

from __future__ import annotations

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
        return tag(
            "iframe",
            title=self.title,
            srcdoc=self.html,
            onload=_FIT_THE_HEIGHT,
            style=f"width:100%;height:{_HEIGHT}px;border:0",
        )

    def save(self, path: str | Path) -> None:
        """Write the page. Errors: InputError where that cannot be done."""
        write_file(Path(path), self.html)


def waterfall(report: Report) -> Picture:
    """Held-out and training errors at each step, and the noise floor."""
    return Picture("How the error fell", error_section(report))


def vectors(report: Report) -> Picture:
    """Residual vectors over the arm, of the first and the last step."""
    return Picture("Where the error points", vectors_section(report))


def state(report: Report) -> Picture:
    """The residual against every state variable, the strongest dependence first."""
    return Picture("What the error depends on", state_section(report))


def spectra(report: Report) -> Picture:
    """Share of the squared residual that each period of each joint explains."""
    return Picture("Periods of the joints", spectra_section(report))


def candidates(report: Report) -> Picture:
    """Candidates of every step with their evidence."""
    return Picture("What is missing", candidates_section(report))


def added_variables(report: Report) -> Picture:
    """Added-variable plots of the leading candidates."""
    return Picture("What the leading candidates would do", added_variable_section(report))


def unexplained(report: Report) -> Picture:
    """Smooth dependence that no effect of the catalogue explains."""
    return Picture("Structure that no effect explains", unexplained_section(report))


def parameters(report: Report) -> Picture:
    """Parameters of the last step with their standard deviations."""
    return Picture("The model that was fitted", parameters_section(report))


def coverage(report: Report) -> Picture:
    """Where the arm was measured."""
    return Picture("Where the arm was measured", coverage_section(report))
