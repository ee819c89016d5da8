"""The page: its head, its summary and its sections in order, with style and script inside it."""

from __future__ import annotations

from importlib.resources import files

from armtrue.candidates import name as called
from armtrue.report.content import Report
from armtrue.report.gathered.steps import floor_source
from armtrue.report.markup import Content, Markup, join, tag
from armtrue.report.parts import micrometres, scored_um
from armtrue.report.sections.data_sections import (
    about_section,
    coverage_section,
    made_words,
    rejected_section,
)
from armtrue.report.sections.diagnosis_sections import added_variable_section, candidates_section
from armtrue.report.sections.effect_card import cards_section
from armtrue.report.sections.error_section import error_section
from armtrue.report.sections.glossary_section import glossary_section
from armtrue.report.sections.model_sections import observability_section, parameters_section
from armtrue.report.sections.residual_sections import (
    spectra_section,
    state_section,
    unexplained_section,
    vectors_section,
)
from armtrue.verdicts import verdict_words


def page(report: Report) -> str:
    """The whole report as one HTML document that needs nothing from outside."""
    sections = [
        ("error", "Error", error_section(report)),
        ("vectors", "Vectors", vectors_section(report)),
        ("state", "State", state_section(report)),
        ("spectra", "Spectra", spectra_section(report)),
        ("candidates", "Candidates", candidates_section(report)),
        ("added", "Added variables", added_variable_section(report)),
        ("effects", "Effects", cards_section(report)),
        ("unexplained", "Unexplained", unexplained_section(report)),
        ("parameters", "Parameters", parameters_section(report)),
        ("unobservable", "Not observed", observability_section(report)),
        ("rejected", "Rejected", rejected_section(report)),
        ("coverage", "Coverage", coverage_section(report)),
        ("about", "About", about_section(report)),
    ]
    shown = [(key, short, content) for key, short, content in sections if content is not None]
    shown.append(("glossary", "Glossary", glossary_section(join(*(content for _, _, content in shown)))))
    links = [tag("li", tag("a", short, href=f"#{key}")) for key, short, _ in shown]
    robot = str(report.last.fit.robot.spec.get("name", "robot"))
    footer = [
        "Lengths in µm, angles in arcseconds (″) or degrees; joints count from 1. Words are explained in the ",
        tag("a", "glossary", href="#glossary"),
        ".",
    ]
    return document(
        f"Calibration of {robot}",
        tag("a", "Skip to the report", href="#error", class_="skip"),
        tag("header", _summary(report, robot)),
        tag("nav", tag("ul", links), aria_label="sections"),
        tag("main", [content for _, _, content in shown]),
        tag("footer", tag("p", footer)),
    )


def document(title: str, *content: Content) -> str:
    """An HTML document of parts of the report, with their style and script inside it."""
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", title),
        tag("style", _file("style.css")),
    )
    body = tag("body", *content, tag("script", _file("geometry.js"), _file("viewer.js")))
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def _summary(report: Report, robot: str) -> Content:
    last, first = report.last, report.first
    verdict = report.diagnoses[-1].result["verdict"]
    before = first.error["nominal"] if len(report.steps) == 1 else first.error["held_out"]
    held = last.error["held_out"]
    floor = last.noise_floor_um
    floor_words = "not known" if floor is None else f"{micrometres(floor)} µm"
    fell = "from the nominal arm to the fit" if len(report.steps) == 1 else "from the first step to the last"
    figures = [
        ("held-out mean", f"{micrometres(before['mean_um'])} → {scored_um(held['mean_um'])}", fell),
        ("held-out 95 %", scored_um(held["p95_um"]), f"worst {scored_um(held['max_um'])}"),
        ("noise floor", floor_words, floor_source(last)),
        ("measurements", str(last.fit.data.count), f"{len(last.fit.document['rejected'])} rejected"),
    ]
    best = next((c for c in report.diagnoses[-1].result["candidates"] if c["recommend"]), None)
    named = f" The evidence points to {called(best)}." if best is not None else ""
    added = [effect for step in report.steps[1:] for effect in step.added]
    story = f" Added since the first step: {'; '.join(added)}." if added else ""
    terms = [
        tag("div", tag("dt", name), tag("dd", tag("b", value), tag("small", note)))
        for name, value, note in figures
    ]
    return [
        tag("p", "Calibration report", class_="kicker"),
        tag("h1", robot),
        tag("p", made_words(report), class_="made"),
        tag("p", verdict_words(report.diagnoses[-1].result), named, story, class_=f"verdict {verdict}"),
        tag("dl", terms),
    ]


def _file(name: str) -> Markup:
    return Markup(files("armtrue.report").joinpath(name).read_text(encoding="utf-8"))
