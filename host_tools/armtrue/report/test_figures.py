"""The figures for notebooks draw what the page draws."""

from __future__ import annotations

import copy
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from armtrue.report import figures, gather
from armtrue.report.page import page


def drawn(figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=40)
    return stream.getvalue()


def test_all_figures_can_be_drawn(report):
    first = report.diagnoses[0]
    made = [
        figures.waterfall(report),
        figures.vectors(report),
        figures.state(report),
        figures.spectra(report),
        figures.candidates(first),
        figures.added_variables(first),
    ]
    assert all(drawn(figure).startswith(b"\x89PNG") for figure in made)
    assert [len(figure.axes) for figure in made] == [1, 1, 12, 6, 1, len(first.added_variables)]


def test_the_waterfall_shows_the_held_out_means(report):
    axes = figures.waterfall(report).axes[0]
    line = next(line for line in axes.lines if line.get_label() == "mean")
    expected = [report.first.error["nominal"]["mean_um"]]
    expected += [step.error["held_out"]["mean_um"] for step in report.steps]
    assert line.get_xdata() == pytest.approx(expected)


def test_the_waterfall_of_long_names_is_inside_its_figure(report):
    steps = [replace(step, title="thermal_joint_drift 1, 2, 3 " * 4) for step in report.steps]
    figure = figures.waterfall(replace(report, steps=steps))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    (axes,) = figure.axes
    texts = [*axes.get_yticklabels(), axes.xaxis.label, *figure.legends]
    for text in texts:
        extent = text.get_window_extent(renderer)
        assert 0 <= extent.x0 < extent.x1 <= figure.bbox.width
        assert 0 <= extent.y0 < extent.y1 <= figure.bbox.height
    assert axes.get_window_extent(renderer).width > 0.3 * figure.bbox.width


def test_vectors_are_enlarged_as_asked(report):
    figure = figures.vectors(report, step=0, exaggeration=1000.0)
    assert "× 1000" in figure.axes[0].get_title()


def test_spectra_are_of_each_joint(report):
    labels = [axes.get_xlabel() for axes in figures.spectra(report).axes]
    assert labels == [f"cycles a turn of joint {k}" for k in range(1, 7)]
    first = np.asarray(figures.spectra(report).axes[2].lines[0].get_ydata())
    assert first.max() == pytest.approx(100.0 * report.diagnoses[0].spectra[2].explained.max())


def test_what_no_effect_names_has_a_line_for_each_part(heated):
    figure = figures.unexplained(heated.diagnoses[0])
    assert drawn(figure).startswith(b"\x89PNG")
    findings = heated.diagnoses[0].findings
    assert len(figure.axes) == len(findings)
    at = next(k for k, finding in enumerate(findings) if finding.parts)
    words = [text.get_text() for text in figure.axes[at].get_legend().get_texts()]
    assert words == [part.label for part in findings[at].parts]
    means = [container.lines[0].get_ydata() for container in figure.axes[at].containers]
    assert means[0] == pytest.approx(findings[at].parts[0].means.mean)


def test_nothing_unexplained_is_an_empty_figure(report):
    assert figures.unexplained(report.diagnoses[-1]).axes == []


def test_coverage_counts_every_pose(report):
    figure = figures.coverage(report)
    assert drawn(figure).startswith(b"\x89PNG")
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert labels[:2] == ["joint 1 [°]", "joint 2 [°]"]
    assert {"payload [kg]", "time [h]"} <= set(labels)
    for axes in figure.axes:
        assert sum(bar.get_height() for bar in axes.patches) == report.last.fit.data.count


def test_parameters_stand_at_their_values(report):
    figure = figures.parameters(report)
    assert drawn(figure).startswith(b"\x89PNG")
    at = {}
    for axes in figure.axes:
        names = [text.get_text() for text in axes.get_yticklabels()]
        at |= dict(zip(names, axes.containers[0].lines[0].get_xdata(), strict=True))
    document = report.last.fit.document["parameters"]
    asked = {p["name"]: p for p in document if p["effect"] == "link_geometry" and not p["held"]}
    angles = {name: p["value"] for name, p in asked.items() if p["unit"] == "rad"}
    assert len(angles) > 3
    for name, value in angles.items():
        assert at[name] == pytest.approx(value * 648000.0 / np.pi)
    assert not any(name.startswith(("base_frame", "tool_offset")) for name in at)


def test_gross_errors_are_cut_and_counted(report):
    figure = figures.vectors(report)
    gross = len(report.last.fit.document["rejected"])
    title = figure.axes[0].get_title()
    assert int(re.search(r"(\d+) of \d+ cut", title)[1]) >= gross
    points = report.last.fit.data.positions_m
    arrows = np.concatenate(figure.axes[0].collections[-1]._segments3d)
    room = 0.31 * np.linalg.norm(np.ptp(points, axis=0))
    assert np.all((arrows > points.min(axis=0) - room) & (arrows < points.max(axis=0) + room))


def test_a_rise_is_hatched(report):
    worse = copy.deepcopy(report.last.error)
    fits = [report.last.fit, replace(report.last.fit, document={**report.last.fit.document, "error": worse})]
    worse["held_out"]["mean_um"] *= 3.0
    bars = figures.waterfall(gather(fits)).axes[0].patches
    assert [bar.get_hatch() for bar in bars] == [None, "////"]
    assert "A hatched bar is a rise." in page(gather(fits))
    assert "A hatched bar" not in page(report)


def test_where_there_is_nothing_to_draw_the_figure_says_so(report):
    assert not report.diagnoses[-1].findings
    assert [text.get_text() for text in figures.unexplained(report.diagnoses[-1]).texts] == [
        "nothing to draw"
    ]
