"""The contents of the page as named pieces of HTML; the browser replaces those that changed."""

from __future__ import annotations

import logging
from typing import Any

import yaml

from armtrue.candidates import entry_of
from armtrue.candidates import name as named
from armtrue.checking import warnings_of_fit
from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.io.catalogue import catalogue
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import ARCSECOND, folded, listed, micrometres, typeset
from armtrue.units import plural
from armtrue.verdicts import (
    ERROR_FIGURES,
    FLOOR_MOVES,
    FLOOR_SOURCES,
    NOT_SCORED,
    chance,
    needs_words,
    scored_mean_um,
    verdict_words,
    why_words,
)
from armtrue.workbench.compensator import device_section
from armtrue.workbench.engine import Engine
from armtrue.workbench.first_figures import FirstFigures
from armtrue.workbench.opening.dropped import Drop, Guess
from armtrue.workbench.opening.guesses import findings_list, first_rows, form
from armtrue.workbench.session import Node, Session
from armtrue.workbench.showing.elements import button
from armtrue.workbench.showing.further import leave_out_form
from armtrue.workbench.showing.left_out import left_out_part, left_out_row
from armtrue.workbench.showing.words import length

_SPLITS = {"random": "at random", "region": "by region", "time": "by time"}
# Number of rivals named beside a candidate; its card has all.
_NAMED_RIVALS = 2
# Number of sentences of advice that are not folded away.
_SHOWN_ADVICE = 2
# Sentences of the advice that are not shown: buttons and a separate list of the page replace them.
_SAID_ELSEWHERE = ("armtrue add FIT", "not testable with")


def pieces(engine: Engine) -> dict[str, str]:
    """The parts of the page that an action changes."""
    always: dict[str, str] = {
        "title": tag("div", tag("h1", engine.title), tag("p", engine.about, class_="about")),
        "opening": _opening(engine),
        "notes": listed(engine.notes),
    }
    if not engine.is_open:
        return always
    session, first = engine.session, engine.first_figures
    # A model with first figures has no diagnosis yet: that starts after the fit to all measurements.
    diagnosis = None if first else session.diagnosis_of(session.at)
    path = [*session.path, *([first.node] if first else [])]
    fit = first.fit if first else session.fit_of(session.at)
    # Of the fit about itself, and about the robot.yaml that was opened.
    warnings = fit.document["warnings"] + warnings_of_fit(fit.document["measuring_from_base"], engine.robot)
    return {
        **always,
        "notes": listed([*engine.notes, *dict.fromkeys(warnings)]),
        "error": _error(path, fit, first),
        "waterfall": _waterfall(path, first),
        "model": _model(path[-1]),
        "candidates": _candidates(diagnosis),
        "verdict": _verdict(diagnosis) if diagnosis else _no_verdict(engine),
        "advice": _advice(diagnosis) if diagnosis else "",
        "history": tag("div", _history(session), _sessions(engine)),
        "left-out": left_out_part(session.node, len(session.fit_of(session.at).document["rejected"])),
        "leave-out": leave_out_form(session.fit_of(session.at)),
        "device": device_section(engine.device) or "",
        "result": engine.result.shown if engine.result else "",
    }


def buttons(engine: Engine) -> dict[str, bool]:
    """Which of the buttons can be pressed."""
    free = engine.task is None and engine.is_open
    return {
        "undo": free and engine.session.node.parent is not None,
        "redo": free and engine.session.node.redo is not None,
        **dict.fromkeys(("refine", "export", "report"), free),
        "cancel": engine.task is not None or (engine.is_open and engine.background.task is not None),
    }


_HOW_TO_OPEN = (
    "A CSV in Armtrue's own form wants its robot.yaml beside it; foreign files want a robot.yaml or a URDF. What "
    "units, columns and angles they have is then guessed, shown and checked before anything is fitted."
)


def _opening(engine: Engine) -> Markup:
    """Files that were dropped, and what was guessed of them."""
    drop = engine.drop
    if not drop.names:
        return tag("p", _HOW_TO_OPEN)
    shown = _guesses(drop, drop.guess) if drop.guess else [button("Open", "open")]
    if engine.is_open:
        source = "form" if drop.guess else None
        shown += [" ", button("Compare with the model", "compare", source=source)]
    return tag("div", listed(drop.names), shown, " ", button("Put aside", "forget", class_="quiet"))


def _guesses(drop: Drop, guess: Guess) -> list[Content]:
    """The guesses on foreign files. Whatever the files contain, the page is drawn and they can be put aside."""
    try:
        document = yaml.safe_load(guess.text)
        first = form(document, *first_rows(guess.path, document), guess.robot)
    except InputError as error:
        first = tag("p", f"The first rows cannot be shown: {drop.without_place(str(error))}.")
    except Exception:
        logging.getLogger(__name__).exception("the first rows cannot be drawn")
        first = tag("p", "The first rows cannot be shown.")
    return [
        tag("h3", "What was guessed, and from what"),
        listed(guess.notes),
        first,
        guess.picture,
        tag("h3", "What the check says"),
        findings_list(guess.findings),
        folded(
            "As dataset.yaml",
            tag("label", "change what the form does not have", for_="dataset"),
            tag("textarea", guess.text, id="dataset", rows="16", spellcheck="false"),
            button("Open with this text", "open", source="text"),
        ),
        button("Open with these", "open", source="form"),
    ]


