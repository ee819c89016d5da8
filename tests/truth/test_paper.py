"""The first source paper's figures on a simulated arm with its instrument and repeatability."""

from __future__ import annotations

import pytest
from paper import PAPER, figures


@pytest.fixture(scope="module")
def rows():
    return {row["model"]: row for row in figures(refined=False)}


@pytest.mark.full
def test_geometry_alone_errs_as_much_as_in_the_paper(rows):
    assert rows["geometry"]["held_out_in_time"] == pytest.approx(PAPER["geometry"], rel=0.1)


def test_unified_model_reaches_the_figure_of_the_paper(rows):
    assert rows["unified"]["held_out_in_time"] <= PAPER["unified"]
