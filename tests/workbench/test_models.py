"""Effects swapped, branches named, and two models side by side."""

from __future__ import annotations

import pytest
from selenium.webdriver.common.by import By

pytestmark = pytest.mark.full

CARD = "return document.getElementById('card').innerText"


def test_effect_is_swapped_and_both_models_are_compared(page, workbench):
    page.add()
    first = page.model()[-1]
    entry = page.browser.driver.find_elements(By.CSS_SELECTOR, "ul[aria-label=Model] [data-act=swaps]")[-1]
    entry.click()
    rivals = page.until(lambda: page.by_role("#card button[data-act=swap]", "button"), "rivals")
    name = rivals[0].accessible_name
    assert name.endswith(f"in the place of {first}")
    rival = name.removeprefix("Put ").split(" in the place")[0]
    said = page.after(rivals[0].click)
    assert f"removed {first}" in said
    assert page.model()[-1].split(" sensor")[0] == rival.split(" sensor")[0]
    state = workbench.state()
    assert [node["parent"] for node in state["models"]] == [None, 0, 1]
    assert state["models"][2]["removed"] == [state["models"][1]["effects"][-1]]

    (button,) = page.browser.driver.find_elements(By.CSS_SELECTOR, "[data-act=beside][data-node='1']")
    button.click()
    words = page.until(lambda: "Close" in page.browser.run(CARD) and page.browser.run(CARD), "side by side")
    assert first in words
    assert rival.split()[0] in words
    shown = next(line for line in words.splitlines() if line.startswith("probability"))
    assert shown.split("\t")[1:] == ["< 1 %", "> 99 %"], "what was hidden is the likelier"
    rows = page.browser.driver.find_elements(By.CSS_SELECTOR, "#card tbody")[1].find_elements(
        By.TAG_NAME, "tr"
    )
    apart = [float(row.find_elements(By.TAG_NAME, "td")[0].text) for row in rows]
    assert len(apart) == 10
    assert apart == sorted(apart, reverse=True)
    page.one("#card button", "button", "Ring these poses on the arm").click()
    rings = "return document.querySelector('.stage .ringed').getAttribute('d').split('M').length - 1"
    page.until(lambda: page.browser.run("return document.querySelector('.stage .ringed') !== null"), "rings")
    assert page.browser.run(rings) == 10

    page.browser.driver.find_element(By.CSS_SELECTOR, "[data-act=beside][data-node='1']").click()
    decide = page.until(lambda: page.by_role("#card button", "button", "Plan poses that decide"), "button")
    assert "poses planned" in page.after(decide[0].click)
    assert page.failure() == ""


def test_name_of_a_model_survives_a_killed_server(page, workbench, start):
    page.add()
    page.browser.driver.find_element(By.ID, "model-name").send_keys("with lost motion")
    page.after(page.one("main button", "button", "Name").click)
    assert [node["name"] for node in workbench.state()["models"]] == ["", "with lost motion"]
    assert page.until(lambda: page.by_role(".tree button", "button", "with lost motion"), "name in the tree")
    workbench.kill()
    assert start().state()["models"][1]["name"] == "with lost motion"


@pytest.mark.parametrize("asked", ["beside?node=7", "beside?node=x", "beside", "swaps?effect=99", "swaps"])
def test_request_for_an_absent_model_or_effect_is_refused(workbench, asked):
    answer = workbench.ask(f"{workbench.path}{asked}")
    assert answer.status == 400
    assert b"expected" in answer.read()


def test_added_effect_that_is_hard_to_tell_apart_is_reported(page, workbench):
    place = next(k for k, name in enumerate(page.candidates()) if name.startswith("tracker_scale"))
    said = page.add(place)
    assert "The held-out mean error stays" in said
    assert "tracker_scale and the base's shift along z can hardly be told apart by these poses" in said
