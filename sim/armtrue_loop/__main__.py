"""python -m armtrue_loop [SCENARIO] --out DIR [--mode inline|offset]: the loop, where there is a bus."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from rich.console import Console

from armtrue_loop.figures import Figures, draw, section_of, table_of
from armtrue_loop.story import Story
from armtrue_loop.toolbox import Toolbox

DEFAULT_SCENARIO = Path(__file__).with_name("scenarios") / "warm-eccentric-gear.yaml"


def _conclude(figures: Figures, out: Path, console: Console) -> None:
    console.print(table_of(figures))
    console.print(
        "mean, rms, max: as the tracker measured; exact: the mean without its noise, which only the simulator knows; "
        "double: the exact mean that double precision would have reached; ratio: exact over double\n"
    )
    last = figures.steps[-1]
    console.print(
        f"hidden: {', '.join(figures.hidden)}; found: {', '.join(figures.found) or 'nothing'}; at the end: "
        f"{figures.verdict.replace('_', ' ')}"
    )
    following, again = figures.worst_following_increments, figures.repeated_moves
    console.print(
        f"{figures.cycles} cycles over CAN ({figures.mode}) in {figures.seconds:.0f} s; largest following error that "
        f"the controller saw: {following} increments; moves made again: {again}"
    )
    console.print(f"picture: {', '.join(map(str, draw(figures, out)))}; report: {out / 'report.html'}")
    console.print(
        f"\nmeasured tool error {last.measured.mean_um:.1f} µm beside a noise floor of {figures.noise_floor_um:.1f} µm",
        style="bold",
    )


def main() -> int:
    """Run; exit status 1 if the loop misses what it must show."""
    parser = argparse.ArgumentParser(
        prog="armtrue_loop", description="The loop closed in software, over CAN."
    )
    parser.add_argument("scenario", type=Path, nargs="?", default=DEFAULT_SCENARIO)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--mode", choices=("inline", "offset"), default="inline")
    parser.add_argument(
        "--move-cycles", type=int, default=12, help="control cycles a move takes (default %(default)s)"
    )
    arguments = parser.parse_args()
    width = int(os.environ.get("COLUMNS", "120"))
    console = Console(width=width, highlight=False, soft_wrap=True)
    live = console.is_terminal and not console.is_dumb_terminal
    chapters = 0

    def chapter(title: str) -> None:
        nonlocal chapters
        chapters += 1
        console.print(f"\n{chapters}  {title}", style="bold")

    def progress(stage: str, done: int, total: int) -> None:
        if live or done == total:
            end = "\n" if done == total else "\r"
            console.print(f"measuring over CAN, {stage}: {done} of {total} poses", end=end)

    def say(command: str) -> None:
        console.print(command, style="cyan", markup=False)

    with Toolbox() as tools:
        story = Story(
            arguments.scenario, arguments.out, arguments.mode, tools, chapter, say, progress, arguments.move_cycles
        )  # fmt: skip
        figures = story.run()
    chapter("how the error fell")
    _conclude(figures, arguments.out, console)
    (arguments.out / "tool-error.md").write_text(section_of(figures) + "\n", encoding="utf-8")
    shortcomings = figures.shortcomings()
    for shortcoming in shortcomings:
        print(f"armtrue_loop: {shortcoming}", file=sys.stderr)
    return 1 if shortcomings else 0


if __name__ == "__main__":
    sys.exit(main())
