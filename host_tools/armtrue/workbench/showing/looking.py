"""The residual against any variable: one chart at a time; poses selected on it are marked on the arm."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armtrue.fitting import Fit
from armtrue.io.catalogue import catalogue
from armtrue.io.columns import POSITION
from armtrue.report.content import Report
from armtrue.report.gathered.spectrum import Peak, Spectrum
from armtrue.report.gathered.state import Direction, Variable, variables
from armtrue.report.gathered.thinning import spread_rows
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import figure, grid
from armtrue.report.pictures import charts
from armtrue.report.pictures.arm import scene_rows
from armtrue.workbench.showing.elements import button

# Number of poses by which the variables are ranked.
_RANKED_POSES = 1500
_DIGITS = 6
_TURN = 360.0
# Waves this near to one or two cycles per turn of the joint are eccentricity, all others gear mesh.
_NEAR = 0.3
_ECCENTRIC = (1.0, 2.0)
_ABOUT = (
    "What is left over, against one variable. The line joins bin means, upright bars are two standard errors of a "
    "mean, the band holds 5 to 95 % of the readings. Point at a dot to read it. Drag over the chart to select poses: "
    "they are ringed on the arm above."
)


@dataclass(frozen=True)
class Rank:
    """The direction along which a variable explains most of the scatter, and that share."""

    variable: str
    direction: str
    explained: float


def all_variables(fit: Fit) -> list[Variable]:
    """State variables, each motor's angle within its turn, and every other recorded column of numbers."""
    found = variables(fit)
    columns = fit.data.columns
    for number, joint in enumerate(fit.robot.joints, start=1):
        ratio = joint.get("gear_ratio")
        if ratio and joint.get("type") != "prismatic":
            angle = np.mod(np.degrees(columns[f"q{number}"]) * ratio, _TURN)
            found.append(Variable(f"motor angle {number}", f"motor angle {number}", "°", angle, number))
    known = {variable.name for variable in found}
    for name in sorted(columns):
        standard = name in POSITION or name in known or name[:1] == "q"
        if not standard and name not in ("target", "repeat") and np.ptp(columns[name]) > 0.0:
            found.append(Variable(name, name, "", columns[name]))
    return found


def ranked(report: Report) -> list[Rank]:
    """Each variable with the direction along which it explains most, from some of the poses; the strongest first."""
    last = report.last
    some = np.zeros(last.used.size, dtype=np.bool_)
    some[spread_rows(last.used.size, _RANKED_POSES)] = True
    rough = replace(report, steps=[replace(last, used=last.used & some)])
    return [
        Rank(view.variable.name, view.direction.name, max(0.0, view.last.explained))
        for view in rough.telling_views()
    ]


def looking_section(report: Report, ranks: list[Rank], words: dict[str, str]) -> Markup:
    """The chart of the variable and direction in `words`, or else of the strongest, with lists to choose others."""
    known = {variable.name: variable for variable in report.variables}
    ways = {direction.name: direction for direction in report.directions}
    rank = next((rank for rank in ranks if rank.variable == words.get("variable")), ranks[0])
    variable = known[rank.variable]
    direction = ways.get(words.get("direction", ""), ways[rank.direction])
    view = report.view(variable, direction)
    panel = charts.state_panel(report, view)
    caption = tag("figcaption", f"{direction.what}. {charts.trend_words(view)}")
    return tag(
        "section",
        tag("p", _ABOUT, class_="lead"),
        _choosers(report, ranks, rank, direction),
        tag("figure", panel, caption, class_="look-figure"),
        tag("p", class_="readout", aria_live="polite"),
        _selector(),
        tag("script", _dots(report, variable, direction), type="application/json"),
        id="looking",
    )


