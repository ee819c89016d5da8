"""The first source paper's figures on a simulated arm with its instrument and repeatability."""

from __future__ import annotations

import pytest
from paper import PAPER, figures


@pytest.fixture(scope="module")
def rows():
    return {row["model"]: row for row in figures(refined=False)}


@pytest.mark.full
def test_geometry_alone_stands_where_the_paper_stands(rows):
    assert rows["geometry"]["held_out_in_time"] == pytest.approx(PAPER["geometry"], rel=0.1)


def test_the_unified_model_reaches_the_paper_s_figure(rows):
    assert rows["unified"]["held_out_in_time"] <= PAPER["unified"]
