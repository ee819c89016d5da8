"""The card of a candidate: what the effect does, how large it may be, the evidence, and its rivals."""

from __future__ import annotations

from typing import Any

from armtrue import sketching
from armtrue.candidates import label as called
from armtrue.candidates import model_entry
from armtrue.candidates import name as named
from armtrue.fitting import Fit
from armtrue.io.catalogue import EffectInfo, catalogue
from armtrue.report.content import added_variable
from armtrue.report.markup import Content, Markup, join, tag
from armtrue.report.parts import folded, listed, micrometres, typeset
from armtrue.report.pictures import charts
from armtrue.report.pictures.effect_picture import effect_sweep
from armtrue.report.sections.diagnosis_sections import values_list
from armtrue.report.sections.effect_card import bound_lines, formula_block, picture_of
from armtrue.verdicts import chance, why_words
from armtrue.workbench.actions import candidates_of
from armtrue.workbench.session import Session
from armtrue.workbench.showing import elements

_NEIGHBOURS = 3


def card(session: Session, place: str) -> str:
    """The card of the candidate at `place` of the diagnosis. Errors: InputError where there is none."""
    candidates, number = _chosen(session, place)
    candidate, fit = candidates[number], session.fit_of(session.at)
    info = catalogue()[candidate["effect"]]
    return elements.card(
        named(candidate),
        tag("p", info.summary),
        _picture_and_formula(fit, candidate, info),
        bound_lines(info),
        tag("p", tag("b", "Evidence: "), typeset(why_words(candidate)), "."),
        values_list(candidate),
        tag("div", "The evidence is being drawn…", class_="later", data_later=f"evidence?candidate={number}"),
        tag("h3", "Why not its neighbour?"),
        _neighbours(candidate, candidates),
        tag("h3", "Which poses would decide?"),
        _deciding(candidate, candidates, number),
        first=elements.button("Add to the model", "add", entry=model_entry(candidate)),
    )


def evidence(session: Session, place: str) -> str:
    """The added-variable plot of a candidate, for which it is fitted. Errors: InputError where there is none."""
    candidates, number = _chosen(session, place)
    candidate = candidates[number]
    plot = added_variable(session.fit_of(session.at), candidate)
    if plot is None:
        return tag("p", "The evidence is not drawn: a fit of this size would take too long here.")
    after = candidate["held_out_mean_um_if_added"]
    would = f" Added, the held-out mean would be about {micrometres(after)} µm." if after is not None else ""
    words = charts.added_words(plot)
    return tag(
        "figure",
        tag("h3", "Added-variable plot"),
        charts.added_variable_panel(plot),
        tag("figcaption", f"{words[0].upper()}{words[1:]}.{would}"),
    )


def _chosen(session: Session, place: str) -> tuple[list[dict[str, Any]], int]:
    candidates = candidates_of(session)
    return candidates, elements.number_of(place, len(candidates), "candidate")


def _picture_and_formula(fit: Fit, candidate: dict[str, Any], info: EffectInfo) -> Content:
    sweep = effect_sweep(fit, candidate)
    lines = sketching.sketch(info)
    course = folded("Its course on a sample arm, as text", tag("pre", "\n".join(lines))) if lines else None
    picture, words = picture_of(fit, candidate, info, sweep)
    still = elements.button("Hold still", "hold", aria_pressed="false") if picture else None
    figure = tag("figure", picture, tag("figcaption", words, " ", still))
    return [figure, tag("h3", "Formula"), formula_block(info, sweep), course]


def _neighbours(candidate: dict[str, Any], candidates: list[dict[str, Any]]) -> Markup:
    """Other explanations of the evidence: the confounded candidates, then others on the same joints."""
    alike = _alike(candidate, candidates)
    others = [other for other in candidates if other is not candidate and other not in alike]
    near = [other for other in others if set(other["joints"]) & set(candidate["joints"])]
    shown = [*alike, *near[: max(0, _NEIGHBOURS - len(alike))]]
    if not shown:
        return tag("p", "No other effect that was tried acts on the same joints.")

    def strength(each: dict[str, Any]) -> str:
        return f"probability {chance(each['probability'])}, explains {100.0 * each['explained']:.1f} %"

    lines: list[Content] = []
    for other in shown:
        hardly = "; these data hardly tell the two apart" if other in alike else ""
        lines.append([tag("b", named(other)), f": {strength(other)}{hardly}; {typeset(why_words(other))}."])
    return join(tag("p", f"{named(candidate)}: {strength(candidate)}."), listed(lines))


def _alike(candidate: dict[str, Any], candidates: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Candidates that are confounded with this one."""
    return [other for other in candidates if called(other) in candidate["confounded_with"]]


def _deciding(candidate: dict[str, Any], candidates: list[dict[str, Any]], number: int) -> Markup:
    rivals = [candidates.index(other) for other in _alike(candidate, candidates)]
    rivals = rivals or [k for k in range(len(candidates)) if k != number][:1]
    if not rivals:
        return tag("p", "There is nothing to tell it from.")
    names = "; ".join(named(candidates[k]) for k in rivals)
    return tag(
        "p",
        f"Poses that tell it from {names} best are planned and drawn under What next. ",
        elements.button("Plan these poses", "plan", rivals=[number, *rivals]),
    )
