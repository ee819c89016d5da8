"""The fitted model: its parameters with sigmas, its tables as curves, and what the data do not determine."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armtrue.candidates import name
from armtrue.fitting import Fit
from armtrue.io.catalogue import with_role
from armtrue.notebook import nominal_words
from armtrue.report.content import Report
from armtrue.report.gathered.state import axis_of
from armtrue.report.gathered.structure import coordinate_words
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import (
    ARCSECOND,
    figure,
    fixed,
    folded,
    grid,
    lead,
    listed,
    minus,
    rounded,
    section,
    table,
)
from armtrue.report.pictures import charts
from armtrue.units import plural, value_and_sigma

_PARAMETERS = (
    "Values of the last step with one standard deviation. Where robot.yaml has a nominal value, the value is the "
    "correction that is added to it. ● is known to better than a third of itself, ○ may as well "
    "be zero. A parameter that is tied to others is known together with them rather than alone."
)
_UNOBSERVABLE = (
    "Numbers that these measurements cannot tell apart. One of each pair stays at its nominal value; predictions do "
    "not suffer."
)
# A parameter smaller than this many of its sigmas is consistent with zero.
_KNOWN = 3.0
_TIED = 0.9
# An effect with more parameters than this is folded away on a screen.
_LONG = 14


def parameters_section(report: Report) -> Markup:
    """Parameters of the last step in display units, tables as curves."""
    document = report.last.fit.document
    plain: dict[str, list[dict[str, Any]]] = {}
    tables: dict[str, list[dict[str, Any]]] = {}
    held = 0
    for parameter in document["parameters"]:
        reference = parameter["terms"][0].get("table")
        if reference is not None:
            tables.setdefault(reference["id"], []).append(parameter)
        elif parameter["held"]:
            held += 1
        elif parameter["effect"] not in with_role("placement"):
            plain.setdefault(parameter["effect"], []).append(parameter)
    listings: list[Content] = []
    for effect, parameters in plain.items():
        listing = _parameter_table(parameters, effect, document["robot"])
        heading = f"{effect}: {plural(len(parameters), 'parameter')}"
        listings.append(folded(heading, listing) if len(parameters) > _LONG else listing)
    if found := document["nonlinear"]:
        listings.append(_parameter_table(found, "Searched for: periods, time constants", document["robot"]))
    parts: list[Content] = [_poses(document), tag("div", listings, class_="listings")]
    if curves := [_curve(report.last.fit, entries) for entries in tables.values() if _axes(entries) == 1]:
        parts += [tag("h3", "Tables"), grid(curves)]
    if grids := [entries for entries in tables.values() if _axes(entries) > 1]:
        parts.append(_grids(grids))
    held_words = f" {held} more are held at nominal, see below." if held else ""
    return section("parameters", "The model that was fitted", lead(_PARAMETERS, held_words), parts)


def observability_section(report: Report) -> Markup:
    """Parameters that the data could not tell apart, in sentences."""
    document = report.last.fit.document
    sentences = document["unobservable"]
    none = tag("p", "Every parameter of the model was told apart.")
    content: list[Content] = [listed(sentences) if sentences else none]
    if document["warnings"]:
        content += [tag("h3", "Warnings of the fit"), listed(document["warnings"])]
    return section("unobservable", "What could not be observed", lead(_UNOBSERVABLE), content)


def _axes(entries: list[dict[str, Any]]) -> int:
    return len(entries[0]["terms"][0]["table"]["axes"])


def _poses(document: dict[str, Any]) -> Markup:
    poses = {"base in the measuring frame": document["measuring_from_base"]}
    for target, pose in document["flange_from_tool"].items():
        poses[f"reflector {target} in the flange" if target else "reflector in the flange"] = pose
    rows = []
    for what, pose in poses.items():
        lengths = [fixed(1000.0 * length, 3) for length in pose["xyz"]]
        angles = [fixed(math.degrees(angle), 4) for angle in pose["rpy"]]
        rows.append([what, *lengths, *angles])
    headers = ["pose", "x [mm]", "y [mm]", "z [mm]", "roll [°]", "pitch [°]", "yaw [°]"]
    return table(headers, rows, "Base and tool")


def _parameter_table(parameters: list[dict[str, Any]], caption: str, robot: dict[str, Any]) -> Markup:
    nominal = [minus(nominal_words(parameter["name"], robot)) for parameter in parameters]
    rows: list[list[Content]] = []
    for parameter, of_robot in zip(parameters, nominal, strict=True):
        value, sigma, unit = value_and_sigma(parameter["value"], parameter["sigma"], parameter["unit"])
        known = ""
        if parameter.get("fixed"):
            sigma = "fixed"
        elif parameter["sigma"]:
            ratio = abs(parameter["value"]) / parameter["sigma"]
            known = f"{'●' if ratio >= _KNOWN else '○'} {min(ratio, 9999.0):.0f}"
        tied = [
            minus(rounded(f"{entry['with']} ({entry['r']:+.2f})"))
            for entry in parameter.get("correlations", [])
            if abs(entry["r"]) >= _TIED
        ]
        named = tag("code", rounded(parameter["name"]))
        beside = [of_robot] if any(nominal) else []
        rows.append([named, minus(value), sigma, unit, *beside, known, ", ".join(tied)])
    beside = ["nominal"] if any(nominal) else []
    headers = ["parameter", "value", "± sigma", "unit", *beside, "value / sigma", "tied to (correlation)"]
    return table(headers, rows, caption, words=(0, 3, len(headers) - 1))


def _curve(fit: Fit, entries: list[dict[str, Any]]) -> Markup:
    term = entries[0]["terms"][0]
    axis = term["table"]["axes"][0]
    nodes = np.array(axis["nodes"], dtype=np.float64)
    values, sigmas = np.zeros(nodes.size), np.zeros(nodes.size)
    for entry in entries:
        at = entry["terms"][0]["table"]["index"][0]
        values[at] = entry["value"] * entry["terms"][0]["weight"]
        sigmas[at] = entry["sigma"] or 0.0
    factor, unit = (ARCSECOND, "″") if entries[0]["unit"].startswith("rad") else (1e-6, "µm")
    what, of_axis, scale = axis_of(fit, axis["variable"])
    title = name({"effect": entries[0]["effect"], "joints": entries[0]["joints"]})
    panel = charts.curve_panel(
        nodes / scale,
        values / factor,
        f"{what} [{of_axis}]" if of_axis else what,
        f"{coordinate_words(term['coordinate'])} [{unit}]",
        f"Table of {title} over {axis['variable']}",
        sigmas / factor,
    )
    return figure(title, panel, f"{plural(nodes.size, 'node')}; the band is two sigmas", level=4)


def _grids(grids: list[list[dict[str, Any]]]) -> Markup:
    rows: list[list[Content]] = []
    for entries in grids:
        reference = entries[0]["terms"][0]
        axes = " × ".join(f"{axis['variable']} ({len(axis['nodes'])})" for axis in reference["table"]["axes"])
        largest = max(entries, key=lambda entry: abs(float(entry["value"])))
        value, _, unit = value_and_sigma(largest["value"], None, largest["unit"])
        title = name({"effect": entries[0]["effect"], "joints": entries[0]["joints"]})
        rows.append([title, reference["coordinate"], axes, str(len(entries)), f"{minus(value)} {unit}"])
    headers = ["grid", "acts on", "axes (nodes)", "parameters", "largest"]
    return table(headers, rows, "Grids", words=(0, 1, 2))
