"""A large campaign: figures are shown before the diagnosis, which runs in the background and can be stopped."""

from __future__ import annotations

import armtrue_sim
import pytest
from bench_page import Page
from opened import TWO_HIDDEN

pytestmark = pytest.mark.full

POSES = 2500
MANY_POSES = 12000


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    folder = tmp_path_factory.mktemp("large")
    armtrue_sim.simulate({**TWO_HIDDEN, "poses": POSES}).write(folder)
    return folder


def test_figures_of_a_large_campaign_do_not_wait_for_the_diagnosis(start, browser, large):
    workbench = start(large / "data.csv")
    page = Page(browser, workbench.address)
    said = page.add()
    shown = workbench.state()
    assert "fell from" in said
    assert len(shown["steps"]) == 2
    assert (shown["verdict"], shown["candidates"], shown["diagnosing"]) == (None, [], True)
    assert "being worked out" in page.text("verdict")
    # The pictures that need only the fit do not wait either.
    page.until(lambda: browser.run("return document.querySelector('.stage svg') !== null"), "picture")
    assert workbench.state()["diagnosing"]

    page.button("Cancel").click()
    page.until(lambda: "was stopped" in page.text("verdict"), "word of the diagnosis that was stopped")
    assert not workbench.state()["diagnosing"]
    page.press("Undo")
    page.press("Redo")
    page.one("main button", "button", "Work out what is missing").click()
    page.until(page.candidates, "candidates")
    assert workbench.state()["verdict"] == "missing_effect"

    workbench.kill()
    again = start(large / "data.csv").state()
    assert (again["verdict"], len(again["steps"]), again["diagnosing"]) == ("missing_effect", 2, False)


def test_another_step_does_not_wait_for_the_diagnosis_of_the_last(start, browser, large):
    workbench = start(large / "data.csv")
    page = Page(browser, workbench.address)
    page.add()
    page.press("Undo")  # the first model's diagnosis is known
    assert page.candidates()
    page.add(1)
    assert [node["parent"] for node in workbench.state()["models"]] == [None, 0, 0]
    page.remove(page.model()[-1])
    assert page.failure() == ""


def test_first_figures_of_some_rows_are_shown_while_all_are_fitted(start, browser, tmp_path):
    armtrue_sim.simulate({**TWO_HIDDEN, "poses": MANY_POSES}).write(tmp_path)
    workbench = start(tmp_path / "data.csv")
    page = Page(browser, workbench.address)
    names = page.candidates()
    slow = next(k for k, name in enumerate(names) if name.startswith("transmission_pwl"))
    said = page.add(slow)
    assert said.startswith(f"First figures, from 1000 of {MANY_POSES} measurements")
    assert "being fitted" in page.error()
    assert page.model()[-1].startswith("transmission_pwl")
    running = workbench.state()
    assert (running["busy"], len(running["steps"])) == (True, 1)
    page.until(lambda: not workbench.state()["busy"], "fit to all measurements")
    page.until(lambda: "being fitted" not in page.error(), "figures of all measurements")
    assert not page.status().startswith("First figures")
    assert len(workbench.state()["steps"]) == 2

    page.press("Undo")
    page.until(page.candidates, "candidates")
    page.add(slow + 1)
    page.button("Cancel").click()
    page.until(lambda: page.status().startswith("Stopped"), "word of the stop")
    page.until(lambda: "being fitted" not in page.error(), "figures of the model before")
    assert len(workbench.state()["models"]) == 2
