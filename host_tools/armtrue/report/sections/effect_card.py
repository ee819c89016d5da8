"""Cards that explain effects: what each does to the arm, its formula and its physical bound."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from armtrue import sketching
from armtrue.candidates import name as called
from armtrue.fitting import Fit
from armtrue.io.catalogue import EffectInfo, catalogue
from armtrue.report.content import Report
from armtrue.report.gathered.steps import effects_of
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import lead, section, typeset
from armtrue.report.pictures.effect_picture import Sweep, effect_picture, effect_sweep
from armtrue.verdicts import why_words

Candidate = dict[str, Any]

_LEAD = (
    "Each effect that was added, and what the last step still recommends: what it does to the arm, its formula, how "
    "large it can physically be, and what spoke for it before it was added."
)
_MOST_CARDS = 8


def cards_section(report: Report) -> Markup | None:
    """A card for each effect added after the first step or recommended by the last; None where there is none."""
    cards = [_card(fit, candidate) for fit, candidate in _chosen(report)[:_MOST_CARDS]]
    if not cards:
        return None
    return section("effects", "The effects, explained", lead(_LEAD), tag("div", cards, class_="grid cards"))


def _chosen(report: Report) -> list[tuple[Fit, Candidate]]:
    """Candidates of each step that the next step added, and the first that the last step recommends."""
    diagnosed = {id(diagnosis.step): diagnosis for diagnosis in report.diagnoses}
    found: list[tuple[Fit, Candidate]] = []
    for before, after in pairwise(report.steps):
        new = [effect for effect in effects_of(after.fit) if effect not in effects_of(before.fit)]
        tried = diagnosed.get(id(before))
        candidates = tried.result["candidates"] if tried else []
        found += [(before.fit, candidate) for candidate in _among(candidates, new)]
    last = report.diagnoses[-1]
    open_still = [candidate for candidate in last.result["candidates"] if candidate["recommend"]]
    return found + [(last.step.fit, candidate) for candidate in open_still[:1]]


def _among(candidates: list[Candidate], new: list[tuple[str, tuple[int, ...]]]) -> list[Candidate]:
    chosen: list[Candidate] = []
    for effect in dict.fromkeys(effect for effect, _ in new):
        on = {joint for other, joints in new if other == effect for joint in joints}
        same = [c for c in candidates if c["effect"] == effect]
        # Parameters of an effect on all joints name one joint or none, so that its candidate need not match them.
        exact = [c for c in same if c["joints"] and set(c["joints"]) <= on]
        chosen += exact or same[:1]
    return chosen


def _card(fit: Fit, candidate: Candidate) -> Markup:
    info = catalogue()[candidate["effect"]]
    sweep = effect_sweep(fit, candidate)
    picture, words = picture_of(fit, candidate, info, sweep)
    return tag(
        "figure",
        tag("h3", called(candidate)),
        picture,
        tag("figcaption", words),
        tag("p", info.summary),
        formula_block(info, sweep),
        bound_lines(info),
        tag("p", tag("b", "Evidence: "), typeset(why_words(candidate)), "."),
    )


def picture_of(
    fit: Fit, candidate: Candidate, info: EffectInfo, sweep: Sweep | None
) -> tuple[Markup | None, str]:
    """The picture of an effect and its caption; without a picture, the caption says why there is none."""
    if not info.exported:
        return None, "No picture: this effect is of the measurement and does not move the arm."
    return effect_picture(fit, candidate, sweep) if sweep else (None, "No picture: this arm cannot have it.")


def formula_block(info: EffectInfo, sweep: Sweep | None) -> Markup:
    """The formula on the joints of `sweep`, or in general."""
    lines = sketching.formula_lines(sweep.document) if sweep else sketching.formulas(info)
    return tag("pre", "\n".join(lines), class_="formula")


def bound_lines(info: EffectInfo) -> Content:
    """How large the effect can physically be, and the source of that bound."""
    bound, source = info.bound_and_source
    return [
        tag("p", tag("b", "Physical bound: "), bound or "none is known"),
        tag("p", tag("b", "Source of the bound: "), source),
    ]
