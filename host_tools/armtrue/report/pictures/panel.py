"""One small chart as SVG: axes, points, lines, bands and marks. Colours come from the page's style sheet by class."""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.report.markup import Markup, join, tag
from armtrue.report.scales import Scale, tick_text

# Width [px] of the narrowest chart on a laptop: charts are never shrunk there, so letters keep their set size.
WIDTH = 310
_LEFT, _RIGHT, _TOP, _BOTTOM = 53, 8, 10, 38
_BESIDE_TICKS = 26.0  # part of the left margin for the axis name and the gaps beside tick labels
_POINTER = (3.5, 9.0)  # half width and height of a note's pointer
_LINE = 13.0
_LABEL_CHARACTER = 6.3  # width of a character of a label, in user units
_NOTE_CHARACTER = 7.8  # the same of a note, which is bold
_TICK_CHARACTER = 9.0  # the same of a tick label on paper, where letters are largest


class Panel:
    """A chart under construction. `description` is its text for screen readers. `height`: None for a square plot."""

    def __init__(
        self, x: Scale, y: Scale, x_label: str, y_label: str, description: str, *, height: int | None = 210
    ) -> None:
        self._x, self._y = x, y
        self._labels = [
            f"{label}, logarithmic" if scale.logarithmic else label
            for scale, label in ((x, x_label), (y, y_label))
        ]
        self._description = description
        self._y_ticks = [(value, tick_text(value)) for value in y.ticks(max(4, (height or WIDTH) // 50))]
        longest = max((len(text) for _, text in self._y_ticks), default=0)
        self._left = max(_LEFT, round(_BESIDE_TICKS + _TICK_CHARACTER * longest))
        self._w = WIDTH - self._left - _RIGHT
        self._height = self._w + _TOP + _BOTTOM if height is None else height
        self._h = self._height - _TOP - _BOTTOM
        self._drawn: list[Markup] = []
        self._labels_drawn: list[Markup] = []  # drawn last, so that no line crosses them
        # Places that notes must not cover: (centre, baseline, half width).
        self._taken: list[tuple[float, float, float]] = []
        self._notes: list[tuple[float, float, str]] = []
        self._x_tick_values: list[tuple[float, str]] | None = None

    def name_x_ticks(self, ticks: list[tuple[float, str]]) -> None:
        """Write these at the x axis instead of round values."""
        self._x_tick_values = ticks

    def points(self, x: Array, y: Array, kind: str) -> None:
        """Dots, as one path of strokes of zero length."""
        columns, rows = self._tenths(x, y)
        order = np.lexsort((rows, columns))
        path, at_x, at_y = [], 0, 0
        for px, py in zip(columns[order].tolist(), rows[order].tolist(), strict=True):
            path.append(f"m{_tenth(px - at_x)} {_tenth(py - at_y)}h0")
            at_x, at_y = px, py
        self._drawn.append(tag("path", class_=kind, d="".join(path)))

    def line(self, x: Array, y: Array, kind: str) -> None:
        """A line through points in order."""
        if np.size(x):
            self._drawn.append(tag("path", class_=kind, d=self._path(x, y)))

    def band(self, x: Array, low: Array, high: Array) -> None:
        """The area between two lines."""
        if np.size(x):
            both = self._path(np.concatenate([x, x[::-1]]), np.concatenate([high, low[::-1]]))
            self._drawn.append(tag("path", class_="spread", d=both + "z"))

    def whiskers(self, x: Array, low: Array, high: Array, kind: str) -> None:
        """Vertical strokes."""
        columns, tops = self._tenths(x, high)
        bottoms = self._tenths(x, low)[1]
        path = "".join(
            f"M{_tenth(c)} {_tenth(t)}V{_tenth(b)}"
            for c, t, b in zip(columns.tolist(), tops.tolist(), bottoms.tolist(), strict=True)
        )
        self._drawn.append(tag("path", class_=kind, d=path))

    def bars(self, edges: Array, heights: Array) -> None:
        """A histogram: bar k stands between edges k and k + 1."""
        floor = float(self._tenths(np.zeros(1) + self._x.low, np.zeros(1))[1][0])
        columns, tops = self._tenths(edges[:-1], heights)
        ends = self._tenths(edges[1:], heights)[0]
        path = "".join(
            f"M{_tenth(a)} {_tenth(int(floor))}V{_tenth(t)}H{_tenth(b)}V{_tenth(int(floor))}z"
            for a, b, t in zip(columns.tolist(), ends.tolist(), tops.tolist(), strict=True)
            if t < floor
        )
        self._drawn.append(tag("path", class_="bar", d=path))

    def upright(self, x: float, label: str, kind: str = "mark") -> None:
        """A vertical mark with a label at its top."""
        share = float(self._x.share(x))
        if not 0.0 <= share <= 1.0:
            return
        at = share * self._w
        left = at + 3 + _LABEL_CHARACTER * len(label) > self._w
        self._drawn.append(tag("path", class_=kind, d=f"M{at:.1f} 0V{self._h}"))
        half, height = _LABEL_CHARACTER * len(label) / 2, 9.0
        self._taken.append((at - half - 3 if left else at + half + 3, height, half))
        self._label(at - 3 if left else at + 3, height, label, "end" if left else "start")

    def level(self, y: float, label: str, kind: str = "mark", *, at_start: bool = False) -> None:
        """A horizontal mark with a label at its right end, or at its left."""
        share = float(self._y.share(y))
        if not 0.0 <= share <= 1.0:
            return
        at = (1.0 - share) * self._h
        self._drawn.append(tag("path", class_=kind, d=f"M0 {at:.1f}H{self._w}"))
        if label:
            place, anchor = (3, "start") if at_start else (self._w - 3, "end")
            self._label(place, at - 3 if at > 14 else at + 11, label, anchor)

    def note(self, x: float, y: float, label: str) -> None:
        """A pointer above a point, and words above it where no other note or pointer stands."""
        column, row = (int(v[0]) / 10 for v in self._tenths(np.array([x]), np.array([y])))
        self._notes.append((column, row, label))
        self._taken.append((column, row - 3, _POINTER[0]))
        self._drawn.append(tag("path", class_="peak", d=f"M{column:.1f} {row - 3:.1f}l-3.5 -6h7z"))

    def _write_notes(self) -> None:
        """Write each note at the nearest free place above its pointer; a note without one is left out."""
        for column, row, label in self._notes:
            half = _NOTE_CHARACTER * len(label) / 2
            at = min(max(column, half + 2), self._w - half - 2)
            height = max(9.0, row - 3 - _POINTER[1])
            while height >= 9.0 and any(
                abs(at - a) < half + other and abs(height - h) < _LINE for a, h, other in self._taken
            ):
                height -= 1.0
            if height >= 9.0:
                self._taken.append((at, height, half))
                self._label(at, height, label, "middle", "label strong")
        self._notes = []

    def render(self) -> Markup:
        """The chart as an SVG element."""
        self._write_notes()
        plot = tag(
            "svg", self._drawn, self._labels_drawn, x=self._left, y=_TOP, width=self._w, height=self._h,
            viewBox=f"0 0 {self._w} {self._h}",
        )  # fmt: skip
        title = tag("title", self._description)
        return tag(
            "svg", title, self._axes(), plot,
            class_="panel", role="img", viewBox=f"0 0 {WIDTH} {self._height}", aria_label=self._description,
            data_plot=self._places(),
        )  # fmt: skip

    def _places(self) -> str:
        """Places, ranges and names of the axes as JSON, so that a page can read values off the chart."""

        def axis(scale: Scale, name: str) -> dict[str, object]:
            ends = [float(f"{end:.6g}") for end in (scale.low, scale.high)]
            return {"ends": ends, "logarithmic": scale.logarithmic, "name": name}

        x, y = axis(self._x, self._labels[0]), axis(self._y, self._labels[1])
        box = [self._left, _TOP, self._w, self._h]
        return json.dumps({"box": box, "x": x, "y": y}, separators=(",", ":"))

    def _axes(self) -> Markup:
        bottom, pieces = _TOP + self._h, []
        for value, text in self._y_ticks:
            at = bottom - float(self._y.share(value)) * self._h
            pieces.append(tag("path", class_="grid", d=f"M{self._left} {at:.1f}h{self._w}"))
            pieces.append(_words(text, self._left - 5, at + 3.5, "end"))
        named = self._x_tick_values or [(value, tick_text(value)) for value in self._x.ticks(5)]
        for value, text in named:
            at = self._left + float(self._x.share(value)) * self._w
            pieces.append(tag("path", class_="tick", d=f"M{at:.1f} {bottom}v4"))
            at_edge = at + _LABEL_CHARACTER * len(text) / 2 > WIDTH
            pieces.append(_words(text, WIDTH if at_edge else at, bottom + 14, "end" if at_edge else "middle"))
        pieces.append(tag("path", class_="axis", d=f"M{self._left} {_TOP}V{bottom}h{self._w}"))
        x_name, y_name = self._labels
        pieces.append(_words(x_name, self._left + self._w / 2, self._height - 5, "middle", "axis-name"))
        upwards = f"translate(13 {_TOP + self._h / 2:.1f}) rotate(-90)"
        pieces.append(tag("text", y_name, class_="axis-name", text_anchor="middle", transform=upwards))
        return join(pieces)

    def _label(self, x: float, y: float, text: str, anchor: str, kind: str = "label") -> None:
        self._labels_drawn.append(_words(text, x, y, anchor, kind))

    def _tenths(self, x: Array, y: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Places in tenths of a user unit."""
        columns = np.round(10 * self._w * self._x.share(x)).astype(np.int64)
        rows = np.round(10 * self._h * (1.0 - self._y.share(y))).astype(np.int64)
        return columns, rows

    def _path(self, x: Array, y: Array) -> str:
        columns, rows = self._tenths(x, y)
        places = [f"{_tenth(a)} {_tenth(b)}" for a, b in zip(columns.tolist(), rows.tolist(), strict=True)]
        return "M" + "L".join(places)


def _words(text: str, x: float, y: float, anchor: str, kind: str = "ticks") -> Markup:
    return tag("text", text, class_=kind, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor)


def _tenth(value: int) -> str:
    """A tenth of an integer, in as few characters as it takes."""
    return f"{value / 10:g}"
