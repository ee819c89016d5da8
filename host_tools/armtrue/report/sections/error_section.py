"""How the error fell: a waterfall over the steps, and the figures behind it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from armtrue.report.content import Report
from armtrue.report.gathered.steps import floor_source
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import ARCSECOND, lead, micrometres, scored_um, section, table
from armtrue.report.scales import Scale, tick_text
from armtrue.verdicts import FLOOR_MOVES

# Key of the measure, its name, and the outline of its mark in a square of 16.
_MEASURES = (
    ("mean_um", "mean", "M8 2.5a5.5 5.5 0 1 0 .01 0z"),
    ("rms_um", "RMS", "M8 2l6 6-6 6-6-6z"),
    ("p95_um", "95 %", "M8 2.5l6 11H2z"),
    ("max_um", "max", "M2.5 3h11v10h-11z"),
)
_NAMES = [called for _, called, _ in _MEASURES]
_WAYS = {"random": "poses drawn at random", "time": "stretches of time", "region": "regions of the workspace"}
_READING = (
    "Distance between measured and predicted positions. Filled marks are held-out poses, which the fit never saw; "
    "hollow marks are training poses. The bar is the fall of the held-out mean. "
)
_RISE = "A hatched bar is a rise. "
# The text of a tick further right than this would extend beyond the axis.
_LAST_TICK = 0.97
_FITTED_HERE = " Steps that say so were fitted for this report, one effect added at a time."


@dataclass(frozen=True)
class _Bar:
    """One row of the waterfall."""

    title: str
    about: Content
    train: dict[str, Any] | None
    held_out: dict[str, Any]
    floor: float | None = None


def error_section(report: Report) -> Markup:
    """The error at each step: mean, RMS, 95 % and maximum, training and held out, beside the noise floor."""
    bars = _bars(report)
    floor = report.last.noise_floor_um
    scale = _scale(bars)
    rows = [_row(bar, bars[k - 1] if k else None, scale) for k, bar in enumerate(bars)]
    ticks = [
        tag("span", tick_text(value), class_="at", style=_left(scale, value))
        for value in scale.ticks()
        if scale.share(value) < _LAST_TICK
    ]
    unit = tag("span", "µm, logarithmic", class_="unit")
    axis = tag("div", ticks, unit, class_="waterfall-axis", aria_hidden="true")
    source = floor_source(report.last)
    moves = f" {FLOOR_MOVES}" if report.last.fit.document["noise_floor"]["source"] == "repeats" else ""
    floor_words = "The noise floor is not known: nothing was measured twice and no uncertainty is stated."
    if floor is not None:
        floor_words = (
            f"The dashed line is the noise floor of each step, of the last {micrometres(floor)} µm ({source}): what "
            f"measuring and repeatability alone leave.{moves}"
        )
    means = [bar.held_out["mean_um"] for bar in bars]
    rises = any(after > before for before, after in pairwise(means) if None not in (before, after))
    fitted = None if all(step.given for step in report.steps) else _FITTED_HERE
    return section(
        "error",
        "How the error fell",
        lead(_READING, _RISE if rises else None, floor_words, fitted),
        _legend(),
        tag("div", rows, axis, class_="waterfall"),
        _table(bars, floor),
        _turns(report),
        _cross_validation(report),
    )


def _bars(report: Report) -> list[_Bar]:
    nominal = report.first.error["nominal"]
    bars = [_Bar("Nominal arm", "aligned to the data, nothing fitted", None, nominal)]
    for step in report.steps:
        about: Content = step.title if step.given else "fitted for this report"
        if step is report.first:
            about = ", ".join(dict.fromkeys(p["effect"] for p in step.fit.document["parameters"]))
        error = step.error
        bars.append(_Bar(step.called, about, error["train"], error["held_out"], step.noise_floor_um))
    return bars


def _scale(bars: list[_Bar]) -> Scale:
    values = [bar.held_out[key] for bar in bars for key, _, _ in _MEASURES]
    values += [bar.train[key] for bar in bars if bar.train for key, _, _ in _MEASURES]
    values += [bar.floor for bar in bars]
    positive = [value for value in values if value is not None and value > 0.0] or [1.0]
    return Scale(0.7 * min(positive), 1.35 * max(positive), logarithmic=True)


def _row(bar: _Bar, before: _Bar | None, scale: Scale) -> Markup:
    track: list[Content] = []
    if bar.floor is not None:
        track.append(tag("i", class_="floor", style=_left(scale, bar.floor)))
    start, end = before.held_out["mean_um"] if before else None, bar.held_out["mean_um"]
    if start is not None and end is not None:
        left, right = sorted(float(scale.share(max(value, scale.low))) for value in (start, end))
        place = f"left:{100 * left:.2f}%;width:{100 * (right - left):.2f}%"
        track.append(tag("i", class_="fall" if end <= start else "fall rise", style=place))
    for key, _, outline in _MEASURES:
        if bar.train is not None:
            track.append(_mark(outline, "train", scale, bar.train[key]))
        if bar.held_out[key] is not None:
            track.append(_mark(outline, "held", scale, bar.held_out[key]))
    figures = tag("span", scored_um(bar.held_out["mean_um"]), class_="figure")
    name = tag("div", tag("strong", bar.title), figures, tag("small", bar.about), class_="step")
    return tag("div", name, tag("div", track, class_="track", aria_hidden="true"), class_="row")


def _mark(outline: str, kind: str, scale: Scale, value: float) -> Markup:
    place = _left(scale, max(value, scale.low))
    return tag("svg", tag("path", d=outline), class_=kind, viewBox="0 0 16 16", style=place)


def _left(scale: Scale, value: float) -> str:
    return f"left:{100 * float(scale.share(value)):.2f}%"


def _legend() -> Markup:
    def entry(outline: str, kind: str, words: str) -> Markup:
        return tag("span", tag("svg", tag("path", d=outline), class_=kind, viewBox="0 0 16 16"), words)

    held = [entry(outline, "held", called) for _, called, outline in _MEASURES]
    return tag("p", held, entry(_MEASURES[0][2], "train", "training"), class_="legend", aria_hidden="true")


def _table(bars: list[_Bar], floor: float | None) -> Markup:
    headers = ["step", *(f"{name}, held out" for name in _NAMES), *(f"{name}, training" for name in _NAMES)]
    rows = []
    for bar in bars:
        held = [micrometres(bar.held_out[key]) for key, _, _ in _MEASURES]
        train = [micrometres(bar.train[key] if bar.train else None) for key, _, _ in _MEASURES]
        rows.append([bar.title, *held, *train])
    if floor is not None:
        rows.append(["Noise floor, last step", micrometres(floor), *[""] * (2 * len(_MEASURES) - 1)])
    return table(headers, rows, "Error at each step [µm]")


def _turns(report: Report) -> Markup | None:
    """Errors of orientation at each step; None where orientations were not measured."""
    rows: list[list[Content]] = []
    for step in report.steps:
        error = step.fit.orientation_error()
        if error is not None:
            figures = [f"{error[key] / ARCSECOND:.1f}" for key in ("mean", "rms", "p95", "max")]
            rows.append([step.called, *figures])
    if not rows:
        return None
    caption = "Error of orientation at each step, training poses [″]: angle between measured and predicted"
    return table(["step", *_NAMES], rows, caption)


def _cross_validation(report: Report) -> Markup:
    rows = []
    for key, words in _WAYS.items():
        entry = report.last.error["held_out_by"][key]
        rows.append([words, *(micrometres(entry[measure]) for measure, _, _ in _MEASURES)])
    folds = report.last.error["folds"]
    caption = f"Last step, cross-validated in {folds} folds, three ways of holding out [µm]"
    return table(["held out", *_NAMES], rows, caption)
