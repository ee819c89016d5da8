"""Foreign files: guesses shown as a form beside the first rows, corrected by a button or by hand, and opened."""

from __future__ import annotations

import math

import pytest
from bench_page import Page
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select

from tests.report.browser import LAPTOP

pytestmark = pytest.mark.full


@pytest.fixture
def foreign(campaign, tmp_path):
    """Writes the campaign as an instrument would: degrees and millimetres, semicolons and decimal commas."""

    def write(turned: int = 0, swapped: bool = False):
        head, *rows = [line.split(",") for line in (campaign / "data.csv").read_text().splitlines()]
        at = {name: k for k, name in enumerate(head)}
        axes = "yxz" if swapped else "xyz"
        lines = ["A1;A2;A3;A4;A5;A6;X;Y;Z"]
        for row in rows:
            angles = [math.degrees(float(row[at[f"q{k}"]])) * (-1 if k == turned else 1) for k in range(1, 7)]
            places = [1000.0 * float(row[at[name]]) for name in axes]
            lines.append(";".join(f"{value:.6f}" for value in (*angles, *places)).replace(".", ","))
        path = tmp_path / "tracker.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def empty(start, browser) -> Page:
    """The page of a workbench that was started without files."""
    page = Page.__new__(Page)
    page.workbench = start("--port", "0")
    page.browser, page.address = browser, page.workbench.address
    browser.look(LAPTOP)
    browser.driver.get(page.address)
    return page


@pytest.fixture
def guessed(start, browser, campaign):
    """Drops a foreign file and the arm on an empty workbench, and opens them up to the form of guesses."""

    def drop(path) -> Page:
        page = empty(start, browser)
        browser.driver.find_element(By.ID, "files").send_keys(f"{path}\n{campaign / 'robot.yaml'}")
        page.until(lambda: page.by_role("#opening button", "button", "Open"), "files")[0].click()
        page.until(lambda: page.by_role("#opening button", "button", "Open with these"), "guesses")
        return page

    return drop


def opened_mean_um(page: Page) -> float:
    """Open the files as the form has them; the held-out mean error of the first model."""
    page.with_one("#opening button", "button", "Open with these", WebElement.click)
    page.until(page.candidates, "candidates")
    return float(page.workbench.state()["error"]["held_out"]["mean_um"])


@pytest.fixture
def right_um(guessed, foreign) -> float:
    """Held-out mean error with the correct file. Its workbench is killed, so that another may open the same session."""
    page = guessed(foreign())
    mean_um = opened_mean_um(page)
    page.workbench.kill()
    return mean_um


def shown(page: Page, label: str) -> str:
    """The value of a field of the form."""
    return str(page.with_one("#opening select", "combobox", label, lambda e: e.get_attribute("value")))


def choose(page: Page, label: str, value: str) -> None:
    page.with_one("#opening select", "combobox", label, lambda e: Select(e).select_by_value(value))


def test_form_shows_separator_units_columns_and_first_rows(guessed, foreign):
    page = guessed(foreign())
    assert shown(page, "separator") == "semicolon"
    assert shown(page, "decimal") == ","
    assert (shown(page, "A1 is"), shown(page, "unit of A1")) == ("q1", "deg")
    assert (shown(page, "Z is"), shown(page, "unit of Z")) == ("z", "mm")
    first = foreign().read_text().splitlines()[1].split(";")
    assert all(cell in page.text("opening") for cell in first)
    page.with_one("#opening button", "button", "Open with these", WebElement.click)
    page.until(page.candidates, "candidates")


def test_reversed_joint_is_found_and_corrected_by_a_button(guessed, foreign, right_um):
    page = guessed(foreign(turned=3))
    assert "joint 3 turns the other way" in page.text("opening")
    page.one("#opening button", "button", "Mend this").click()
    page.until(lambda: "joint 3 turns the other way" not in page.text("opening"), "mended file")
    assert opened_mean_um(page) == pytest.approx(right_um, rel=1e-6)


def test_wrongly_named_columns_are_corrected_in_the_form(guessed, foreign, right_um):
    page = guessed(foreign(swapped=True))
    choose(page, "X is", "y")
    page.with_one("#opening button", "button", "Open with these", WebElement.click)
    assert "two columns that are y" in page.until(page.failure, "sentence")
    assert shown(page, "X is") == "y", "what was chosen stays"
    choose(page, "Y is", "x")
    assert opened_mean_um(page) == pytest.approx(right_um, rel=1e-6)


def test_picture_shows_that_a_reversed_joint_misses_the_points(guessed, foreign):
    page = guessed(foreign(turned=3))
    (picture,) = page.by_role("#opening svg", "image")
    assert "does not reach its points" in picture.accessible_name
    page.one("#opening button", "button", "Mend this").click()
    page.until(lambda: "The arm reaches its points" in page.text("opening"), "arm among its points")


def test_changed_form_survives_a_killed_server(guessed, foreign, start, browser, right_um):
    page = guessed(foreign(swapped=True))
    choose(page, "X is", "y")
    page.until(lambda: page.workbench.drafted("X", "is") == "y", "draft of what cannot be checked")
    choose(page, "Y is", "x")
    page.until(lambda: "The arm reaches its points" in page.text("opening"), "form that is followed")
    page.workbench.kill()
    again = empty(start, browser)
    again.until(lambda: again.by_role("#opening button", "button", "Open with these"), "guesses")
    assert (shown(again, "X is"), shown(again, "Y is")) == ("y", "x")
    assert "tracker.csv" in again.text("opening")
    assert opened_mean_um(again) == pytest.approx(right_um, rel=1e-6)


def test_check_and_picture_follow_the_chosen_units(guessed, foreign, right_um):
    page = guessed(foreign())
    for axis in "XYZ":
        choose(page, f"unit of {axis}", "in")
    page.until(lambda: "millimetres, read as inches" in page.text("opening"), "finding")
    assert "does not reach its points" in page.text("opening")
    assert [shown(page, f"unit of {axis}") for axis in "XYZ"] == ["in"] * 3
    for axis in "XYZ":
        choose(page, f"unit of {axis}", "mm")
    page.until(lambda: "The arm reaches its points" in page.text("opening"), "picture")
    assert opened_mean_um(page) == pytest.approx(right_um, rel=1e-6)


def test_correction_by_button_keeps_changes_made_in_the_form(guessed, foreign):
    page = guessed(foreign(turned=3))
    choose(page, "unit of X", "m")
    page.one("#opening button", "button", "Mend this").click()
    page.until(lambda: "joint 3 turns the other way" not in page.text("opening"), "mended file")
    assert shown(page, "unit of X") == "m"


def test_foreign_file_is_compared_with_the_session_by_its_form(start, browser, campaign, foreign, tmp_path):
    model = tmp_path / "geometry.yaml"
    model.write_text("effects: [base_frame, tool_offset, joint_offset, link_geometry]\n")
    opened = start(campaign / "data.csv", "--robot", campaign / "robot.yaml", "--model", model)
    page = Page(browser, opened.address)
    page.browser.driver.find_element(By.ID, "files").send_keys(str(foreign(turned=3)))
    page.until(lambda: "tracker.csv" in page.text("opening"), "file")
    page.one("#opening button", "button", "Compare with the model").click()
    page.until(lambda: page.by_role("#opening button", "button", "Mend this"), "guesses")[0].click()
    page.until(lambda: "It is mended" in page.status(), "mended file")
    said = page.after(page.one("#opening button", "button", "Compare with the model").click)
    assert page.failure() == ""
    assert "tracker.csv: mean error" in said
    assert "as was to be expected" in said
