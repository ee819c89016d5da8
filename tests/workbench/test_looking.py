"""The residual against any variable, poses brushed on a chart and ringed on the arm, effects added from peaks."""

from __future__ import annotations

import csv
import json
import re
import shutil

import numpy as np
import pytest
from armtrue.cli.conftest import run_forked
from bench_page import Page
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select

from tests.report.browser import LAPTOP, PHONE

pytestmark = pytest.mark.full

RINGS = "return (document.querySelector('{} .ringed')?.getAttribute('d') || '').split('M').length - 1"
ON_THE_CHART, ON_THE_ARM = RINGS.format(".look-figure"), RINGS.format(".stage")


def open_part(page: Page, name: str) -> None:
    """Unfold a part of the page and bring it into sight."""
    page.browser.run(f"document.querySelector('details[data-panel={name}]').open = true")
    page.until(
        lambda: page.browser.run(
            f"return document.querySelector('details[data-panel={name}] figure') !== null"
        ),
        name,
    )
    page.browser.run(
        f"document.querySelector('details[data-panel={name}] figure').scrollIntoView({{block: 'center'}})"
    )


def choose(page: Page, what: str, value: str) -> None:
    """Choose the variable or the direction, and wait for its chart."""
    chart = page.browser.driver.find_element(By.CSS_SELECTOR, ".look-figure svg")
    Select(page.browser.driver.find_element(By.ID, f"look-{what}")).select_by_value(value)
    page.until(
        lambda: page.browser.driver.find_element(By.CSS_SELECTOR, ".look-figure svg") != chart, "other chart"
    )
    page.browser.run("document.querySelector('.look-figure').scrollIntoView({block: 'center'})")


@pytest.fixture
def named(campaign, tmp_path):
    """The campaign with a column of unknown meaning."""
    shutil.copytree(campaign, folder := tmp_path / "named")
    lines = (folder / "data.csv").read_text().splitlines()
    rows = [f"{lines[0]},humidity", *(f"{line},{40 + k % 7}" for k, line in enumerate(lines[1:]))]
    (folder / "data.csv").write_text("\n".join(rows) + "\n")
    return folder / "data.csv"


def test_variable_that_shows_most_is_first_others_can_be_chosen(start, browser, named):
    page = Page(browser, start(named).address)
    open_part(page, "state")
    options = [o.text for o in Select(browser.driver.find_element(By.ID, "look-variable")).options]
    assert options[0].startswith("direction joint 2 came from")
    for wanted in (
        "joint 1 [°]",
        "motor angle 3 [°]",
        "humidity",
        "temperature",
        "gravity torque",
        "reflector's z",
    ):
        assert any(option.startswith(wanted) for option in options), wanted
    choose(page, "variable", "humidity")
    choose(page, "direction", "motor1")
    words = browser.run("return document.getElementById('looking').innerText")
    assert "error as joint 1" in words
    assert "no trend" in words.lower()
    assert browser.complaints() == []


def test_poses_brushed_on_a_chart_are_ringed_and_can_be_left_out(page, workbench):
    open_part(page, "state")
    choose(page, "variable", "q3")
    figure = page.browser.driver.find_element(By.CSS_SELECTOR, ".look-figure svg")
    ActionChains(page.browser.driver).move_to_element_with_offset(
        figure, -60, 0
    ).click_and_hold().move_by_offset(120, 0).release().perform()
    ringed = page.until(lambda: page.browser.run(ON_THE_CHART), "rings on the chart")
    assert page.browser.run(ON_THE_ARM) >= ringed > 10
    before = workbench.state()["error"]["held_out"]["n"]
    page.after(page.one("#looking button", "button", "Leave these out").click)
    left_out = workbench.state()["left_out"]
    assert len(left_out) >= ringed
    assert workbench.state()["error"]["held_out"]["n"] == before - len(left_out)


def test_poses_are_selected_with_the_keyboard(page):
    open_part(page, "state")
    for name, value in (("low", "-1"), ("high", "0")):
        page.browser.driver.find_element(By.ID, f"brush-{name}").send_keys(value)
    page.one("#looking button", "button", "Select").send_keys(Keys.ENTER)
    assert page.until(lambda: page.browser.run(ON_THE_CHART), "rings") > 10


