"""The report's pictures as Matplotlib figures, for notebooks.

    from armtrue.report import figures, gather

    report = gather([fit, best])
    figures.waterfall(report)
    figures.vectors(report)
    figures.state(report)
    figures.unexplained(report.diagnoses[-1])

Every function returns a `matplotlib.figure.Figure` and leaves pyplot alone. Only this module needs Matplotlib.
"""

from __future__ import annotations

import re
import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armtrue.io.catalogue import with_role
from armtrue.report.content import Report, StepDiagnosis, View
from armtrue.report.gathered.state import joint_unit
from armtrue.report.gathered.thinning import spread_rows
from armtrue.report.names import called
from armtrue.report.parts import rounded, typeset
from armtrue.report.pictures.arm import arm_corners, typical_row
from armtrue.report.pictures.charts import added_words, trend_words
from armtrue.units import for_people

_LAST, _FIRST, _DOTS, _SOFT = "#12578f", "#a3480c", "#9aa6ae", "#56626b"
_COLUMNS = 3
_PANEL_INCHES = (3.8, 2.6)
_MEASURES = (
    ("mean_um", "mean", "o"),
    ("rms_um", "RMS", "D"),
    ("p95_um", "95 %", "^"),
    ("max_um", "max", "s"),
)
_MOST_DOTS = 2000
_TITLE_CHARACTERS = 52
_NAME_CHARACTERS = 32
# Lines for parts of a variable: told apart without colour too.
_PART_STYLES: tuple[dict[str, Any], ...] = (
    {"color": _LAST, "ls": "-", "marker": "o", "ms": 3},
    {"color": _FIRST, "ls": "--", "marker": "s", "ms": 3},
    {"color": "#1c6b45", "ls": ":", "marker": "^", "ms": 3},
    {"color": "#1b2227", "ls": "-.", "marker": "D", "ms": 3},
)
_ARROW_SHARE = 0.1
_ROOM_FOR_WORDS = 0.15
# Of the scene: what would be longer, as a gross error, is cut.
_LONGEST_ARROW = 0.3


def waterfall(report: Report) -> Figure:
    """Held-out (filled) and training (hollow) errors at each step [µm], and the noise floor."""
    names = [
        textwrap.fill(name, _NAME_CHARACTERS) for name in ("nominal arm", *(s.title for s in report.steps))
    ]
    lines = sum(name.count("\n") for name in names)
    held = [report.first.error["nominal"], *(step.error["held_out"] for step in report.steps)]
    train: list[dict[str, Any] | None] = [None, *(step.error["train"] for step in report.steps)]
    figure = Figure(figsize=(8.0, 1.1 + 0.5 * len(names) + 0.15 * lines), layout="constrained")
    axes = figure.subplots()
    for row in range(1, len(held)):
        before, after = held[row - 1]["mean_um"], held[row]["mean_um"]
        if before is None or after is None:
            continue
        # A rise is hatched, as on the page.
        hatch = "////" if after > before else None
        axes.barh(row, before - after, left=after, height=0.45, color="#b9cfe0", ec=_FIRST, lw=0, hatch=hatch)
    for key, label, marker in _MEASURES:
        axes.plot(
            [np.nan if entry[key] is None else entry[key] for entry in held],
            range(len(held)),
            marker,
            color=_LAST,
            label=label,
        )
        hollow = [(entry[key], row) for row, entry in enumerate(train) if entry is not None]
        x, y = zip(*hollow, strict=True)
        axes.plot(x, y, marker, mfc="none", color=_SOFT)
    floor = report.last.noise_floor_um
    if floor is not None:
        axes.axvline(floor, color=_SOFT, ls="--", label="noise floor")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel="error [µm], filled: held out, hollow: training")
    # Of the figure, not of the axes: long names leave the axes narrower than the legend.
    figure.legend(ncols=len(_MEASURES) + 1, frameon=False, loc="outside upper center")
    return figure


