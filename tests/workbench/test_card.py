"""The card of a candidate, and the poses that would decide between it and its rivals."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.full


@pytest.fixture
def card(page):
    """Opens the card of a candidate and returns its text once the evidence is drawn."""

    def opened(name: str) -> str:
        rows = page.candidates()
        place = next(k for k, row in enumerate(rows) if row.startswith(name))
        page.by_role("[data-act=card]", "button", "Why?")[place].click()
        page.until(lambda: page.by_role("#card button", "button", "Close"), "card")
        page.until(lambda: "Added-variable plot" in page.browser.run(WORDS), "evidence")
        return str(page.browser.run(WORDS))

    return opened


WORDS = "return document.getElementById('card').innerText"
MOVED = "return document.querySelector('.effect-picture animate').getAttribute('values').split(';').length"
PLACE = "return document.querySelector('.effect-picture').getCurrentTime()"


def test_card_shows_formula_bound_and_rivals_of_the_effect(page, card):
    words = card("gear_harmonics 3")
    for part in (
        "motor3 += sin1·sin(q3)",
        "Physical bound",
        "Source of the bound",
        "joint 3",
        "Why not its neighbour?",
        "Which poses would decide?",
    ):
        assert part in words
    assert "gear_mesh 3" in words or "transmission_pwl 3" in words
    (picture,) = page.by_role("#card svg.effect-picture", "image")
    assert "joint 3" in picture.accessible_name
    assert page.browser.run(MOVED) > 10
    marked = "return document.querySelectorAll('.effect-picture .marked-joint').length"
    assert page.browser.run(marked) == 1
    assert page.browser.complaints() == []


def test_picture_can_be_stopped_and_moved_again(page, card):
    card("gear_harmonics 3")
    page.one("#card button", "button", "Hold still").click()
    first = page.browser.run(PLACE)
    page.browser.run("return new Promise((done) => setTimeout(done, 300))")
    assert page.browser.run(PLACE) == first
    page.one("#card button", "button", "Let it move").click()
    page.until(lambda: page.browser.run(PLACE) > first, "motion")


def test_picture_is_still_if_reduced_motion_is_preferred(page, card):
    page.browser.driver.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    )
    try:
        card("gear_harmonics 3")
        assert page.by_role("#card button", "button", "Let it move")
    finally:
        page.browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_poses_that_decide_are_planned_from_the_card_and_drawn(page, card, workbench):
    card("gear_harmonics 3")
    page.browser.run("document.getElementById('poses').value = '6'")
    said = page.after(page.one("#card button", "button", "Plan these poses").click)
    assert "6 poses planned" in said
    assert "decide between" in page.text("result")
    assert page.browser.run("return document.querySelectorAll('.planned-arm').length") == 6
    assert workbench.state()["failure"] == ""
