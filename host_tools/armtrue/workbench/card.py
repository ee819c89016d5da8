"""The card of a candidate: what the effect is, its bound, the evidence, and what it could be instead."""

from __future__ import annotations

from typing import Any

from armtrue.errors import InputError
from armtrue.io.catalogue import catalogue
from armtrue.report import charts
from armtrue.report.content import added_variable
from armtrue.report.diagnosis_sections import values_list
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import micrometres, typeset
from armtrue.workbench.actions import candidates_of
from armtrue.workbench.names import called, called_among
from armtrue.workbench.session import Session


def card(session: Session, place: str) -> str:
    """The card of the candidate at `place` of the diagnosis. Errors: InputError where there is none."""
    candidates = candidates_of(session)
    if not place.isdigit() or int(place) >= len(candidates):
        raise InputError(f"candidate: found '{place}', expected a number from 0 to {len(candidates) - 1}")
    candidate = candidates[int(place)]
    info = catalogue()[candidate["effect"]]
    name = called_among(candidate, candidates)
    return tag(
        "article",
        tag("h2", name, id="card-title"),
        tag("p", info.summary),
        tag("p", tag("b", "Physical bound: "), info.bound or "none is known"),
        tag("p", tag("b", "Evidence: "), typeset(candidate["why"]), "."),
        values_list(candidate),
        _others(candidate),
        _plot(session, candidate),
        tag("button", "Close", type="button", data_act="close"),
    )


def _others(candidate: dict[str, Any]) -> Markup:
    others = candidate["confounded_with"]
    if not others:
        return tag("p", "Nothing else explains nearly as much as ", called(candidate), ".")
    return tag("p", tag("b", "Could also be: "), ", ".join(others))


def _plot(session: Session, candidate: dict[str, Any]) -> Content:
    plot = added_variable(session.fit_of(session.at), candidate)
    if plot is None:
        return tag("p", "The evidence is not drawn: a fit of this size would take too long here.")
    after = candidate["held_out_mean_um_if_added"]
    would = f" Added, the held-out mean would be about {micrometres(after)} µm." if after is not None else ""
    caption = f"{charts.added_words(plot)}.{would}"
    return tag(
        "figure",
        tag("h3", "Added-variable plot"),
        charts.added_variable_panel(plot),
        tag("figcaption", caption),
    )
