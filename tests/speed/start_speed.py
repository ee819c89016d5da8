"""Processor time that the command takes to answer before any work: other load on the machine is not in it."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys

RUNS = 15


def main() -> None:
    """Print the table."""
    print("| | least [ms] | median [ms] |\n|---|---|---|")
    for argument in ("--version", "--help"):
        times = []
        for _ in range(RUNS):
            before = os.times()
            subprocess.run([sys.executable, "-m", "armtrue", argument], check=True, capture_output=True)
            after = os.times()
            used = after.children_user + after.children_system
            times.append(1e3 * (used - before.children_user - before.children_system))
        print(
            f"| `armtrue {argument}`, processor | {min(times):.0f} | {statistics.median(times):.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