def _error(path: list[Node], fit: Fit, first: FirstFigures | None) -> Markup:
    node = path[-1]
    floor = node.noise_floor_um
    source = str(fit.document["noise_floor"]["source"])
    words = FLOOR_SOURCES.get(source, source)
    held_out = {"random": node.error["held_out"], **(node.error.get("held_out_by") or {})}
    named = {f"held out {_SPLITS.get(split, split)}": figures for split, figures in held_out.items()}
    named["training"] = node.error["train"]
    rows: list[Content] = [_error_row(name, figures) for name, figures in named.items() if figures]
    rows.append(left_out_row(node, list(ERROR_FIGURES)))
    heads = [tag("th", name, scope="col") for name in ("", *ERROR_FIGURES.values())]
    known = "not known" if floor is None else f"{micrometres(floor)} µm"
    of_floor = [tag("b", known, class_="figure"), f" noise floor ({words})"]
    of_some = f" ({first.words})" if first else None
    of_model = [tag("b", length(node.mean_um), class_="figure"), " held-out mean error", of_some]
    return tag(
        "div",
        tag("div", tag("p", of_model), tag("p", of_floor), class_="two-figures"),
        _bar(node.mean_um, floor, _largest(path)),
        tag(
            "table",
            tag("caption", "Error of the model [µm]"),
            tag("thead", tag("tr", heads)),
            tag("tbody", rows),
            class_="figures",
        ),
        _turns(node),
        tag("p", FLOOR_MOVES, class_="about") if source == "repeats" else None,
    )


def _turns(node: Node) -> Markup | None:
    """The error of orientation; None where orientations were not measured."""
    if node.turn_error_rad is None:
        return None
    names = zip(("mean", "rms", "p95", "max"), ERROR_FIGURES.values(), strict=True)
    figures = [f"{name} {node.turn_error_rad[key] / ARCSECOND:.1f}″" for key, name in names]
    return tag("p", f"Error of orientation, training poses: {', '.join(figures)}", class_="about")


def _error_row(name: str, figures: dict[str, float]) -> Markup:
    cells = [tag("td", NOT_SCORED, colspan=len(ERROR_FIGURES))]
    if scored_mean_um(figures) is not None:
        cells = [tag("td", micrometres(figures[key])) for key in ERROR_FIGURES]
    return tag("tr", tag("th", name, scope="row"), cells)


def _largest(path: list[Node]) -> float:
    """The largest error on the path to this model: the length of a full bar."""
    return max((step.mean_um for step in path if step.mean_um is not None), default=0.0)


def _bar(mean: float | None, floor: float | None, whole: float) -> Markup:
    share = 100.0 * (mean or 0.0) / (whole or 1.0)
    mark = tag("i", style=f"left:{min(100.0, 100.0 * floor / (whole or 1.0)):.2f}%") if floor else None
    return tag("div", tag("span", style=f"width:{share:.2f}%"), mark, class_="error-bar", aria_hidden="true")


def _waterfall(path: list[Node], first: FirstFigures | None) -> Markup:
    whole = _largest(path)
    steps = []
    for node in path:
        name = tag("span", node.name or node.change, class_="step")
        figure = tag("span", length(node.mean_um), class_="num")
        kind = "first-figures" if first and node is first.node else None
        steps.append(tag("li", name, _bar(node.mean_um, node.noise_floor_um, whole), figure, class_=kind))
    return tag("ol", steps, class_="waterfall-steps", aria_label="Steps")


def _model(node: Node) -> Markup:
    entries = []
    for k, effect in enumerate(node.effects):
        info = catalogue().get(effect["effect"])
        name = tag("span", named(effect), id=f"model-{k}", title=info.summary if info else None)
        swap = button("Swap", "swaps", effect=k, aria_describedby=f"model-{k}", class_="quiet")
        remove = button("Remove", "remove", effect=k, aria_describedby=f"model-{k}")
        entries.append(tag("li", name, tag("span", swap, remove)))
    return tag("ul", entries, aria_label="Model", role="list", class_="model")


def _candidates(diagnosis: dict[str, Any] | None) -> Markup:
    candidates = diagnosis["candidates"] if diagnosis else []
    heads = ("candidate", "probability", "explains", "error if added", "could also be", "")
    rows = [_candidate(k, candidate) for k, candidate in enumerate(candidates)]
    none = "No effect of the catalogue is left to try." if diagnosis else "None is known yet."
    table = tag(
        "table",
        tag("caption", "Candidates", None if rows else f": {none}"),
        tag("thead", tag("tr", [tag("th", head, scope="col") if head else tag("td") for head in heads])),
        tag("tbody", rows),
        aria_label="Candidates",
        class_="candidates",
    )
    return tag("div", table, class_="in-sight")


