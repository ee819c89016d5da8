"""Clones HEAD into an empty folder, times `./dev demo` and `./dev test` there, and prints a table of each."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DEMO_S, TEST_S, TEST_AGAIN_S = 210, 720, 480
STEP = re.compile(r"^  (\d\d-\S+) (\d+) s, (\d+) s of processor$", re.MULTILINE)


def clone(folder: Path) -> Path:
    """A clone without virtual environment and build, in which real measurements are where tests look for them."""
    subprocess.run(["git", "clone", "-q", ROOT, folder / "armtrue"], check=True)
    shared = ROOT.parent / "shared"
    if shared.is_dir():
        (folder / "shared").symlink_to(shared)
    return folder / "armtrue"


def timed(checkout: Path, command: str) -> tuple[float, str]:
    """Seconds that `./dev COMMAND` took, and what it printed. Ends the program where it failed."""
    begin = time.monotonic()
    run = subprocess.run(
        ["./dev", command],
        cwd=checkout,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "CCACHE_DISABLE": "1"},
    )
    took = time.monotonic() - begin
    if run.returncode != 0:
        print(run.stdout[-4000:], file=sys.stderr)
        sys.exit(f"from_a_clone: ./dev {command} ended with status {run.returncode}")
    return took, run.stdout


def main() -> None:
    """Print the tables."""
    print("| | goal [s] | took [s] |\n|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="armtrue-clone-") as name:
        took, _ = timed(clone(Path(name)), "demo")
        print(f"| `./dev demo` | {DEMO_S} | {took:.0f} |", flush=True)
    with tempfile.TemporaryDirectory(prefix="armtrue-clone-") as name:
        checkout = clone(Path(name))
        for again, goal in (("", TEST_S), (", again", TEST_AGAIN_S)):
            took, printed = timed(checkout, "test")
            print(f"| `./dev test`{again} | {goal} | {took:.0f} |", flush=True)
    print("\n| step of `./dev test` | wall [s] | processor [s] |\n|---|---|---|")
    for step, wall, processor in STEP.findall(printed):
        print(f"| {step} | {wall} | {processor} |")


if __name__ == "__main__":
    main()
