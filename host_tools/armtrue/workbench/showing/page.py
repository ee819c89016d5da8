"""The page itself, which stays while its pieces change."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

from armtrue.report.markup import Content, Markup, html_page, tag
from armtrue.workbench.showing.elements import button

_BUTTONS = (
    ("undo", "Undo", "Control+Z"),
    ("redo", "Redo", "Control+Y"),
    ("refine", "Refine", None),
    ("export", "Export", None),
    ("report", "Report", None),
    ("cancel", "Cancel", "Escape"),
)
_FILES = (("commands", "As commands"), ("notebook", "As a notebook"), ("model", "model.yaml"))
_PANELS = (
    ("state", "What the error depends on"),
    ("spectra", "Periods of the joints"),
    ("unexplained", "Structure that no effect explains"),
    ("parameters", "Parameters"),
    ("unobservable", "What the data cannot tell"),
    ("coverage", "Where was measured"),
    ("certainty", "How well each place is known"),
    ("rejected", "Gross errors"),
)


def page() -> str:
    """The whole page without its figures, which the script asks for."""
    body = tag(
        "body",
        tag("a", "Skip to the candidates", href="#candidates-part", class_="skip"),
        _top(),
        tag("main", _left_column(), _right_column(), _panels(), _opening()),
        tag("dialog", tag("div", id="card"), id="card-dialog", aria_label="Effect"),
        Markup('<script src="script.js"></script>'),
        id="workbench",
    )
    style = Markup('<link rel="stylesheet" href="style.css"><link rel="icon" href="data:,">')
    return html_page("Armtrue workbench", style, body)


def script() -> str:
    """The page's script: the report's picture in space, then the workbench's own."""
    of_the_report = [_text("armtrue.report", name) for name in ("geometry.js", "viewer.js")]
    own = [_text("armtrue.workbench.showing", name) for name in ("looking.js", "workbench.js")]
    return "".join([*of_the_report, *own])


def style() -> str:
    """The report's style, then the workbench's own."""
    return _text("armtrue.report", "style.css") + _text("armtrue.workbench.showing", "workbench.css")


def _top() -> Markup:
    buttons = [
        button(text, action, id=f"button-{action}", aria_keyshortcuts=keys) for action, text, keys in _BUTTONS
    ]
    return tag(
        "header",
        tag("div", _slot("title"), class_="titles"),
        tag("div", buttons, class_="buttons", role="group", aria_label="Actions"),
        tag("p", role="status", id="status", aria_live="polite"),
        tag("p", role="alert", id="failure", hidden=True),
        _running(
            "running", "progress", "stage", "Progress", button("Pause", "pause", id="pause", hidden=True)
        ),
    )


def _left_column() -> Markup:
    error = tag(
        "section",
        tag("h2", "Error", id="error-title"),
        _slot("error"),
        tag("h3", "Steps"),
        _slot("waterfall"),
        aria_labelledby="error-title",
        role="region",
    )
    scene = tag(
        "details",
        tag("summary", "The arm among its points"),
        tag("div", class_="panel-slot"),
        tag("p", button("Mark as wrong", "mark", id="mark", hidden=True)),
        class_="looking scene-part",
        data_panel="vectors",
        open=True,
    )
    return tag("div", error, scene, class_="column needs-session")


def _right_column() -> Markup:
    missing = tag(
        "section",
        tag("h2", "What is missing"),
        _slot("verdict"),
        _running("diagnosing", "diagnosing-share", "diagnosing-stage", "Progress of the diagnosis"),
        _slot("candidates"),
        _slot("advice"),
        id="candidates-part",
    )
    model = tag("section", tag("h2", "Model"), _slot("model"), _slot("left-out"), _slot("leave-out"))
    history = tag("section", tag("h2", "History"), _slot("history"))
    files = [button(text, "export", name=name) for name, text in _FILES]
    further = tag(
        "section",
        tag("h2", "What next"),
        tag("label", "poses ", tag("input", type="number", id="poses", min="1", max="200", value="12")),
        button("Plan poses", "plan"),
        _slot("result"),
        tag("h3", "The session"),
        tag("div", files, class_="buttons"),
    )
    return tag(
        "div",
        missing,
        tag("div", model, history, further, class_="pair"),
        _slot("device"),
        class_="column needs-session",
    )


def _panels() -> Markup:
    folded: list[Content] = [
        tag(
            "details",
            tag("summary", title),
            tag("div", class_="panel-slot"),
            class_="looking",
            data_panel=name,
        )
        for name, title in _PANELS
    ]
    return tag("div", folded, class_="column whole needs-session")


def _opening() -> Markup:
    kinds = ".csv,.txt,.tsv,.dat,.xlsx,.json,.yaml,.yml,.urdf"
    words = "Measurements, arm, model or fits: drop them here, or choose "
    files = tag("input", type="file", id="files", multiple=True, accept=kinds)
    chooser = tag("label", words, files, class_="drop")
    return tag(
        "div",
        tag("section", tag("h2", "Open files"), chooser, _slot("opening"), _slot("notes"), id="opening"),
        class_="column whole",
    )


def _running(name: str, share: str, stage: str, label: str, *more: Content) -> Markup:
    """A progress bar with text; `name`, `share`, `stage`: ids of element, bar and text. The script unhides it."""
    bar = tag("progress", id=share, max="1", value="0", aria_label=label)
    return tag("div", bar, tag("span", id=stage), *more, class_="running", id=name, hidden=True)


def _slot(name: str) -> Markup:
    return tag("div", data_piece=name)


def _text(package: str, name: str) -> str:
    return files(package).joinpath(name).read_text(encoding="utf-8")


def as_json(value: Any) -> bytes:
    """JSON without NaN, which browsers do not read."""
    return json.dumps(value, allow_nan=False).encode()