def _choosers(report: Report, ranks: list[Rank], chosen: Rank, direction: Direction) -> Markup:
    known = {variable.name: variable for variable in report.variables}
    labels = [f"{known[rank.variable].label}: {100.0 * rank.explained:.0f} %" for rank in ranks]
    choices = [
        tag("option", label, value=rank.variable, selected=rank is chosen)
        for label, rank in zip(labels, ranks, strict=True)
    ]
    ways = [
        tag("option", f"{each.what} [{each.unit}]", value=each.name, selected=each.name == direction.name)
        for each in report.directions
    ]
    return tag(
        "p",
        tag("label", "against ", tag("select", choices, id="look-variable", data_look="variable")),
        tag("label", " read as ", tag("select", ways, id="look-direction", data_look="direction")),
        class_="controls",
    )


def _selector() -> Markup:
    """Selection of poses by keyboard instead of the brush, and what can be done with the selected poses."""
    return tag(
        "p",
        tag("label", "Poses from ", tag("input", type="number", step="any", id="brush-low")),
        tag("label", " to ", tag("input", type="number", step="any", id="brush-high")),
        tag("button", "Select", type="button", data_look="select"),
        button("Leave these out", "leave_out_brushed", hidden=True),
        tag("span", class_="selected", role="log"),
        class_="brush",
    )


def _dots(report: Report, variable: Variable, direction: Direction) -> Markup:
    """JSON of the rows that the arm's picture also shows: the variable, the reading, and the size of the error [µm]."""
    last = report.last
    rows = scene_rows(last)
    rows = rows[last.used[rows]]
    readings = direction.read(last.residual_m)
    size = 1e6 * np.linalg.norm(last.residual_m, axis=1)
    document = {
        "variable": variable.name,
        "what": variable.what,
        "unit": variable.unit,
        "reading": direction.what,
        "reading_unit": direction.unit,
        "row": last.fit.data.rows[rows].tolist(),
        "x": [float(f"{value:.{_DIGITS}g}") for value in variable.values[rows]],
        "y": [float(f"{value:.{_DIGITS}g}") for value in readings[rows]],
        "size": np.round(size[rows], 1).tolist(),
        "poses": int(last.used.sum()),
    }
    return Markup(json.dumps(document, separators=(",", ":")).replace("<", "\\u003c"))


def peaks_section(report: Report) -> Markup:
    """Spectra of the joints; what stands out can be added as an effect."""
    diagnosis, before = report.diagnoses[-1], report.diagnoses[0]
    first = {s.joint: s for s in before.spectra} if len(report.diagnoses) > 1 else {}
    figures = [
        figure(f"Joint {s.joint}", charts.spectrum_panel(s, first.get(s.joint)), _peaks(s))
        for s in diagnosis.spectra
    ]
    lead = (
        "Share of the squared residual that one sine of each period would explain, as an error of that joint's angle. "
        "Press what stands out, here or in the chart, to add it to the model and see the error change."
    )
    dashed = f" Dashed: {report.first.called}." if first else ""
    return tag("section", tag("p", lead, dashed, class_="lead"), grid(figures))


def _peaks(spectrum: Spectrum) -> Content:
    if not spectrum.peaks:
        return "No line stands out."
    buttons = []
    for peak in spectrum.peaks:
        entry = _as_effect(spectrum, peak)
        words = f"{peak.called}, {peak.amplitude}, {100.0 * peak.explained:.1f} %"
        named = f"Add {entry['effect']} {spectrum.joint}: {words}"
        buttons.append(button(named, "add", entry=entry, x=f"{peak.cycles:.6g}"))
    return buttons


def _as_effect(spectrum: Spectrum, peak: Peak) -> dict[str, Any]:
    """The effect for a wave of this period: one of few orders, or one of any number of cycles."""
    joints = [spectrum.joint]
    waves = [info for info in catalogue().values() if info.joints == "each" and "orders" in info.options]
    few, any_number = sorted(waves, key=lambda info: "cycles" in info.options)[:2]
    if spectrum.slides:
        length = float(f"{1.0 / peak.cycles:.4g}")
        return {"effect": any_number.id, "joints": joints, "wavelengths": [length]}
    if any(abs(peak.cycles - cycles) < _NEAR for cycles in _ECCENTRIC):
        return {"effect": few.id, "joints": joints}
    return {"effect": any_number.id, "joints": joints, "cycles": [round(peak.cycles, 2)]}
