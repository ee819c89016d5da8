"""Nearly 12 000 real poses of a UR10, with orientations: the page shows the error fall and stays alive meanwhile."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from bench_page import Page

ROOT = Path(__file__).resolve().parents[2]
SERIES = ROOT / "docs/examples/ur10-leica/series_a.yaml"
DATA = ROOT.parent / "shared/datasets/ur10-leica/series_a_grid.csv"
POSES = 11911
PATIENCE_S = 600.0
# What a person takes for a page that has frozen.
FROZEN_S = 2.0

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not DATA.is_file(), reason=f"the UR10 set is not at {DATA}"),
]


def test_a_real_arm_is_diagnosed_in_the_background_and_its_error_falls(start, browser):
    workbench = start(SERIES)
    browser.look((1280, 900))
    browser.driver.get(workbench.address)
    page = Page.__new__(Page)
    page.browser, page.address = browser, workbench.address
    page.until(lambda: "µm" in page.error(), "figures")
    assert workbench.state()["diagnosing"]
    assert workbench.state()["candidates"] == []
    end = time.monotonic() + PATIENCE_S
    while not page.candidates():
        assert time.monotonic() < end
        asked = time.monotonic()
        workbench.state()
        assert time.monotonic() - asked < FROZEN_S
        time.sleep(0.5)
    before = workbench.state()["error"]["held_out"]
    assert before["n"] == POSES - len(workbench.state().get("rejected", []))
    said = page.add()
    assert "fell from" in said
    assert workbench.state()["error"]["held_out"]["mean_um"] < before["mean_um"]
    page.press("Undo")
    assert workbench.state()["error"]["held_out"] == before
    assert page.failure() == ""
