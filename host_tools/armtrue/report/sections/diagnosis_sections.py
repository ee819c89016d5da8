"""What is missing: candidates with their evidence, the ambiguity set, advice, and effects that cannot be tested."""

from __future__ import annotations

from typing import Any

from armtrue.candidates import entry_of, parameter_lines
from armtrue.candidates import name as called
from armtrue.report.content import Report, StepDiagnosis
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import (
    figure,
    fixed,
    folded,
    grid,
    lead,
    listed,
    micrometres,
    minus,
    rounded,
    section,
    table,
    typeset,
)
from armtrue.report.pictures import charts
from armtrue.verdicts import (
    OTHER_SENSOR_ADVICE,
    chance,
    needs_words,
    of_other_sensors,
    verdict_words,
    why_words,
)

_CANDIDATES = (
    "Every effect of the catalogue is tried on every joint that the recorded columns allow: the residual is regressed "
    "on it with all that is fitted already projected out. Its probability is found beside all others; a fall of BIC "
    "by 10 is strong. Separable is the share of a candidate that is not in the model already."
)
_ADDED = (
    "Added-variable plots: across, what the candidate at its best size would add to each reading beyond what the model "
    "can already take over; up, what is left over of that reading. Points along the line are explained; a cloud that "
    "ignores it is not. Here every candidate was put in and fitted, so that tables chose their smoothness and periods "
    "their place; the score in the table above is one linear step, with repeats of a pose counted for what they add."
)
_TURNED = (
    " Positions (round) and orientations (square, coloured) are read in standard deviations of their noise (σ), as the "
    "fit weighs them."
)
_NOT_DRAWN = "Not drawn, for a fit would take too long here or the model has the effect on these joints: "
_SHOWN = 8
_SHOWN_BETWEEN = 3
_WITH_REASONS = 4
_WITH_REASONS_BETWEEN = 1
_PARAMETERS_SHOWN = 6


def candidates_section(report: Report) -> Markup:
    """Candidates of every step, with evidence and ambiguity; fewer of intermediate steps. Advice of the last step."""
    *before, last = report.diagnoses
    parts: list[Content] = []
    if before:
        first, *inner = before
        parts += [_after(first), *_one(first)]
        between = [tag("div", _after(diagnosis), _one(diagnosis, between=True)) for diagnosis in inner]
        parts += [tag("div", between, class_="steps-between"), _after(last)]
    parts += [*_one(last), *_advice(last.result)]
    return section("candidates", "What is missing", lead(_CANDIDATES), parts)


def _after(diagnosis: StepDiagnosis) -> Markup:
    return tag("h3", f"After {diagnosis.step.called}")


def added_variable_section(report: Report) -> Markup | None:
    """Added-variable plots of the leading candidates; None where no step has candidates."""
    figures: list[Content] = []
    not_drawn: list[Content] = []
    many = len(report.diagnoses) > 1
    for diagnosis in report.diagnoses:
        after = f", after step {diagnosis.step.number}" if many else ""
        for plot in diagnosis.added_variables:
            mark = [_star(), " · "] if plot.candidate["recommend"] else None
            panel = charts.added_variable_panel(plot)
            figures.append(figure(plot.name + after, panel, mark, charts.added_words(plot)))
        if diagnosis.not_drawn:
            names = f"{'; '.join(diagnosis.not_drawn)}{after}."
            not_drawn.append(tag("p", _NOT_DRAWN, names, class_="lead"))
    if not figures and not not_drawn:
        return None
    plots = [plot for diagnosis in report.diagnoses for plot in diagnosis.added_variables]
    words = lead(_ADDED, _TURNED if any(plot.turned.any() for plot in plots) else None)
    return section("added", "What the leading candidates would do", words, grid(figures), not_drawn)


def _star() -> Markup:
    return tag("span", "★ recommended", class_="trend")


