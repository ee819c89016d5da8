"""A session in two tabs, after a restart of the server, with bad and foreign files, by keyboard, and on a phone."""

from __future__ import annotations

import os
import re
import subprocess
import time
from pathlib import Path

import armtrue_sim
import pytest
from bench_page import Page
from opened import ARMTRUE, TWO_HIDDEN
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tests.report.browser import LAPTOP, PHONE

pytestmark = pytest.mark.full


def mean_um(state):
    return state["error"]["held_out"]["mean_um"]


def choose(page, *files: Path) -> None:
    """Choose files as a person does."""
    page.browser.driver.find_element(By.ID, "files").send_keys("\n".join(map(str, files)))


def test_killed_server_restores_the_session(start, browser):
    first = start()
    page = Page(browser, first.address)
    page.add()
    page.press("Undo")
    page.press("Redo")
    before = first.state()
    first.kill()
    second = start()
    after = second.state()
    for key in ("effects", "error", "verdict", "steps", "models"):
        assert after[key] == before[key]
    page = Page(browser, second.address)
    assert "session continues" in page.status()
    page.press("Undo")
    assert len(second.state()["steps"]) == 1


def test_page_of_a_killed_server_says_so_and_shows_no_progress(start, browser):
    workbench = start()
    page = Page(browser, workbench.address)
    workbench.do(do="refine")
    page.until(lambda: page.by_role("header progress", "progressbar", "Progress"), "progress")
    workbench.kill()
    page.until(lambda: "does not answer" in page.failure(), "word of the end")
    browser.run("document.querySelector('[data-panel=parameters] summary').click()")
    slot = "return document.querySelector('[data-panel=parameters] .panel-slot').innerText"
    page.until(lambda: "does not answer" in browser.run(slot), "word in the panel")
    assert not page.by_role("progress", "progressbar")
    assert "fetch" not in browser.run("return document.body.innerText")


def test_second_workbench_is_refused_until_the_first_is_killed(start, campaign):
    first = start()
    command = [ARMTRUE, "open", str(campaign / "data.csv"), "--no-browser"]
    environment = {**os.environ, "XDG_STATE_HOME": str(first.state_home)}
    second = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert second.returncode == 2
    assert second.stdout == ""
    (sentence,) = second.stderr.strip().splitlines()
    assert f"open in another workbench (process {first.process.pid})" in sentence
    assert first.address in sentence
    assert first.do(do="add", candidate=0) == 200
    first.kill()
    start()


def test_two_tabs_show_the_same_model(page, workbench):
    driver = page.browser.driver
    first = driver.current_window_handle
    driver.switch_to.new_window("tab")
    try:
        other = Page(page.browser, workbench.address)
        other.add()
        said = other.status()
        driver.switch_to.window(first)
        page.until(lambda: page.status() == said, "the other tab's sentence")
        page.press("Undo")
        said = page.status()
        driver.switch_to.window(driver.window_handles[1])
        page.until(lambda: other.status() == said, "the first tab's sentence")
    finally:
        driver.switch_to.window(driver.window_handles[1])
        driver.close()
        driver.switch_to.window(first)


def test_page_can_be_used_with_the_keyboard_alone(page, workbench):
    def tab_to(name: str) -> None:
        for _ in range(200):
            ActionChains(page.browser.driver).send_keys(Keys.TAB).perform()
            element = page.browser.driver.switch_to.active_element
            if element.tag_name == "button" and element.text == name:
                return
        raise AssertionError(f"Tab does not lead to {name}")

    def enter() -> None:
        ActionChains(page.browser.driver).send_keys(Keys.ENTER).perform()

    tab_to("Add")
    page.after(enter)
    assert len(workbench.state()["steps"]) == 2
    # The focus stays at an Add button instead of moving to the top of the page.
    assert page.browser.driver.switch_to.active_element.text == "Add"
    page.after(
        lambda: ActionChains(page.browser.driver)
        .key_down(Keys.CONTROL)
        .send_keys("z")
        .key_up(Keys.CONTROL)
        .perform()
    )
    assert len(workbench.state()["steps"]) == 1
    page.after(
        lambda: ActionChains(page.browser.driver)
        .key_down(Keys.CONTROL)
        .send_keys("y")
        .key_up(Keys.CONTROL)
        .perform()
    )
    assert len(workbench.state()["steps"]) == 2
    tab_to("Remove")


@pytest.mark.parametrize("size", [LAPTOP, PHONE, (320, 640)], ids=str)
def test_page_fits_its_width_and_text_is_at_least_12_px(browser, workbench, size):
    page = Page(browser, workbench.address, size)
    page.until(lambda: browser.run("return document.querySelector('.stage svg') !== null"), "picture")
    wide = browser.run("return [document.documentElement.scrollWidth, document.documentElement.clientWidth]")
    assert wide[0] <= wide[1]
    small = browser.run("""return [...document.querySelectorAll('body *')]
        .filter((e) => e.checkVisibility() && !(e instanceof SVGElement)
            && [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()))
        .filter((e) => parseFloat(getComputedStyle(e).fontSize) < 12).map((e) => e.outerHTML.slice(0, 80))""")
    assert small == []
    page.add()