def test_values_under_the_pointer_are_shown(page):
    open_part(page, "state")
    chart = page.browser.driver.find_element(By.CSS_SELECTOR, ".look-figure svg")
    read = "return document.querySelector('#looking .readout').textContent"

    def swept() -> str:
        for x in range(-300, 300, 6):
            ActionChains(page.browser.driver, duration=5).move_to_element_with_offset(chart, x, -60).perform()
            if said := page.browser.run(read):
                return str(said)
        return ""

    assert swept().startswith("Row ")
    open_part(page, "spectra")
    spectrum = page.browser.driver.find_element(By.CSS_SELECTOR, "details[data-panel=spectra] svg")
    ActionChains(page.browser.driver).move_to_element(spectrum).perform()
    said = page.browser.run(
        "return document.querySelector('details[data-panel=spectra] .values').textContent"
    )
    assert said.startswith("cycles a turn of joint 1, logarithmic: ")


def test_poses_framed_on_the_arm_are_ringed_on_the_chart(page):
    open_part(page, "state")
    page.browser.run("document.querySelector('.stage').scrollIntoView({block: 'center'})")
    stage = page.browser.driver.find_element(By.CSS_SELECTOR, ".stage")
    ActionChains(page.browser.driver).key_down(Keys.CONTROL).move_to_element_with_offset(
        stage, -120, -90
    ).click_and_hold().move_by_offset(200, 150).release().key_up(Keys.CONTROL).perform()
    framed = page.until(lambda: page.browser.run(ON_THE_ARM), "rings on the arm")
    assert framed >= page.browser.run(ON_THE_CHART) > 0
    assert f"Mark {framed} rows as wrong" in page.browser.run(
        "return document.getElementById('mark').textContent"
    )


def test_mark_button_names_the_row_that_is_read_out(page, workbench):
    said = "return document.querySelector('.scene-part .readout').textContent"
    offered = "return document.getElementById('mark').textContent"
    page.until(lambda: page.by_role(".scene-part button", "button", "Next worst"), "arm")
    open_part(page, "certainty")
    for _ in range(3):
        before = page.browser.run(said)
        page.one(".scene-part button", "button", "Next worst").click()
        page.until(lambda before=before: page.browser.run(said) != before, "the next one")
        row = re.match(r"Row (\d+): ", page.browser.run(said))[1]
        assert page.browser.run(offered) == f"Mark row {row} as wrong"
    other = page.browser.driver.find_element(By.CSS_SELECTOR, "details[data-panel=certainty] .stage")
    other.send_keys("n")
    page.browser.settle()
    assert page.browser.run(offered) == f"Mark row {row} as wrong", "another picture marks nothing"
    page.after(page.one("#mark", "button", f"Mark row {row} as wrong").click)
    assert workbench.state()["left_out"] == [int(row)]


