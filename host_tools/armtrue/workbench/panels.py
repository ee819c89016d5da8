"""The report's sections for the model that is looked at, beside the first model of the session."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from armtrue.diagnosis import diagnose
from armtrue.errors import InputError
from armtrue.report.content import Report, shown_again
from armtrue.report.data_sections import coverage_section, rejected_section
from armtrue.report.markup import Markup, tag
from armtrue.report.model_sections import observability_section, parameters_section
from armtrue.report.residual_sections import (
    spectra_section,
    state_section,
    unexplained_section,
    vectors_section,
)
from armtrue.workbench.session import Session

_SECTIONS: dict[str, Callable[[Report], Markup | None]] = {
    "vectors": vectors_section,
    "state": state_section,
    "spectra": spectra_section,
    "unexplained": unexplained_section,
    "parameters": parameters_section,
    "unobservable": observability_section,
    "coverage": coverage_section,
    "rejected": rejected_section,
}


def panel(session: Session, name: str) -> str:
    """One section of the report as HTML. Errors: InputError for a name that is none."""
    if name not in _SECTIONS:
        raise InputError(f"panel: found '{name}', expected one of {', '.join(_SECTIONS)}")
    return _SECTIONS[name](_report(session)) or tag("p", "Nothing.")


def _report(session: Session) -> Report:
    """The first model of the path beside the one that is looked at, where both saw the same rows."""
    path = session.path
    last = path[-1]
    shown = [node for node in path[:1] if node.number != last.number and node.left_out == last.left_out] + [
        last
    ]
    fits = [session.fit_of(node.number) for node in shown]
    diagnoses = [_with_spectra(session, node.number) for node in shown]
    return shown_again(fits, [node.name or node.change for node in shown], diagnoses)


def _with_spectra(session: Session, number: int) -> dict[str, Any]:
    diagnosis = session.diagnosis_of(number)
    if "spectra" not in diagnosis:  # made on the way of Refine
        diagnosis["spectra"] = diagnose(session.fit_of(number))["spectra"]
    return diagnosis
