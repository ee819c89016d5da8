"""Pictures of a report for docs/screenshots: laptop, dark, phone and paper. `./dev screenshots` runs it."""

from __future__ import annotations

import argparse
import io
import subprocess
import tempfile
from pathlib import Path

import armtrue_sim
from armtrue import Fit, fit, load_data, load_model, load_robot, refine
from armtrue.report import write
from browser import LAPTOP, PHONE, Browser
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = ROOT / "sim" / "scenarios"
SCENARIO = SCENARIOS / "cobot-two-effects.yaml"
STRUCTURE = SCENARIOS / "foreign-heat-times-joint.yaml"
# Section, how it is shown, and the height of the picture in CSS pixels; None: the whole section.
SHOTS = {
    "top-light": ("header", LAPTOP, False, 1180),
    "vectors-dark": ("#vectors", LAPTOP, True, None),
    "state-light": ("#state", LAPTOP, False, 1000),
    "spectra-dark": ("#spectra", LAPTOP, True, None),
    "candidates-light": ("#candidates", LAPTOP, False, 1150),
    "added-dark": ("#added", LAPTOP, True, None),
    "top-phone": ("header", PHONE, False, 1400),
    "vectors-phone": ("#vectors", PHONE, True, 880),
    "candidates-phone": ("#candidates", PHONE, False, 1080),
}
# Of an arm with an error that no effect names.
SHOTS_OF_STRUCTURE = {"unexplained-light": ("#unexplained", LAPTOP, False, None)}
PLACE = """const box = document.querySelector(arguments[0]).getBoundingClientRect();
return [box.top + scrollY, box.height];"""
LARGEST_BYTES = 300_000


def made_report(folder: Path, scenario: Path) -> Path:
    """The report of a simulated arm, believed model and refined."""
    armtrue_sim.cli_simulate(scenario, folder)
    robot = load_robot(folder / "robot.yaml")
    believed = fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))
    refined, _ = refine(believed)
    fits: list[Fit] = [believed, refined]
    for step, name in zip(fits, ("believed", "refined"), strict=True):
        step.save(folder / f"{name}.json")
    write(fits, folder / "report.html")
    return folder / "report.html"


def save(picture: bytes, path: Path) -> None:
    """Write a PNG that is small enough for a repository."""
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(128).save(path, optimize=True)
    size = path.stat().st_size
    assert size < LARGEST_BYTES, f"{path}: found {size} bytes, expected fewer than {LARGEST_BYTES}"


def shoot(
    browser: Browser, page: Path, shots: dict[str, tuple[str, tuple[int, int], bool, int | None]], out: Path
) -> None:
    """Make pictures of a page."""
    for name, (selector, size, dark, height) in shots.items():
        browser.open(page, size, dark=dark)
        box = browser.run(PLACE, selector)
        save(browser.picture(box[0], height or box[1], size[0]), out / f"{name}.png")


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "screenshots")
    parser.add_argument("--page", type=Path, help="a report that is there already")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        page = given.page or made_report(Path(scratch) / "effects", SCENARIO)
        browser = Browser()
        try:
            shoot(browser, page, SHOTS, given.out)
            if given.page is None:
                structure = made_report(Path(scratch) / "structure", STRUCTURE)
                shoot(browser, structure, SHOTS_OF_STRUCTURE, given.out)
            browser.open(page)
            paper = Path(scratch) / "report.pdf"
            paper.write_bytes(browser.paper())
        finally:
            browser.close()
        prefix = Path(scratch) / "sheet"
        subprocess.run(["pdftoppm", "-r", "80", "-f", "1", "-l", "3", "-png", paper, prefix], check=True)
        pages = [Image.open(path) for path in sorted(Path(scratch).glob("sheet-*.png"))]
        wide = Image.new(
            "RGB", (sum(p.width for p in pages) + 12 * (len(pages) - 1), pages[0].height), "#888"
        )
        left = 0
        for sheet in pages:
            wide.paste(sheet, (left, 0))
            left += sheet.width + 12
        stream = io.BytesIO()
        wide.save(stream, format="png")
        save(stream.getvalue(), given.out / "paper.png")


if __name__ == "__main__":
    main()
