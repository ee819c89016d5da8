"""A notebook shows the sections of the page, each as a page of its own."""

from __future__ import annotations

import copy
import html
import re
from dataclasses import replace

import pytest

from armtrue.report import figures, gather
from armtrue.report.markup import tag
from armtrue.report.page import page

ALL = ["waterfall", "vectors", "state", "spectra", "candidates", "added_variables", "parameters", "coverage"]


@pytest.mark.full
@pytest.mark.parametrize("name", ALL)
def test_picture_is_the_section_of_the_page(report, name):
    shown = getattr(figures, name)(report).html
    section = re.search(r"<section.*</section>", shown, re.DOTALL)[0]
    assert "<svg" in section or 'class="viewer"' in section or "bar-track" in section or "<table" in section
    assert section in page(report)


def test_notebook_shows_a_picture_isolated_in_an_iframe(report):
    picture = figures.vectors(report)
    frame = re.fullmatch(r'<iframe .*srcdoc="([^"]*)".*></iframe>', picture._repr_html_(), re.DOTALL)
    assert html.unescape(frame[1]) == picture.html
    assert "<style>" in picture.html
    assert "<script>" in picture.html


@pytest.mark.full
def test_unexplained_structure_is_drawn_only_if_there_is_any(report, heated):
    assert "<svg" in figures.unexplained(heated).html
    assert "nothing to show" in figures.unexplained(report).html


def test_picture_without_a_section_says_that_there_is_nothing_to_show():
    assert "Spectra: nothing to show." in figures.Picture("Spectra", None).html
    drawn = figures.Picture("Spectra", tag("section", "seen")).html
    assert "<section>seen</section>" in drawn
    assert "nothing to show" not in drawn


def test_picture_is_saved_as_a_page(report, tmp_path):
    picture = figures.waterfall(report)
    picture.save(tmp_path / "waterfall.html")
    assert (tmp_path / "waterfall.html").read_text(encoding="utf-8") == picture.html
    assert repr(picture) == "Picture: How the error fell"


@pytest.mark.full
def test_waterfall_hatches_a_rise_of_the_error(report):
    worse = copy.deepcopy(report.last.error)
    fits = [report.last.fit, replace(report.last.fit, document={**report.last.fit.document, "error": worse})]
    worse["held_out"]["mean_um"] *= 3.0
    assert "A hatched bar is a rise." in figures.waterfall(gather(fits)).html
    assert "A hatched bar" not in figures.waterfall(report).html
