"""The report's charts as SVG panels."""

from __future__ import annotations

import numpy as np

from armtrue.arrays import Array
from armtrue.report.content import AddedVariable, Report, View
from armtrue.report.gathered.binned import DISCRETE, Binned
from armtrue.report.gathered.spectrum import Peak, Spectrum
from armtrue.report.gathered.structure import Finding
from armtrue.report.gathered.thinning import loudest, spread_rows
from armtrue.report.markup import Markup, tag
from armtrue.report.pictures.panel import Panel
from armtrue.report.scales import Scale, around, symmetric, tick_text

DOTS = 500
_SPECTRUM_LINES = 700
_NAMED_PEAKS = 3
# Readings beyond this percentile lie outside the panel, so that one gross error does not flatten all others.
_SHOWN_PERCENT = 99.0
_ONE_PERCENT = 0.01
# Shares of the residual that differ by less than this are shown as the same figure.
_SAME_SHARE = 0.005


def state_panel(report: Report, view: View, dots: int = DOTS) -> Markup:
    """The residual of the last step over a state variable: dots, bin means with two standard errors, 5–95 % band."""
    readings = view.direction.read(report.last.residual_m)
    rows = spread_rows(readings.size, dots)
    rows = rows[view.direction.drawn[rows] & report.last.used[rows]]
    # The first step's means are drawn only where they have a trend, or the line would contradict the caption.
    after, before = view.last, view.first if view.first and view.first.trend else None
    sizes = np.concatenate([np.abs(readings[rows]), np.abs(after.low), np.abs(after.high)])
    size = float(np.percentile(sizes, _SHOWN_PERCENT)) if sizes.size else 0.0
    if before is not None:
        size = max(size, float(np.abs(before.mean).max(initial=0.0)))
    panel = Panel(
        around(view.variable.values),
        symmetric(1.08 * size),
        view.variable.label,
        f"{view.direction.what} [{view.direction.unit}]",
        f"{view.direction.what} over {view.variable.what}. {trend_words(view)}",
    )
    if np.unique(view.variable.values).size <= DISCRETE:
        panel.name_x_ticks([(float(v), tick_text(float(v))) for v in np.unique(view.variable.values)])
    panel.band(after.centre, after.low, after.high)
    panel.points(view.variable.values[rows], readings[rows], "dots")
    panel.level(0.0, "", "zero")
    if before is not None:
        panel.line(before.centre, before.mean, "first")
    panel.whiskers(after.centre, after.mean - after.error, after.mean + after.error, "whisker")
    panel.line(after.centre, after.mean, "last")
    panel.points(after.centre, after.mean, "knots")
    return panel.render()


def trend_words(view: View) -> str:
    """How much of the scatter the bin means explain, in words."""

    def share(means: Binned) -> str:
        percent = f"{100 * means.explained:.0f} %" if means.explained >= _ONE_PERCENT else "less than 1 %"
        if means.trend:
            return f"explains {percent} of its scatter"
        return "no trend" if means.tells else "too few poses"

    last = share(view.last)
    if view.first is None:
        return f"{last.capitalize()}."
    return f"First step: {share(view.first)}; last: {last}."


def spectrum_panel(spectrum: Spectrum, first: Spectrum | None) -> Markup:
    """Share of Σ r² explained by each period of one joint; the first step's as a dashed line."""
    drawn = [s for s in (first, spectrum) if s is not None]
    highest = max(float(s.explained.max()) for s in drawn)
    top = 1.3 * max(highest, 1.5 * spectrum.significant)
    low, high = float(spectrum.cycles.min()), float(spectrum.cycles.max())
    low = low if spectrum.slides else max(0.4, low)
    found = ", ".join(f"{p.called} ({p.amplitude})" for p in spectrum.peaks) or "no line stands out"
    panel = Panel(
        Scale(low, max(high, 2.0 * low), logarithmic=True),
        Scale(0.0, 100.0 * top),
        f"cycles a {'metre' if spectrum.slides else 'turn'} of joint {spectrum.joint}",
        "explains [% of Σr²]",
        f"Spectrum of the residual over joint {spectrum.joint}: {found}.",
    )
    panel.level(100.0 * spectrum.significant, "scatter stays below", "threshold", at_start=True)
    if once := spectrum.once:
        panel.upright(once, f"lead {1e3 / once:g} mm" if spectrum.slides else f"gear ratio {once:g}", "ratio")
    for s, kind in zip(drawn, ("first", "last") if first is not None else ("last",), strict=True):
        peaks, starts = loudest(s.explained, _SPECTRUM_LINES)
        panel.line(s.cycles[starts], 100.0 * s.explained[peaks], kind)
    peaks_of_all: list[Peak] = [peak for s in drawn for peak in s.peaks]
    for peak in sorted(peaks_of_all, key=lambda peak: -peak.explained)[:_NAMED_PEAKS]:
        panel.note(peak.cycles, 100.0 * peak.explained, peak.short)
    return panel.render()


