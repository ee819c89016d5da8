"""The model's error at a row, a region or a time that was left out, and what a restarted server restores."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest
from armtrue import Fit, load_data
from bench_page import Page
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

pytestmark = pytest.mark.full

SAID = (
    r"At the (\d+) rows? left out, the prediction is off by ([\d.]+) µm in the mean and ([\d.]+) µm at most"
)


def leave_out(page: Page, variable: str, low: str, high: str) -> str:
    """Leave out a range by the page's form, as a person does; the new status."""
    page.browser.run("document.getElementById('leave-variable').closest('details').open = true")
    Select(page.browser.driver.find_element(By.ID, "leave-variable")).select_by_value(variable)
    for name, value in (("low", low), ("high", high)):
        page.browser.driver.find_element(By.ID, f"leave-{name}").send_keys(value)
    return page.after(page.one("main button", "button", "Leave out").click)


@pytest.mark.parametrize(("variable", "low", "high"), [("q1", "20", "90"), ("time", "0", "0.5")])
def test_error_at_rows_left_out_is_shown_beside_held_out_error(
    page, workbench, campaign, tmp_path, variable, low, high
):
    said = leave_out(page, variable, low, high)
    state = workbench.state()
    assert page.failure() == ""
    count, mean, largest = re.search(SAID, said).groups()
    figures = state["left_out_error"]
    assert int(count) == figures["n"] == len(state["left_out"]) > 10
    assert float(mean) == pytest.approx(figures["mean_um"], abs=0.051)
    assert float(largest) == pytest.approx(figures["max_um"], abs=0.051)
    assert f"left out by you ({count} rows)" in page.error()
    assert said.split("left out, ")[1] in page.text("left-out")
    # The same figures by the fit.json that the workbench makes, from the data file.
    workbench.do(do="make", name="fit")
    page.until(lambda: not workbench.state()["busy"], "fit.json")
    (tmp_path / "fit.json").write_bytes(workbench.ask(f"{workbench.path}file?name=made").read())
    fit = Fit.load(tmp_path / "fit.json")
    assert not set(fit.data.rows.tolist()) & set(state["left_out"])
    data = load_data(campaign / "data.csv", fit.robot)
    there = data.take(np.isin(data.rows, state["left_out"]))
    errors = 1e6 * np.linalg.norm(there.positions_m - fit.predict(there), axis=1)
    assert figures["mean_um"] == pytest.approx(errors.mean(), rel=1e-9)
    assert figures["max_um"] == pytest.approx(errors.max(), rel=1e-9)
    page.press("Undo")
    assert workbench.state()["left_out_error"] is None
    assert "left out by you" not in page.error()


def test_leaving_out_all_rows_is_refused_and_keeps_the_session(page, workbench):
    before = workbench.state()
    leave_out(page, "time", "-1", "100000")
    assert "found 0 different poses, expected at least 10" in page.failure()
    after = workbench.state()
    for key in ("effects", "error", "left_out", "models"):
        assert after[key] == before[key]
    page.add()


def test_wrong_pose_left_out_has_a_large_prediction_error(start, browser, campaign, tmp_path):
    lines = (campaign / "data.csv").read_text().splitlines()
    head = lines[0].split(",")
    cells = lines[39].split(",")
    cells[head.index("z")] = str(float(cells[head.index("z")]) + 2e-3)
    lines[39] = ",".join(cells)
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    workbench = start(
        tmp_path / "data.csv", "--robot", campaign / "robot.yaml", "--model", campaign / "model.yaml"
    )
    page = Page(browser, workbench.address)
    page.after(lambda: workbench.do(do="leave_out", rows=[40]))
    state = workbench.state()
    assert state["left_out_error"]["n"] == 1
    assert state["left_out_error"]["mean_um"] > 1500.0 > 5 * state["error"]["held_out"]["mean_um"]
    page.add()
    assert workbench.state()["left_out_error"]["n"] == 1, "another model says it anew"


def test_killed_server_restores_planned_poses_and_waiting_files(start, browser, campaign, tmp_path):
    first = start()
    page = Page(browser, first.address)
    page.press_plan()
    planned = page.text("result")
    poses = first.ask(f"{first.path}file?name=result").read()
    assert len(list(csv.reader(poses.decode().splitlines()))) == 13
    head, *rows = (campaign / "test.csv").read_text().splitlines()
    (tmp_path / "new.csv").write_text("\n".join([head, *rows[:30]]) + "\n")
    browser.driver.find_element(By.ID, "files").send_keys(str(tmp_path / "new.csv"))
    page.until(lambda: "new.csv" in page.text("opening"), "file")
    first.kill()
    second = start()
    page = Page(browser, second.address)
    assert page.text("result") == planned
    assert second.ask(f"{second.path}file?name=result").read() == poses
    assert "new.csv" in page.text("opening")
    said = page.after(page.one("#opening button", "button", "Compare with the model").click)
    assert "new.csv: mean error" in said
    page.after(page.one("main button", "button", "Let them join").click)
    page.add()
    joined = second.state()
    second.kill()
    third = start()
    back = third.state()
    for key in ("effects", "error", "models", "steps"):
        assert back[key] == joined[key], key
    assert "measurements joined since" in Page(browser, third.address).text("notes")


def test_session_of_dropped_files_resumes_if_dropped_again(start, browser, campaign):
    def dropped() -> Page:
        workbench = start("--port", "0")
        browser.look()
        browser.driver.get(workbench.address)
        page = Page.__new__(Page)
        page.browser, page.address, page.workbench = browser, workbench.address, workbench
        names = ("data.csv", "robot.yaml", "model.yaml")
        files = "\n".join(str(campaign / name) for name in names)
        browser.driver.find_element(By.ID, "files").send_keys(files)
        page.until(lambda: page.by_role("#opening button", "button", "Open"), "button Open")
        page.until(lambda: all(name in page.text("opening") for name in names), "files")
        page.one("#opening button", "button", "Open").click()
        page.until(page.candidates, "candidates")
        return page

    page = dropped()
    page.add()
    model = page.model()
    page.workbench.kill()
    again = dropped()
    again.until(lambda: "session continues" in again.status(), "word of the session")
    assert again.model() == model