def vectors(report: Report, step: int = -1, exaggeration: float | None = None) -> Figure:
    """Residual vectors over the arm in the measuring frame; `step` counts as in a list.

    `exaggeration`: how many times arrows are enlarged; None chooses. Arrows that would leave the picture are cut, and
    the title says how many.
    """
    shown = report.steps[step]
    points, residual = shown.fit.data.positions_m, shown.residual_m
    rows = spread_rows(len(points), _MOST_DOTS)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    usual = float(np.percentile(np.linalg.norm(residual, axis=1), 95.0))
    factor = exaggeration or _ARROW_SHARE * size / (usual or 1.0)
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    corners = arm_corners(shown, typical_row(shown))
    axes.plot(*corners.T, "o-", color=_SOFT, lw=4, alpha=0.6)
    arrows = factor * residual[rows]
    share = np.minimum(1.0, _LONGEST_ARROW * size / np.maximum(np.linalg.norm(arrows, axis=1), 1e-300))
    axes.quiver(*points[rows].T, *(share[:, None] * arrows).T, color=_LAST, lw=0.8)
    cut = int(np.sum(share < 1.0))
    cut_words = f", {cut} of {len(rows)} cut" if cut else ""
    title = f"{shown.title}: errors × {factor:.0f}{cut_words}"
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", title=title)
    axes.set_aspect("equal")
    return figure


def state(report: Report, most: int = 12) -> Figure:
    """The residual against the state variables that show most, with bin means, their two sigmas and 5–95 % bands."""
    views = report.telling_views()[:most]
    figure, panels = _panels(len(views))
    for axes, view in zip(panels, views, strict=True):
        _draw_state(axes, report, view)
    return figure


def spectra(report: Report) -> Figure:
    """Share of Σ r² that each period of each joint explains; dashed: the first step."""
    last = report.diagnoses[-1]
    first = {s.joint: s for s in report.diagnoses[0].spectra} if len(report.diagnoses) > 1 else {}
    figure, panels = _panels(len(last.spectra))
    for axes, spectrum in zip(panels, last.spectra, strict=True):
        before = first.get(spectrum.joint)
        if before is not None:
            axes.plot(before.cycles, 100.0 * before.explained, "--", color=_FIRST, lw=1)
        axes.plot(spectrum.cycles, 100.0 * spectrum.explained, color=_LAST, lw=1)
        axes.axhline(100.0 * spectrum.significant, color=_SOFT, ls=":")
        if spectrum.gear_ratio:
            axes.axvline(spectrum.gear_ratio, color=_SOFT, ls="-.", lw=1)
        for peak in spectrum.peaks or (before.peaks if before is not None else []):
            axes.annotate(peak.called, (peak.cycles, 100.0 * peak.explained), fontsize=8, ha="center")
        axes.set(
            xscale="log", xlabel=f"cycles a turn of joint {spectrum.joint}", ylabel="explains [% of Σr²]"
        )
        axes.margins(y=_ROOM_FOR_WORDS)
    return figure


def candidates(diagnosis: StepDiagnosis, most: int = 10) -> Figure:
    """What the leading candidates explain; recommended ones carry a star."""
    shown = diagnosis.result["candidates"][:most]
    figure = Figure(figsize=(7.0, 0.8 + 0.32 * max(1, len(shown))), layout="constrained")
    axes = figure.subplots()
    axes.barh(range(len(shown)), [100.0 * c["explained"] for c in shown], color=_LAST)
    axes.set_yticks(range(len(shown)), [f"{'★ ' if c['recommend'] else ''}{called(c)}" for c in shown])
    axes.invert_yaxis()
    axes.set(xlabel="explains [% of the squared residual]", title=f"After {diagnosis.step.title}")
    return figure


def added_variables(diagnosis: StepDiagnosis) -> Figure:
    """Added-variable plots of the leading candidates; readings that one explains lie on its line.

    Crosses are readings of orientation.
    """
    plots = diagnosis.added_variables
    figure, panels = _panels(len(plots))
    for axes, plot in zip(panels, plots, strict=True):
        for which, marker, colour in ((~plot.turned, ".", _DOTS), (plot.turned, "x", _FIRST)):
            readings = np.flatnonzero(which)
            rows = readings[spread_rows(readings.size, _MOST_DOTS)]
            axes.plot(plot.added[rows], plot.left[rows], marker, ms=2, mew=0.4, color=colour)
        axes.axline((0.0, 0.0), slope=1.0, color=_LAST)
        axes.set(xlabel=f"{plot.name} would add [{plot.unit}]", ylabel=f"left over [{plot.unit}]")
        _head(axes, added_words(plot))
    return figure


def unexplained(diagnosis: StepDiagnosis) -> Figure:
    """What no effect names: the function found of one variable; of two, means for each part of the second."""
    found = [finding for finding in diagnosis.findings if finding.drawn]
    figure, panels = _panels(len(found))
    for axes, finding in zip(panels, found, strict=True):
        if finding.x is not None and finding.y is not None:
            axes.plot(finding.x, finding.y, color=_LAST)
        for part, style in zip(finding.parts, _PART_STYLES, strict=False):
            means = part.means
            axes.errorbar(means.centre, means.mean, yerr=means.error, label=part.label, **style)
        if finding.parts:
            axes.legend(title=finding.by, fontsize=7, title_fontsize=7)
        axes.axhline(0.0, color=_SOFT, lw=0.8)
        axes.set(xlabel=finding.over, ylabel=finding.along)
        _head(axes, typeset(finding.entry["shape"]))
    return figure


