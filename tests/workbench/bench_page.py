"""The page, its elements found by the roles and names of the contract, as a person or a screen reader finds them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement

from tests.report.browser import LAPTOP, Browser

_PATIENCE_S = 120.0


class Page:
    """The workbench in a browser's tab. Elements are found by the roles and names that Chromium computes."""

    patience_s = _PATIENCE_S

    def __init__(
        self, browser: Browser, address: str, size: tuple[int, int] = LAPTOP, patience_s: float = _PATIENCE_S
    ) -> None:
        self.browser, self.patience_s = browser, patience_s
        self.address = address
        browser.look(size)
        browser.driver.get(address)
        browser.complaints()  # discards those of an earlier page
        self.until(lambda: self.candidates(), "candidates")

    def until(self, true: Callable[[], Any], what: str) -> Any:
        """Wait until `true` returns something true, and return that."""
        end = time.monotonic() + self.patience_s
        while time.monotonic() < end:
            if found := true():
                return found
            time.sleep(0.02)
        raise AssertionError(
            f"no {what} within {self.patience_s} s; the page says: {self.status()} {self.failure()}"
        )

    def by_role(self, tags: str, role: str, name: str | None = None) -> list[WebElement]:
        """Elements of a role, and of a name if given. Searched again if the page replaces one of them meanwhile."""
        while True:
            found = self.browser.driver.find_elements(By.CSS_SELECTOR, tags)
            try:
                return [
                    e for e in found if e.aria_role == role and (name is None or e.accessible_name == name)
                ]
            except StaleElementReferenceException:
                continue

    def one(self, tags: str, role: str, name: str) -> WebElement:
        """The one element of a role and name."""
        found = self.by_role(tags, role, name)
        assert len(found) == 1, f"found {len(found)} elements of role {role} named {name}, expected one"
        return found[0]

    def with_one(self, tags: str, role: str, name: str, act: Callable[[WebElement], Any]) -> Any:
        """`act` on the one element of a role and name; searched again if the page replaces it meanwhile."""
        while True:
            try:
                return act(self.one(tags, role, name))
            except StaleElementReferenceException:
                continue

    def button(self, name: str) -> WebElement:
        """A button of the page's header."""
        return self.one("header button", "button", name)

    def press(self, name: str) -> None:
        """Press a button of the page's header and wait for the new status."""
        self.after(self.button(name).click)

    def press_plan(self) -> str:
        """Press Plan poses, and return the new status."""
        return self.after(self.one("main button", "button", "Plan poses").click)

    def after(self, act: Callable[[], None]) -> str:
        """Call `act`, wait for a new status or a failure, and return the status."""
        before = self.status()
        act()
        self.until(lambda: self.status() != before or self.failure(), "word of what was done")
        return self.status()

    def status(self) -> str:
        """What the last action did to the error."""
        return str(self.browser.run("return document.querySelector('[role=status]').textContent"))

    def failure(self) -> str:
        """What went wrong, if anything."""
        return str(self.browser.run("return document.querySelector('[role=alert]').textContent"))

    def text(self, piece: str) -> str:
        """The text of a piece of the page."""
        return str(self.browser.run(f"return document.querySelector('[data-piece={piece}]').innerText"))

    def candidates(self) -> list[str]:
        """Texts of the rows of the table of candidates."""
        rows = "return [...document.querySelectorAll('table[aria-label=Candidates] tbody tr')].map((r) => r.innerText)"
        return [str(row) for row in self.browser.run(rows)]

    def add(self, place: int = 0) -> str:
        """Press Add in a row, the first is 0, as soon as there are candidates."""
        self.until(self.candidates, "candidates")
        table = self.one("table", "table", "Candidates")
        row = table.find_elements(By.CSS_SELECTOR, "tbody tr")[place]
        buttons = [b for b in row.find_elements(By.TAG_NAME, "button") if b.accessible_name == "Add"]
        return self.after(buttons[0].click)

    def model(self) -> list[str]:
        """Names of the entries of the model."""
        entries = self.one("ul", "list", "Model").find_elements(By.TAG_NAME, "li")
        return [entry.find_element(By.CSS_SELECTOR, "span").text for entry in entries]

    def remove(self, name: str) -> str:
        """Press Remove beside an entry of the model."""
        entries = self.one("ul", "list", "Model").find_elements(By.TAG_NAME, "li")
        entry = next(e for e in entries if e.text.startswith(name))
        return self.after(entry.find_element(By.CSS_SELECTOR, "[data-act=remove]").click)

    def error(self) -> str:
        """The text of the region Error."""
        return self.one("section", "region", "Error").text
