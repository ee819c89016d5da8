"""Pictures of the workbench for docs/screenshots, and the film strip of the README. `./dev screenshots` runs it."""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import armtrue_sim  # noqa: E402
from bench_page import Page  # noqa: E402
from opened import TWO_HIDDEN, Workbench  # noqa: E402
from PIL import Image  # noqa: E402

from tests.report.browser import PHONE, Browser  # noqa: E402

WINDOW = (1280, 860)
FRAME_WIDTH = 900
FRAME_MS = 2200
LARGEST_BYTES = 2_000_000


def frame(browser: Browser, size: tuple[int, int] = WINDOW) -> Image.Image:
    """What the window shows."""
    time.sleep(1.2)  # bars glide to their new lengths, and the picture in space is drawn
    browser.settle()
    return Image.open(io.BytesIO(browser.picture(0, size[1], size[0]))).convert("RGB")


def save_film(frames: list[Image.Image], path: Path) -> None:
    """An animated PNG of the frames in few colours."""
    small = [image.resize((FRAME_WIDTH, round(FRAME_WIDTH * image.height / image.width))) for image in frames]
    few = [image.quantize(64) for image in small]
    few[0].save(
        path, format="png", save_all=True, append_images=few[1:], duration=FRAME_MS, loop=0, optimize=True
    )
    assert path.stat().st_size < LARGEST_BYTES, f"{path}: {path.stat().st_size} bytes"


def look_at_a_variable(page: Page) -> None:
    """Show the residual against a joint, with some poses selected."""
    run = page.browser.run
    run("document.querySelector('details[data-panel=state]').open = true")
    page.until(lambda: run("return document.querySelector('#looking') !== null"), "chart")
    run(
        "const choose = document.getElementById('look-variable'); choose.value = 'q3'; "
        "choose.dispatchEvent(new Event('change'))"
    )
    page.until(
        lambda: run("return document.querySelector('.look-figure title').textContent.includes('joint 3')"),
        "q3",
    )
    run(
        "document.getElementById('brush-low').value = -60; document.getElementById('brush-high').value = -20; "
        "document.querySelector('[data-look=select]').click(); "
        "document.querySelector('details[data-panel=state]').scrollIntoView()"
    )
    time.sleep(1.0)


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "screenshots")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        armtrue_sim.simulate(TWO_HIDDEN).write(folder)
        workbench = Workbench([folder / "data.csv"], folder / "state")
        browser = Browser(this_machine=True)
        try:
            page = Page(browser, workbench.address, WINDOW)
            frames = [frame(browser)]
            frames[0].quantize(128).save(given.out / "workbench.png", optimize=True)
            page.browser.driver.execute_script("document.querySelector('[data-act=card]').click()")
            page.until(lambda: page.by_role("#card button", "button", "Close"), "card")
            frame(browser).quantize(128).save(given.out / "workbench-card.png", optimize=True)
            page.one("#card button", "button", "Close").click()
            look_at_a_variable(page)
            picture = Image.open(io.BytesIO(browser.driver.get_screenshot_as_png())).convert("RGB")
            picture.quantize(128).save(given.out / "workbench-looking.png", optimize=True)
            browser.run("document.querySelector('details[data-panel=state]').open = false")
            for _ in range(2):
                page.add()
                browser.run("scrollTo(0, 0)")
                frames.append(frame(browser))
            save_film(frames, given.out / "workbench-film.png")
            browser.look(PHONE)
            frame(browser, (PHONE[0], 1400)).resize((PHONE[0], 1400)).quantize(128).save(
                given.out / "workbench-phone.png", optimize=True
            )
        finally:
            browser.close()
            workbench.kill()


if __name__ == "__main__":
    main()
