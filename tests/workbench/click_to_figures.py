"""From a click on Add or Undo to the new figures on the page, at 300, 2000 and 12 000 poses: median and worst.

A table for docs/results.md. `./dev bench workbench` runs it.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import armtrue_sim  # noqa: E402
from bench_page import Page  # noqa: E402
from opened import TWO_HIDDEN, Workbench  # noqa: E402

from tests.report.browser import Browser  # noqa: E402

POSES = (300, 2000, 12000)
PATIENCE_S = 900.0
# Presses a button and answers with the milliseconds until the page has the first figures of the new step, and until
# it has those of all measurements.
PRESS = """
const [selector, place, done] = arguments;
const steps = document.querySelector('[data-piece=waterfall]'), before = steps.innerHTML, start = performance.now();
let first = null;
const look = () => {
  const now = performance.now() - start;
  if (first === null && steps.innerHTML !== before) first = now;
  if (first !== null && !steps.querySelector('.first-figures')) return done([first, now]);
  requestAnimationFrame(look);
};
document.querySelectorAll(selector)[place].click();
requestAnimationFrame(look);
"""
ADD, UNDO = "table[aria-label=Candidates] [data-act=add]", "#button-undo"


def measured(page: Page, actions: int) -> tuple[list[float], list[float], list[float]]:
    """Seconds from click to figures: first figures of Add, those of all measurements, and Undo after each."""
    page.browser.driver.set_script_timeout(300)
    firsts, wholes, undos = [], [], []
    count = len(page.candidates())

    def pressed(selector: str, place: int) -> tuple[float, float]:
        milliseconds = page.browser.driver.execute_async_script(PRESS, selector, place)
        page.until(
            lambda: page.browser.run("return document.body.getAttribute('aria-busy') === 'false'"), "end"
        )
        first, whole = milliseconds
        return first / 1000.0, whole / 1000.0

    for k in range(actions):
        first, whole = pressed(ADD, k % count)
        firsts.append(first)
        wholes.append(whole)
        undos.append(pressed(UNDO, 0)[0])
    return firsts, wholes, undos


def diagnosed_s(page: Page, workbench: Workbench) -> float:
    """Seconds from a click on Add until the diagnosis of the new model is shown too."""
    begun = time.monotonic()
    page.add()
    page.until(lambda: workbench.state()["verdict"] and not workbench.state()["diagnosing"], "verdict")
    return time.monotonic() - begun


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--actions", type=int, default=25, help="presses of Add, and as many of Undo")
    parser.add_argument("--poses", type=int, nargs="*", default=list(POSES))
    given = parser.parse_args()
    print(
        "| poses | Add, first figures: median [s] | worst [s] | of all measurements: median [s] | worst [s] "
        "| Undo: median [s] | worst [s] | with its diagnosis [s] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    browser = Browser(this_machine=True)
    try:
        for poses in given.poses:
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                armtrue_sim.simulate({**TWO_HIDDEN, "poses": poses}).write(folder)
                workbench = Workbench([folder / "data.csv"], folder / "state")
                try:
                    page = Page(browser, workbench.address, patience_s=PATIENCE_S)
                    timed = measured(page, given.actions)
                    whole = diagnosed_s(page, workbench)
                    figures = [f"{statistics.median(s):.2f} | {max(s):.2f}" for s in timed]
                    print(f"| {poses} | {' | '.join(figures)} | {whole:.1f} |", flush=True)
                finally:
                    workbench.kill()
    finally:
        browser.close()


if __name__ == "__main__":
    main()
