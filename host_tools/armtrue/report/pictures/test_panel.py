"""Charts as SVG: well formed, and everything where it belongs."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from armtrue.report.pictures.charts import place_panel
from armtrue.report.pictures.panel import WIDTH, Panel
from armtrue.report.scales import Scale, symmetric


def made(panel: Panel) -> ET.Element:
    return ET.fromstring(panel.render())


def plot_of(panel: Panel) -> ET.Element:
    found = made(panel).find("svg")
    assert found is not None
    return found


def places(path: str) -> np.ndarray:
    """Absolute positions of the dots in a path of relative moves `mX Yh0`."""
    steps = [(float(x), float(y)) for x, y in re.findall(r"m(-?[\d.]+) (-?[\d.]+)h0", path)]
    return np.cumsum(np.array(steps), axis=0)


def empty() -> Panel:
    return Panel(Scale(0.0, 10.0), symmetric(2.0), "a < b", "up", "a chart & more")


def test_dots_are_where_their_values_are():
    panel = empty()
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0.0, 10.0, 400), rng.uniform(-2.0, 2.0, 400)
    panel.points(x, y, "dots")
    plot = plot_of(panel)
    width, height = float(plot.get("width")), float(plot.get("height"))
    (path,) = plot.findall("path")
    expected = np.column_stack([x / 10.0 * width, (2.0 - y) / 4.0 * height])
    found = places(path.get("d"))
    assert found.shape == expected.shape
    apart = np.abs(found[:, None, :] - expected[None, :, :]).max(axis=2)
    assert apart.min(axis=0).max() < 0.051
    assert apart.min(axis=1).max() < 0.051


def test_text_is_escaped_and_the_chart_has_an_aria_label():
    chart = made(empty())
    assert chart.get("role") == "img"
    assert chart.get("aria-label") == "a chart & more"
    assert "a < b" in [text.text for text in chart.iter("text")]


def test_marks_outside_the_axes_are_left_out():
    panel = empty()
    panel.upright(11.0, "beyond")
    panel.level(-2.5, "below")
    assert not plot_of(panel).findall("text")


def test_notes_do_not_cover_each_other():
    panel = empty()
    panel.upright(4.9, "gear ratio 101")
    for x in (4.8, 5.0, 5.2):
        panel.note(x, -1.0, "12 cycles a turn")
    texts = plot_of(panel).findall("text")
    notes = [float(text.get("y")) for text in texts if text.text == "12 cycles a turn"]
    assert len(notes) == 3
    assert np.diff(sorted(notes)).min() >= 11.0


def test_notes_do_not_cover_pointers_in_either_order():
    panel = empty()
    panel.note(5.0, -1.0, "17")
    panel.note(5.3, -0.8, "27")
    plot = plot_of(panel)
    texts = {text.text: (float(text.get("x")), float(text.get("y"))) for text in plot.findall("text")}
    pointers = [path.get("d") for path in plot.findall("path")]
    places = [tuple(map(float, re.match(r"M([\d.]+) ([\d.]+)l", d).groups())) for d in pointers]
    for x, y in texts.values():
        for at, tip in places:
            beside = abs(x - at) >= 2 * 5.6 / 2 + 3.5
            assert beside or y <= tip - 9.0 or y - 9.0 >= tip
    assert len(texts) == 2


def test_long_tick_labels_move_the_plot_to_the_right():
    wide = plot_of(Panel(Scale(0.0, 1.0), symmetric(600_000.0), "x", "y", "large"))
    usual = plot_of(Panel(Scale(0.0, 1.0), symmetric(90.0), "x", "y", "small"))
    assert float(wide.get("x")) >= 22 + 6 * len("−500000")
    assert float(usual.get("x")) == 53
    assert float(wide.get("x")) + float(wide.get("width")) == WIDTH - 8


def test_bold_letters_of_a_long_note_end_inside_the_plot():
    panel = empty()
    panel.note(7.0, 0.0, "turn of the screw or pinion")
    plot = plot_of(panel)
    (text,) = plot.findall("text")
    # As Chromium draws it in 12 px bold DejaVu Sans.
    assert float(text.get("x")) + 202 / 2 <= float(plot.get("width"))


@pytest.mark.parametrize("x", [0.0, 10.0])
def test_notes_stay_inside_the_chart(x):
    panel = empty()
    panel.note(x, 0.0, "a fairly long note here")
    (text,) = plot_of(panel).findall("text")
    assert 60 < float(text.get("x")) < WIDTH - 100


def test_bars_stand_on_the_axis():
    panel = Panel(Scale(0.0, 3.0), Scale(0.0, 4.0), "x", "n", "bars")
    panel.bars(np.arange(4.0), np.array([4.0, 0.0, 2.0]))
    plot = plot_of(panel)
    height = float(plot.get("height"))
    path = plot.find("path").get("d")
    assert path.count("z") == 2
    assert f"V{height:g}" in path
    assert f"V{height / 2:g}" in path


def test_labels_are_drawn_over_lines():
    panel = Panel(Scale(0.0, 1.0), Scale(0.0, 1.0), "x", "y", "a chart")
    panel.level(0.5, "limit", "threshold", at_start=True)
    panel.line(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "last")
    drawn = str(panel.render())
    assert drawn.index('class="last"') < drawn.index(">limit<")


def test_places_are_drawn_to_one_scale():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-100.0, 100.0, 50), rng.uniform(-10.0, 10.0, 50)
    chart = ET.fromstring(place_panel(x, y, ("x", "y"), "places"))
    plot = chart.find("svg")
    assert plot is not None
    assert plot.get("width") == plot.get("height")
