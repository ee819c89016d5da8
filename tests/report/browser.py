"""Debian's Chromium, driven for tests and screenshots. A browser that is missing is a failure, not a reason to skip."""

from __future__ import annotations

import base64
import shutil
from pathlib import Path
from typing import Any

from selenium.webdriver import Chrome
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

LAPTOP = (1280, 800)
PHONE = (390, 844)
# An A4 sheet less margins of 8 mm.
A4 = (733, 1062)
_SETTLED = """
const done = arguments[arguments.length - 1];
requestAnimationFrame(() => requestAnimationFrame(() => done(true)));
"""


class Browser:
    """A window without network, or with access to 127.0.0.1 only. Sizes are CSS pixels."""

    def __init__(self, *, this_machine: bool = False) -> None:
        programs = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
        missing = [name for name, found in programs.items() if found is None]
        assert not missing, f"{', '.join(missing)} not found: install the packages of tools/packages/test.txt"
        options = Options()
        options.binary_location = str(programs["chromium"])
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        # No sandbox: continuous integration runs as root in a container.
        for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
            options.add_argument(argument)
        if this_machine:
            # Host names do not resolve, and other addresses lead to a proxy that does not exist.
            options.add_argument("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1")
            options.add_argument("--proxy-server=http://127.0.0.1:9")
            options.add_argument("--proxy-bypass-list=127.0.0.1")
        self.driver = Chrome(options=options, service=Service(programs["chromedriver"]))
        self.command("Network.enable")
        offline = {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
        if not this_machine:
            self.command("Network.emulateNetworkConditions", **offline)

    def command(self, name: str, **parameters: Any) -> Any:
        """Send a DevTools command."""
        return self.driver.execute_cdp_cmd(name, parameters)

    def open(
        self,
        page: Path,
        size: tuple[int, int] = LAPTOP,
        *,
        dark: bool = False,
        media: str = "",
        scripts: bool = True,
    ) -> None:
        """Open a file at a size, light or dark, on a screen or as it is printed, with or without scripts."""
        self.look(size, dark=dark, media=media)
        self.command("Emulation.setScriptExecutionDisabled", value=not scripts)
        self.driver.get(page.resolve().as_uri())
        if scripts:
            self.settle()

    def look(self, size: tuple[int, int] = LAPTOP, *, dark: bool = False, media: str = "") -> None:
        """Set the size of the window, emulating a phone for PHONE, and the colour scheme."""
        width, height = size
        phone = size == PHONE
        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2 if phone else 1,
            mobile=phone,
        )
        self.command("Emulation.setTouchEmulationEnabled", enabled=phone)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.command("Emulation.setEmulatedMedia", media=media, features=[scheme])

    def settle(self) -> None:
        """Wait until the page is drawn."""
        self.driver.execute_async_script(_SETTLED)

    def run(self, script: str, *arguments: Any) -> Any:
        """Run a script in the page and return what it returns."""
        return self.driver.execute_script(script, *arguments)

    def picture(self, top: float, height: float, width: int) -> bytes:
        """A PNG of a stretch of the page."""
        clip = {"x": 0, "y": top, "width": width, "height": height, "scale": 1}
        answer = self.command("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
        return base64.b64decode(answer["data"])

    def paper(self) -> bytes:
        """The page as a PDF on A4."""
        answer = self.command(
            "Page.printToPDF",
            printBackground=True,
            preferCSSPageSize=True,
            paperWidth=8.27,
            paperHeight=11.69,
        )
        return base64.b64decode(answer["data"])

    def complaints(self) -> list[str]:
        """Console messages of the page since the last call."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def close(self) -> None:
        """End the browser that this object started."""
        self.driver.quit()
