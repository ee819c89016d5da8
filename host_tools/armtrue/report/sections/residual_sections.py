"""The residuals: vectors over the arm, dependence on the state, spectra, and unexplained structure."""

from __future__ import annotations

import json
from typing import Any

from armtrue.report.content import Report, View
from armtrue.report.gathered.spectrum import Spectrum
from armtrue.report.gathered.structure import Finding
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import figure, folded, grid, lead, section, table, typeset
from armtrue.report.pictures import arm, charts
from armtrue.units import plural

_VECTORS = (
    "Each arrow starts where the reflector was measured and points from the predicted to the measured position, much "
    "enlarged. Larger errors have thicker arrows; one that ends in two bars is longer than there is room for. "
)
_TURNING = (
    "Drag to turn, with Shift to move, with Ctrl to select, scroll or pinch to zoom. With the keyboard: arrow keys "
    "turn, + and − zoom, 0 starts again."
)
_SPOKEN = "Residual vectors over the arm. Arrow keys turn, plus and minus zoom, N reads the next worst pose."
_STATE = (
    "What is left over at the last step, against every variable of the state. The line joins bin means, upright bars "
    "are two standard errors of a mean, the band holds 5 to 95 % of the readings. A line that is flat within its bars "
    "means: nothing left here."
)
_TELLING = (
    " Each is read along the direction that shows most: an axis of the measuring frame, or as an error of one joint's "
    "angle."
)
_SPECTRA = (
    "Share of the squared residual that one sine of each period would explain, as an error of that joint's position. "
    "A tall line is a part that turns so many times while the joint turns once, or slides a metre: a gear, a bearing, "
    "an encoder, a screw. Lines below the dotted level are what scatter makes."
)
_UNEXPLAINED = (
    "Smooth dependence on a variable that no effect of the catalogue explains, with the shape the data give it. It is "
    "not squeezed into an effect that it is not. The first panel has the most evidence; others may be the same thing "
    "seen elsewhere. What depends on two variables together has one line for each value or third of the second."
)
_BUTTONS = (
    ("corner", "Corner", "seen from above a corner (4)"),
    ("top", "Top", "seen from above (1)"),
    ("front", "Front", "seen along x (2)"),
    ("side", "Side", "seen along y (3)"),
    ("longer", "Longer", "longer arrows (])"),
    ("shorter", "Shorter", "shorter arrows ([)"),
    ("worst", "Next worst", "read the next worst pose (N)"),
    ("again", "Start again", "as it was at first (0)"),
)
_SHOWN = 12
# The views along x, y and z have many panels, so each gets fewer dots.
_DOTS_OF_OTHERS = 220
_VIEWS = (("telling", "most telling"), ("x", "along x"), ("y", "along y"), ("z", "along z"))


def vectors_section(report: Report) -> Markup:
    """Residual vectors over the arm, drawn by viewer.js."""
    scene = arm.scene(report.steps)
    drawn, total = len(scene["rows"]), scene["total"]
    some = f"{drawn} of {total} poses are drawn, the worst among them. "
    words = lead(
        _VECTORS, "Every pose is drawn. " if drawn == total else some, tag("span", _TURNING, class_="screen")
    )
    names = [(str(k), title) for k, title in enumerate(scene["names"])]
    chooser = _chooser("vectors-step", "error of", names, len(names) - 1) if len(names) > 1 else None
    buttons = [tag("button", text, type="button", data_do=do, title=title) for do, text, title in _BUTTONS]
    view = tag("div", buttons, class_="buttons", role="group", aria_label="view")
    controls = tag("div", chooser, view, class_="controls only-script")
    return section("vectors", "Where the error points", words, controls, viewer(scene, _SPOKEN))


def viewer(scene: dict[str, Any], spoken: str) -> Markup:
    """The element in which viewer.js draws `scene`, the three-dimensional picture that `arm.scene` describes.

    `spoken`: its name for screen readers.
    """
    stage = tag(
        "div", class_="stage", tabindex="0", role="application", aria_roledescription="three-dimensional picture",
        aria_label=spoken,
    )  # fmt: skip
    without = tag("p", "This one picture needs JavaScript; everything else on the page does without.")
    data = Markup(json.dumps(scene, separators=(",", ":")).replace("<", "\\u003c"))
    return tag(
        "div",
        stage,
        tag("div", class_="stills", aria_hidden="true"),
        tag("p", class_="readout", aria_live="polite"),
        tag("noscript", without),
        tag("script", data, type="application/json"),
        class_="viewer",
    )