def _candidate(k: int, candidate: dict[str, Any]) -> Markup:
    share, after = 100.0 * candidate["explained"], candidate["held_out_mean_um_if_added"]
    rivals = [named(entry_of(rival)) for rival in candidate["confounded_with"]]
    more = f" and {len(rivals) - _NAMED_RIVALS} more" if len(rivals) > _NAMED_RIVALS else ""
    others = "; ".join(rivals[:_NAMED_RIVALS]) + more
    star = tag("span", " ★", class_="trend", title="recommended") if candidate["recommend"] else None
    name = named(candidate)
    error = "–" if after is None else f"≈ {micrometres(after)} µm"
    bar = tag("span", tag("span", style=f"width:{min(100.0, max(0.0, share)):.1f}%"), class_="share-bar")
    return tag(
        "tr",
        tag("th", tag("span", name, id=f"candidate-{k}"), star, scope="row"),
        tag("td", chance(candidate["probability"]), class_="num", data_label="probability"),
        tag("td", bar, tag("span", f"{share:.1f} %"), class_="num", data_label="explains"),
        tag("td", error, class_="num", data_label="error if added"),
        tag(
            "td",
            others or "–",
            data_label="could also be",
            class_=None if others else "nothing",
            title="; ".join(rivals) if more else None,
        ),
        tag(
            "td",
            button("Add", "add", candidate=k, aria_describedby=f"candidate-{k}"),
            button("Why?", "card", candidate=k, aria_describedby=f"candidate-{k}", class_="quiet"),
            class_="actions",
        ),
        class_="recommended" if candidate["recommend"] else None,
        title=typeset(why_words(candidate)),
    )


def _verdict(diagnosis: dict[str, Any]) -> Markup:
    return tag(
        "div",
        tag("p", verdict_words(diagnosis), class_=f"verdict {diagnosis['verdict']}"),
        tag("p", f"Probability that nothing is missing: {chance(diagnosis['probability_nothing'])}"),
    )


def _no_verdict(engine: Engine) -> Markup:
    """The text in place of a verdict that is not known yet."""
    if engine.first_figures is not None:
        return tag("p", "What is missing is worked out when all measurements are fitted.", class_="verdict")
    if engine.background.task is not None:
        return tag("p", "What is missing is being worked out.", class_="verdict")
    again = button("Work out what is missing", "diagnose")
    why = engine.background.failure or "The diagnosis was stopped."
    return tag("p", why, " ", again, class_="verdict")


def _advice(diagnosis: dict[str, Any]) -> Markup:
    unexplained = dict.fromkeys(
        f"What is left depends on {entry['variable']}: {entry['shape']}" for entry in diagnosis["unexplained"]
    )
    untestable = [
        f"{entry['effect']} needs {needs_words(entry['needs'])}" for entry in diagnosis["untestable"]
    ]
    words = f"{plural(len(untestable), 'effect')} not testable with what was recorded"
    here = [line for line in diagnosis["advice"] if not any(word in line for word in _SAID_ELSEWHERE)]
    advice = [typeset(line).replace("armtrue plan", "Plan poses") for line in here]
    rest = advice[_SHOWN_ADVICE:]
    return tag(
        "div",
        listed([typeset(line) for line in unexplained]) if unexplained else None,
        listed(advice[:_SHOWN_ADVICE]) if advice else None,
        folded(f"{len(rest)} more like this", listed(rest)) if rest else None,
        folded(words, listed(untestable)) if untestable else None,
    )


def _history(session: Session) -> Markup:
    def branch(node: Node) -> Markup:
        here = node.number == session.at
        name = node.name or node.change
        go = button(name, "go", node=node.number, aria_current="step" if here else None)
        spoken = f"{name} side by side with the model shown"
        beside = button("Side by side", "beside", node=node.number, class_="quiet", aria_label=spoken)
        figure = tag("span", f" {length(node.mean_um)}", class_="num")
        children = [branch(child) for child in session.children(node.number)]
        return tag("li", go, figure, None if here else beside, tag("ul", children) if children else None)

    field = tag("input", id="model-name", maxlength="80", value=session.node.name)
    name = tag(
        "p", tag("label", "This model is called ", field), " ", button("Name", "name", node=session.at)
    )
    return tag("div", tag("ul", branch(session.nodes[0]), class_="tree", aria_label="History"), name)


def _sessions(engine: Engine) -> Markup | None:
    """Links to the sessions before and after measurements joined, so that none is lost."""
    if len(engine.linked) < 2:
        return None
    entries: list[Content] = []
    for k, (session, opened) in enumerate(engine.linked):
        here = session is engine.session
        words = f"{opened.data.file.name}: {opened.data.count} measurements, {plural(len(session.nodes), 'model')}"
        entries.append(button(words, "switch", session=k, aria_current="true" if here else None))
    return tag("div", tag("h3", "Before and after measurements joined"), listed(entries))