def test_bad_file_gives_one_sentence_and_keeps_the_session(page, workbench, campaign, tmp_path):
    before = workbench.state()
    bad = {
        "empty.csv": b"",
        "binary.csv": bytes(range(256)),
        "words.yaml": b"a: [1, 2\n",
        "not-a-fit.json": b"{}",
        "deep.json": b"[" * 20000,
        "header.csv": b"q1,q2,x,y,z\n",
    }
    for name, content in bad.items():
        path = tmp_path / name
        path.write_bytes(content)
        choose(page, path)
        page.until(
            lambda name=name: name in page.browser.run("return document.getElementById('opening').innerText"),
            name,
        )
        page.one("#opening button", "button", "Open").click()
        sentence = page.until(page.failure, f"sentence about {name}")
        assert "expected" in sentence or "cannot" in sentence or "found" in sentence
        assert "fault of the workbench" not in sentence, name
        assert "dropped-" not in sentence, f"{name} is where the person left it, not in the session's folder"
        page.until(lambda: page.button("Refine").is_enabled(), "end of opening")
        assert workbench.state()["effects"] == before["effects"]
        page.one("#opening button", "button", "Put aside").click()
        page.until(lambda: "are put aside" in page.status(), "files put aside")
    page.add()
    assert mean_um(workbench.state()) < mean_um(before)


def test_foreign_files_are_guessed_shown_and_opened(start, browser, campaign, tmp_path):
    rows = [line.split(",") for line in (campaign / "data.csv").read_text().splitlines()]
    at = {name: k for k, name in enumerate(rows[0])}
    joints = [f"q{k}" for k in range(1, 7)]
    lines = ["A1;A2;A3;A4;A5;A6;X;Y;Z"]
    for row in rows[1:]:
        degrees = [f"{float(row[at[name]]) * 57.29577951308232:.6f}" for name in joints]
        millimetres = [f"{float(row[at[name]]) * 1000.0:.4f}" for name in "xyz"]
        lines.append(";".join([*degrees, *millimetres]).replace(".", ","))
    foreign = tmp_path / "tracker.csv"
    foreign.write_text("\n".join(lines) + "\n")
    workbench = start("--port", "0")
    browser.look(LAPTOP)
    browser.driver.get(workbench.address)
    page = Page.__new__(Page)
    page.browser, page.address = browser, workbench.address
    choose(page, foreign, campaign / "robot.yaml")
    page.until(lambda: page.by_role("#opening button", "button", "Open"), "button Open")
    page.until(
        lambda: "tracker.csv" in browser.run("return document.getElementById('opening').innerText"), "file"
    )
    page.one("#opening button", "button", "Open").click()
    page.until(lambda: page.by_role("#opening button", "button", "Open with these"), "guesses")
    shown = browser.run("return document.getElementById('opening').innerText")
    assert "The first rows" in shown
    page.one("#opening button", "button", "Open with these").click()
    page.until(page.candidates, "candidates")
    assert workbench.state()["error"]["held_out"]["n"] == len(rows) - 1


def test_refine_can_be_stopped_and_is_available_again(page, workbench):
    page.button("Refine").click()
    page.until(lambda: workbench.state()["busy"] or len(workbench.state()["models"]) > 1, "Refine to begin")
    workbench.do(do="cancel")
    end = time.monotonic() + 60
    while workbench.state()["busy"] and time.monotonic() < end:
        time.sleep(0.05)
    state = workbench.state()
    assert not state["busy"]
    assert state["failure"] == ""
    page.until(lambda: page.button("Refine").is_enabled(), "Refine to be possible again")


def test_refine_pauses_after_a_step_and_goes_on(start, browser, tmp_path):
    armtrue_sim.simulate({**TWO_HIDDEN, "poses": 900}).write(tmp_path)
    workbench = start(tmp_path / "data.csv")
    page = Page(browser, workbench.address)
    page.button("Refine").click()
    page.until(lambda: page.by_role("#pause", "button", "Pause"), "Pause")
    said = page.after(page.one("#pause", "button", "Pause").click)
    assert re.match(r"Paused after [01] steps?; Refine goes on\. The held-out mean error", said)
    half = workbench.state()
    assert not half["busy"]
    assert half["verdict"] != "nothing_missing"
    page.press("Refine")
    page.until(lambda: not workbench.state()["busy"], "end of Refine")
    assert workbench.state()["verdict"] == "nothing_missing"
    assert workbench.do(do="pause") == 400


def test_a_row_marked_as_wrong_is_left_out_and_counted(page, workbench):
    rows = workbench.state()["error"]["held_out"]["n"]
    page.after(lambda: workbench.do(do="leave_out", rows=[5, 9]))
    state = workbench.state()
    assert state["left_out"] == [5, 9]
    assert state["error"]["held_out"]["n"] == rows - 2
    assert "2 rows left out by you: 5, 9." in page.browser.run("return document.body.innerText")
