"""The real UR10, 11 911 full poses: an effect is added, first figures come from 1000 of them, and the error falls."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from bench_page import Page

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "ur10-leica"
MEASUREMENTS = ROOT.parent / "shared" / "datasets" / "ur10-leica"
PATIENCE_S = 600.0

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(
        not MEASUREMENTS.is_dir(),
        reason=f"no UR10 measurements at {MEASUREMENTS} (not part of this repository)",
    ),
]


def test_an_effect_is_added_to_twelve_thousand_poses(start, browser):
    workbench = start(
        EXAMPLE / "series_a.yaml", "--robot", EXAMPLE / "robot.yaml", "--model", EXAMPLE / "model.yaml"
    )
    page = Page(browser, workbench.address, patience_s=PATIENCE_S)
    before = workbench.state()["error"]["held_out"]["mean_um"]
    begun = time.monotonic()
    said = page.add()
    print(f"first figures after {time.monotonic() - begun:.2f} s: {said}")
    assert said.startswith("First figures, from 1000 of 11911 measurements")
    assert "fell from" in said
    # The page answers while all are fitted: the arm is drawn, and no other action can be started.
    assert browser.run("return document.querySelector('.stage svg') !== null")
    assert not page.button("Refine").is_enabled()
    page.until(lambda: not workbench.state()["busy"], "fit to all measurements")
    print(f"all measurements after {time.monotonic() - begun:.2f} s")
    assert page.failure() == ""
    assert workbench.state()["error"]["held_out"]["mean_um"] < before
    assert len(workbench.state()["steps"]) == 2
