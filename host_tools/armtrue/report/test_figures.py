"""The figures for notebooks draw what the page draws."""

from __future__ import annotations

import io

import numpy as np
import pytest

from armtrue.report import figures


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


def test_vectors_are_enlarged_as_asked(report):
    figure = figures.vectors(report, step=0, exaggeration=1000.0)
    assert "× 1000" in figure.axes[0].get_title()


def test_spectra_are_of_each_joint(report):
    labels = [axes.get_xlabel() for axes in figures.spectra(report).axes]
    assert labels == [f"cycles a turn of joint {k}" for k in range(1, 7)]
    first = np.asarray(figures.spectra(report).axes[2].lines[0].get_ydata())
    assert first.max() == pytest.approx(100.0 * report.diagnoses[0].spectra[2].explained.max())