def _one(diagnosis: StepDiagnosis, between: bool = False) -> list[Content]:
    """The verdict and the leading candidates with reasons; fewer, and no list of the others, if `between`."""
    most, with_reasons = (_SHOWN_BETWEEN, _WITH_REASONS_BETWEEN) if between else (_SHOWN, _WITH_REASONS)
    result = diagnosis.result
    parts: list[Content] = [tag("p", verdict_words(result), class_=f"verdict {result['verdict']}")]
    candidates = result["candidates"]
    shown, rest = candidates[:most], candidates[most:]
    if result["verdict"] == "nothing_missing":
        if candidates:
            heading = "The strongest of what was tried, none of them significant"
            parts.append(folded(heading, _table(shown, "Candidates")))
    else:
        parts += [_ambiguity(candidates), _table(shown, "Leading candidates"), _reasons(shown[:with_reasons])]
    if rest and not between:
        names = "; ".join(map(called, rest))
        parts.append(tag("p", f"Tried as well, with less evidence: {names}.", class_="lead"))
    return parts


def _advice(result: dict[str, Any]) -> list[Content]:
    """What to do next, and effects that cannot be tested because a column is missing."""
    parts: list[Content] = []
    if result["advice"]:
        parts += [tag("h4", "Advice"), listed([typeset(sentence) for sentence in result["advice"]])]
    if result["untestable"]:
        needs = [[entry["effect"], needs_words(entry["needs"])] for entry in result["untestable"]]
        caption = "Not testable with what was recorded"
        parts.append(tag("div", table(["effect", "record"], needs, caption, words=(0, 1)), class_="listings"))
    return parts


def _ambiguity(candidates: list[dict[str, Any]]) -> Markup | None:
    best = next((candidate for candidate in candidates if candidate["recommend"]), None)
    if best is None:
        return None
    others = [called(other) for other in of_other_sensors(best, candidates)]
    warmed = f" {OTHER_SENSOR_ADVICE}" if others else ""
    others += [called(entry_of(label)) for label in best["confounded_with"]]
    if not others:
        return tag("p", "Nothing else explains nearly as much as ", tag("strong", called(best)), ".")
    return tag(
        "p",
        "Ambiguity set, whatever explains at least 0.9 of what the best does: ",
        tag("strong", called(best)),
        f"; {'; '.join(others)}. The advice below says what would tell them apart.{warmed}",
        class_="ambiguous",
    )


def _table(shown: list[dict[str, Any]], caption: str) -> Markup:
    headers = ["candidate", "probability", "explains", "ΔBIC", "held-out mean if added [µm]", "separable"]
    rows: list[list[Content]] = []
    for candidate in shown:
        share = 100.0 * candidate["explained"]
        bar = tag("span", class_="bar", style=f"width:{min(100.0, max(0.0, share)):.1f}%")
        track = tag("span", bar, class_="bar-track")
        rows.append([
            [called(candidate), [" ", _star()] if candidate["recommend"] else None],
            chance(candidate["probability"]),
            tag("span", track, tag("span", f"{share:.1f} %"), class_="share"),
            fixed(candidate["delta_bic"], 0),
            "≈ " + micrometres(candidate["held_out_mean_um_if_added"]),
            f"{100.0 * candidate['separability']:.1f} %",
        ])  # fmt: skip
    note = " (≈: predicted by the linearised model)"
    return table(headers, rows, caption + note, stacked=True)


def _reasons(shown: list[dict[str, Any]]) -> Markup:
    entries: list[Content] = []
    for candidate in shown:
        why = typeset(why_words(candidate))
        entries.append(tag("li", tag("strong", called(candidate)), f": {why}.", values_list(candidate)))
    return folded("Why, and how large", tag("ol", entries, class_="evidence"), opened=True)


def values_list(candidate: dict[str, Any]) -> Markup:
    """A candidate's coefficients with their sigmas, in units for people."""
    lines = [minus(rounded(line)) for line in parameter_lines(candidate["parameters"])]
    values = [tag("li", line) for line in lines[:_PARAMETERS_SHOWN]]
    if len(lines) > _PARAMETERS_SHOWN:
        values.append(tag("li", f"and {len(lines) - _PARAMETERS_SHOWN} more"))
    return tag("ul", values, class_="values")
