"""The report's sections for the shown model, beside the first model of the session."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from armtrue.errors import InputError
from armtrue.report.content import Report, shown_again
from armtrue.report.markup import Markup, tag
from armtrue.report.sections.data_sections import coverage_section, rejected_section
from armtrue.report.sections.model_sections import observability_section, parameters_section
from armtrue.report.sections.residual_sections import unexplained_section, vectors_section
from armtrue.workbench.session import Session
from armtrue.workbench.showing.certainty import certainty_section
from armtrue.workbench.showing.looking import all_variables, looking_section, peaks_section, ranked

_SECTIONS: dict[str, Callable[[Report], Markup | None]] = {
    "vectors": vectors_section,
    "spectra": peaks_section,
    "unexplained": unexplained_section,
    "parameters": parameters_section,
    "unobservable": observability_section,
    "coverage": coverage_section,
    "rejected": rejected_section,
}
# Sections of the diagnosis; all others show the fit alone.
_OF_THE_DIAGNOSIS = {"spectra", "unexplained"}


def panel(session: Session, words: dict[str, str]) -> str:
    """One part of the page as HTML: the section `name` of `words`. Errors: InputError for an unknown name."""
    name = words.get("name", "")
    if name == "state":
        report = _report(session, diagnosed=False)
        report = replace(report, variables=all_variables(report.last.fit))
        return looking_section(report, session.worked_out(session.at, "ranks", lambda: ranked(report)), words)
    if name == "certainty":
        fit = session.fit_of(session.at)
        return str(session.worked_out(session.at, "certainty", lambda: certainty_section(fit)))
    if name not in _SECTIONS:
        known = ", ".join(("state", "certainty", *_SECTIONS))
        raise InputError(f"panel: found '{name}', expected one of {known}")
    diagnosed = name in _OF_THE_DIAGNOSIS
    if diagnosed and not session.is_diagnosed(session.at):
        return tag("p", "The diagnosis of this model is not worked out yet.")
    none = "This model has nothing to show here."
    if name == "unexplained":
        none = "The diagnosis found no dependence on a recorded variable that the candidates do not explain."
    return _SECTIONS[name](_report(session, diagnosed)) or tag("p", none)


def _report(session: Session, diagnosed: bool) -> Report:
    """The first model of the path beside the shown one, if both were fitted to the same rows."""
    first, last = session.path[0], session.node
    shown = [last] if first is last or first.left_out != last.left_out else [first, last]
    if diagnosed:
        shown = [node for node in shown if session.is_diagnosed(node.number)]
    fits = [session.fit_of(node.number) for node in shown]
    diagnoses = [session.diagnosis_of(node.number) for node in shown] if diagnosed else []
    return shown_again(fits, [node.name or node.change for node in shown], list(filter(None, diagnoses)))