def coverage(report: Report) -> Figure:
    """Where the arm was measured: joints within their limits (dashed), payload, temperatures and time."""
    fit = report.last.fit
    limits = {}
    for number, joint in enumerate(fit.robot.joints, start=1):
        if joint.get("limits"):
            limits[f"q{number}"] = np.array(joint["limits"]) / joint_unit(joint)[1]
    shown = [v for v in report.variables if re.fullmatch(r"q\d+|temp_.*|payload|time", v.name)]
    figure, panels = _panels(len(shown))
    for axes, variable in zip(panels, shown, strict=True):
        axes.hist(variable.values, bins=24, color=_LAST, alpha=0.75)
        for limit in limits.get(variable.name, []):
            axes.axvline(limit, color=_SOFT, ls="--", lw=1)
        axes.set(xlabel=variable.label, ylabel="poses")
    return figure


def parameters(report: Report, sigmas: float = 2.0) -> Figure:
    """Parameters of the last step with so many `sigmas`, those of one unit in one panel; base, tool and tables not."""
    groups: dict[str, list[tuple[str, float, float]]] = {}
    for parameter in report.last.fit.document["parameters"]:
        table = parameter["terms"][0].get("table")
        if parameter["held"] or table is not None or parameter["effect"] in with_role("placement"):
            continue
        entry = (rounded(parameter["name"]), parameter["value"], parameter["sigma"] or 0.0)
        groups.setdefault(parameter["unit"], []).append(entry)
    tallest = max((len(entries) for entries in groups.values()), default=1)
    figure = Figure(figsize=(4.6 * max(1, len(groups)), 1.0 + 0.24 * tallest), layout="constrained")
    for column, (unit, entries) in enumerate(groups.items(), start=1):
        axes = figure.add_subplot(1, len(groups), column)
        names, values, spreads = zip(*entries, strict=True)
        shown, name = for_people(float(np.median(np.abs(values))) or 1.0, unit)
        factor = (float(np.median(np.abs(values))) or 1.0) / shown
        width = sigmas * np.array(spreads) / factor
        axes.errorbar(np.array(values) / factor, range(len(names)), xerr=width, fmt="o", ms=4, color=_LAST)
        axes.axvline(0.0, color=_SOFT, lw=0.8)
        axes.set_yticks(range(len(names)), names, fontsize=7)
        axes.set_ylim(tallest - 0.5, -0.5)
        axes.set(xlabel=f"[{name}], bars: {sigmas:g} sigmas")
    return figure


def _draw_state(axes: Axes, report: Report, view: View) -> None:
    readings = view.direction.read(report.last.residual_m)
    rows = spread_rows(readings.size, _MOST_DOTS)
    rows = rows[view.direction.drawn[rows] & report.last.used[rows]]
    last = view.last
    axes.plot(view.variable.values[rows], readings[rows], ".", ms=2, color=_DOTS)
    axes.fill_between(last.centre, last.low, last.high, color=_LAST, alpha=0.13, lw=0)
    if view.first is not None:
        axes.plot(view.first.centre, view.first.mean, "--", color=_FIRST)
    axes.errorbar(last.centre, last.mean, yerr=last.error, color=_LAST, marker="o", ms=3)
    axes.axhline(0.0, color=_SOFT, lw=0.8)
    axes.set(xlabel=view.variable.label, ylabel=f"{view.direction.what} [{view.direction.unit}]")
    _head(axes, trend_words(view))


def _head(axes: Axes, words: str) -> None:
    """Words above a panel, in lines that fit its width."""
    axes.set_title(textwrap.fill(words, _TITLE_CHARACTERS), fontsize=8)


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    """A figure of `count` panels in rows of three."""
    rows = max(1, -(-count // _COLUMNS))
    width, height = _PANEL_INCHES
    figure = Figure(figsize=(_COLUMNS * width, rows * height), layout="constrained")
    if not count:
        figure.text(0.5, 0.5, "nothing to draw", ha="center", va="center", color=_SOFT)
    grid = figure.add_gridspec(rows, _COLUMNS)
    return figure, [figure.add_subplot(grid[k // _COLUMNS, k % _COLUMNS]) for k in range(count)]