def state_section(report: Report) -> Markup:
    """The residual against every state variable, the strongest dependence first."""
    telling = report.telling_views()
    by_name = {direction.name: direction for direction in report.directions}
    sets: list[Content] = []
    for key, _ in _VIEWS:
        views, dots, on_paper = telling, charts.DOTS, True
        if key != "telling":
            views = [report.view(view.variable, by_name[key]) for view in telling]
            dots, on_paper = _DOTS_OF_OTHERS, False
        figures = [_state_figure(report, view, dots) for view in views]
        more = None
        if rest := figures[_SHOWN:]:
            words = f"{plural(len(rest), 'more variable')} that show less"
            listing = _listed_views(telling[_SHOWN:]) if on_paper else None
            more = folded(words, tag("div", grid(rest), class_="screen"), listing)
        shown = [grid(figures[:_SHOWN]), more]
        sets.append(tag("div", shown, class_="view", data_view=key, hidden=key != "telling"))
    dashed = " The dashed line is the first step's mean, where that has a trend."
    before = dashed if len(report.steps) > 1 else ""
    not_read = [
        f" None is read as an error of joint {number}, whose axis runs {1e3 * lever:.1f} mm beside the reflector: its "
        "angle hardly moves it."
        for number, lever in report.tiny_levers.items()
    ]
    return section(
        "state",
        "What the error depends on",
        lead(_STATE, before, _TELLING, not_read),
        tag("div", _chooser("state-view", "read", list(_VIEWS), 0), class_="controls only-script"),
        tag("div", sets, class_="views"),
    )


def _listed_views(views: list[View]) -> Markup:
    """A list that stands in place of charts on paper."""
    trend = [view for view in views if view.last.trend or (view.first and view.first.trend)]
    none = [view.variable.what for view in views if view not in trend]
    rows: list[list[Content]] = [
        [view.variable.what, view.direction.what, charts.trend_words(view)] for view in trend
    ]
    listing = table(["variable", "read as", "what is left"], rows, "Without a chart", words=(0, 1, 2))
    return tag(
        "div",
        tag("div", listing, class_="listed") if rows else None,
        tag("p", f"No trend over {', '.join(none)}.") if none else None,
        class_="paper",
    )


def _state_figure(report: Report, view: View, dots: int) -> Markup:
    panel = charts.state_panel(report, view, dots)
    title = [tag("code", view.variable.name), f" {view.variable.what}"]
    mark = tag("span", "– cannot tell")
    if view.last.trend:
        mark = tag("span", "▲ trend left", class_="trend")
    elif view.last.tells:
        mark = tag("span", "○ nothing left", class_="calm")
    return figure(title, panel, mark, f" · {view.direction.what}. {charts.trend_words(view)}")


def spectra_section(report: Report) -> Markup:
    """Spectra of the residual over each joint's angle, first and last step."""
    last = report.diagnoses[-1]
    first = {s.joint: s for s in report.diagnoses[0].spectra} if len(report.diagnoses) > 1 else {}
    figures: list[Content] = []
    for spectrum in last.spectra:
        before = first.get(spectrum.joint)
        caption = f"Last step: {_lines(spectrum)}."
        if before is not None and before.peaks:
            caption += f" First step: {_lines(before)}."
        joint = report.last.fit.robot.joints[spectrum.joint - 1]
        title = f"Joint {spectrum.joint}" + (f" · {joint['name']}" if joint.get("name") else "")
        figures.append(figure(title, charts.spectrum_panel(spectrum, before), caption))
    dashed = " Dashed: first step, whose scatter may reach beyond the last step's level." if first else ""
    content = [lead(_SPECTRA, dashed), grid(figures)]
    if not figures:
        content = [lead("No joint moves far enough in these data for a spectrum.")]
    return section("spectra", "Periods of the joints", content)


def _lines(spectrum: Spectrum) -> str:
    peaks = [f"{p.called}, {p.amplitude}, {100 * p.explained:.1f} %" for p in spectrum.peaks]
    return "; ".join(peaks) or "no line stands out"


def unexplained_section(report: Report) -> Markup | None:
    """Charts of structure that no effect explains; None where no step has any."""
    parts: list[Content] = []
    before: list[Finding] = []
    for diagnosis in report.diagnoses:
        found = diagnosis.findings
        if not found:
            continue
        parts.append(tag("h3", f"After {diagnosis.step.called}"))
        same = [finding.entry for finding in found] == [finding.entry for finding in before]
        parts.append(tag("p", "The same.") if same else grid(map(_finding, found)))
        before = found
    if not parts:
        return None
    return section("unexplained", "Structure that no effect explains", lead(_UNEXPLAINED), parts)


def _finding(finding: Finding) -> Markup:
    entry = finding.entry
    joints = ", ".join(map(str, entry["joints"]))
    whose = f" joint{'s' if len(entry['joints']) > 1 else ''} {joints}" if joints else ""
    title = [tag("code", entry["variable"].replace("*", " × ")), finding.where or whose]
    about = typeset(f"{entry['shape']} (log10 p {entry['log10_p']:.1f})")
    if not finding.drawn:
        return figure(title, None, about, level=4)
    if not finding.parts:
        return figure(title, charts.structure_panel(finding), f"{about}. The function as fitted.", level=4)
    keys = [tag("span", charts.key(k), f"{part.label}") for k, part in enumerate(finding.parts)]
    legend = tag("span", f"{finding.by}: ", keys, class_="keys")
    how = f". Means of what is left over{', positions alone,' if finding.turned else ''} with two standard errors. "
    return figure(title, charts.structure_panel(finding), about, how, legend, level=4)


def _chooser(group: str, legend: str, choices: list[tuple[str, str]], chosen: int) -> Markup:
    labels = []
    for k, (value, text) in enumerate(choices):
        field = tag("input", type="radio", name=group, value=value, checked=k == chosen)
        labels.append(tag("label", field, tag("span", text)))
    return tag("fieldset", tag("legend", legend), labels, class_="segments")
