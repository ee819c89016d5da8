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