def test_selected_row_stays_while_the_pointer_moves(page):
    said = "return document.querySelector('.scene-part .readout').textContent"
    page.until(lambda: page.by_role(".scene-part button", "button", "Next worst"), "arm")
    page.one(".scene-part button", "button", "Next worst").click()
    row = page.until(lambda: re.match(r"Row \d+", page.browser.run(said)), "row")[0]
    stage = page.browser.driver.find_element(By.CSS_SELECTOR, ".scene-part .stage")
    for x in range(-80, 80, 8):
        ActionChains(page.browser.driver, duration=5).move_to_element_with_offset(stage, x, x // 2).perform()
    assert page.browser.run(said).startswith(row)
    assert row.lower() in page.browser.run("return document.getElementById('mark').textContent")


def test_peak_of_a_spectrum_can_be_added_as_an_effect(page, workbench):
    page.add()  # without lost motion the eccentric gear stands out
    open_part(page, "spectra")
    peak = page.until(
        lambda: [
            b for b in page.by_role("details[data-panel=spectra] button", "button") if "joint 3" not in b.text
        ],
        "peak",
    )[0]
    name = peak.text.removeprefix("Add ").split(":")[0]
    page.after(peak.click)
    assert page.model()[-1].startswith(name)
    assert len(workbench.state()["steps"]) == 3


def test_prediction_uncertainty_is_shown_by_position(page):
    open_part(page, "certainty")
    words = page.browser.run("return document.querySelector('details[data-panel=certainty]').innerText")
    median, largest = (
        float(figure) for figure in re.search(r"Median ([\d.]+) µm, largest ([\d.]+) µm", words).groups()
    )
    assert 0.0 < median < largest
    assert len(page.by_role("details[data-panel=certainty] figure svg", "image")) == 3


def test_uncertainty_drawn_on_the_arm_equals_that_of_predict(page, workbench, campaign, tmp_path):
    open_part(page, "certainty")
    scene = json.loads(
        page.browser.run(
            "return document.querySelector('details[data-panel=certainty] .viewer script').textContent"
        )
    )
    drawn = np.linalg.norm(np.reshape(scene["vectors"][0], (-1, 3)) / 10.0, axis=1)
    workbench.do(do="make", name="fit")
    page.until(lambda: not workbench.state()["busy"], "fit.json")
    (tmp_path / "fit.json").write_bytes(workbench.ask(f"{workbench.path}file?name=made").read())
    words = ["predict", "fit.json", str(campaign / "data.csv"), "--uncertainty", "--out", "p.csv"]
    run_forked(*words, cwd=tmp_path).check_returncode()
    with (tmp_path / "p.csv").open() as stream:
        rows = [
            {name: float(row[name]) for name in ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")}
            for row in csv.DictReader(stream)
        ]
    expected = [
        1e6
        * np.sqrt(
            np.linalg.eigvalsh(
                [
                    [c["cxx"], c["cxy"], c["cxz"]],
                    [c["cxy"], c["cyy"], c["cyz"]],
                    [c["cxz"], c["cyz"], c["czz"]],
                ]
            )[-1]
        )
        for c in rows
    ]
    assert len(drawn) == len(expected)
    assert drawn == pytest.approx(np.array(expected), abs=0.1)
    starts = "document.querySelector('details[data-panel=certainty] .stage .start').getAttribute('d')"
    picture = f"return {starts}.split('M').length - 1"
    assert page.until(lambda: page.browser.run(picture), "picture") == len(expected)
    page.browser.driver.find_element(By.CSS_SELECTOR, "details[data-panel=certainty] .stage").send_keys("n")
    said = "return document.querySelector('details[data-panel=certainty] .viewer .readout').textContent"
    assert page.until(lambda: "standard deviation" in page.browser.run(said), "reading")


@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_visible_text_of_charts_is_at_least_12_px(browser, workbench, size):
    page = Page(browser, workbench.address, size)
    parts = browser.run(
        "return [...document.querySelectorAll('details[data-panel]')].map((d) => d.dataset.panel)"
    )
    for name in parts:
        browser.run(f"document.querySelector('details[data-panel={name}]').open = true")
    page.until(
        lambda: browser.run(
            "return [...document.querySelectorAll('.panel-slot')]"
            ".every((e) => e.innerHTML && !e.hasAttribute('aria-busy'))"
        ),
        "all parts",
    )
    page.press_plan()
    browser.driver.find_element(By.CSS_SELECTOR, "[data-act=card]").click()
    page.until(lambda: browser.run("return document.querySelectorAll('#card svg').length > 1"), "evidence")
    small = browser.run("""
        return [...document.querySelectorAll('svg text')].filter((t) => t.checkVisibility()).map((t) => {
            const chart = t.closest('svg[viewBox]:not(svg svg)');
            const scale = chart.getBoundingClientRect().width / chart.viewBox.baseVal.width;
            return [t.textContent, scale * parseFloat(getComputedStyle(t).fontSize)];
        }).filter((found) => found[1] < 11.9)""")
    assert small == []
    assert browser.run("return document.querySelectorAll('svg text').length") > 150