def added_variable_panel(plot: AddedVariable) -> Markup | None:
    """The residual against what the candidate would add; readings that it explains lie on the line of slope 1.

    None where it would add nothing.
    """
    if plot.adds_nothing:
        return None
    size_x, size_y = (float(np.percentile(np.abs(v), _SHOWN_PERCENT)) for v in (plot.added, plot.left))
    panel = Panel(
        symmetric(1.1 * size_x),
        symmetric(1.1 * size_y),
        f"it would add [{plot.unit}]",
        f"left over [{plot.unit}]",
        f"Added-variable plot of {plot.name}: fitted, it takes away {100 * plot.explained:.0f} % of what is left over.",
    )
    for kind, which in (("dots", ~plot.turned), ("dots turns", plot.turned)):
        readings = np.flatnonzero(which)
        if readings.size:
            rows = readings[spread_rows(readings.size, 3 * DOTS)]
            panel.points(plot.added[rows], plot.left[rows], kind)
    panel.level(0.0, "", "zero")
    ends = np.array([-1.1, 1.1]) * size_x
    panel.line(ends, ends, "last")
    return panel.render()


def added_words(plot: AddedVariable) -> str:
    """The share that the plot explains, and that of the candidates table where the two differ."""
    if plot.adds_nothing:
        return "fitted, it adds nothing: the model can take over all that it does"
    scored = float(plot.candidate["explained"])
    words = f"fitted, it takes away {100 * plot.explained:.1f} % of the squared residual"
    if abs(plot.explained - scored) >= _SAME_SHARE:
        words += f"; its score was {100 * scored:.1f} %"
    return f"{words}; grey: positions, orange: orientations" if plot.turned.any() else words


def curve_panel(
    x: Array, y: Array, x_label: str, y_label: str, description: str, sigma: Array | None = None
) -> Markup:
    """A function of one variable, as fitted, with a band of two standard deviations where they are known."""
    size = float(np.max(np.abs(y)))
    if sigma is not None:
        # A band much wider than the curve may extend beyond the panel.
        size = min(float(np.max(np.abs(y) + 2.0 * sigma)), 2.0 * size)
    panel = Panel(around(x), symmetric(1.1 * size), x_label, y_label, description)
    if sigma is not None:
        panel.band(x, y - 2.0 * sigma, y + 2.0 * sigma)
    panel.level(0.0, "", "zero")
    panel.line(x, y, "last")
    panel.points(x, y, "knots")
    return panel.render()


def structure_panel(finding: Finding) -> Markup:
    """A chart of a dependence: the function of one variable, or means for each part of the second variable."""
    entry = finding.entry
    if finding.x is not None and finding.y is not None:
        spoken = f"Shape of what is left over: {entry['shape']}"
        return curve_panel(finding.x, finding.y, finding.over, finding.along, spoken)
    means = [part.means for part in finding.parts]
    size = max(float(np.max(np.abs(m.mean) + m.error)) for m in means)
    panel = Panel(
        around(np.concatenate([m.centre for m in means])),
        symmetric(1.1 * size),
        finding.over,
        finding.along,
        f"What is left over by {finding.over}, a line for each part of {finding.by}: {entry['shape']}",
    )
    panel.level(0.0, "", "zero")
    for k, m in enumerate(means):
        panel.whiskers(m.centre, m.mean - m.error, m.mean + m.error, f"part whisk{k}")
        panel.line(m.centre, m.mean, f"part part{k}")
    return panel.render()


def key(k: int) -> Markup:
    """The legend's sample of the line of part `k`."""
    return tag(
        "svg", tag("path", class_=f"part part{k}", d="M1 6H29"), class_="panel key", viewBox="0 0 30 12",
        aria_hidden="true",
    )  # fmt: skip


def histogram_panel(
    values: Array, limits: tuple[float, float] | None, label: str, description: str
) -> Markup:
    """Histogram of a variable; the panel spans its limits and all values."""
    ends = np.array([*(limits or ()), float(values.min()), float(values.max())])
    scale = around(ends, margin=0.02)
    counts, edges = np.histogram(values, bins=24, range=(scale.low, scale.high))
    panel = Panel(scale, Scale(0.0, 1.1 * float(counts.max())), label, "poses", description, height=150)
    panel.bars(edges, counts.astype(np.float64))
    for limit in limits or ():
        panel.upright(limit, "limit", "ratio")
    return panel.render()


def place_panel(x: Array, y: Array, names: tuple[str, str], description: str) -> Markup:
    """Where the reflector was, both axes to one scale."""
    rows = spread_rows(x.size, 2 * DOTS)
    half = 0.55 * max(float(np.ptp(x)), float(np.ptp(y)))
    middles = [0.5 * (float(values.min()) + float(values.max())) for values in (x, y)]
    across, up = (Scale(middle - half, middle + half) for middle in middles)
    panel = Panel(across, up, f"{names[0]} [m]", f"{names[1]} [m]", description, height=None)
    panel.points(x[rows], y[rows], "dots strong-dots")
    return panel.render()
