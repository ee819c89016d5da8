"""Runs the fault campaigns of tools/test.d/15-faults.full.sh and prints their counts as three tables.

python tests/firmware/faults/faults_report.py BUILD: the tables on standard output, the campaigns' output on
standard error. Exit status 1 if one of them failed.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

SOAK_HOURS = {
    "inline, asynchronous": ["3600", "1", "1"],
    "inline, synchronous": ["3600", "2", "1", "sync"],
    "offset, asynchronous": ["3600", "3", "1", "async", "offset"],
    "offset, synchronous": ["3600", "4", "1", "sync", "offset"],
}
DRIVE_HOURS = {"inline mode": ["3600", "1", "inline"], "offset mode": ["3600", "1", "offset"]}
TRANSFERS_OF_A_SIZE = 4  # there and back, segmented and in blocks

# Pattern of a count in a campaign's output, and the text of its row.
COUNTED = (
    (r"single power cuts: (\d+)",
     "power cut at every flash operation of commit, activate, confirm and revert: six histories, four "
     "programs, two image sizes, six ways to be cut, three seeds"),
    (r"power cuts of a 16 KiB table: (\d+)", "the same at every operation of a 16 KiB table"),
    (r"pairs of power cuts: (\d+)", "at every pair of operations of a short table, every pair of ways"),
    (r"failed operations followed by a power cut: (\d+)", "an operation that fails, then a power cut"),
    (r"power cuts of an upload through the node: (\d+)",
     "power cut at every operation of an upload through the node, in both modes: the drives go from what they held "
     "to the old or the new correction without a step"),
    (r"failed operations of an upload: (\d+)",
     "an operation that fails under such an upload: refused, reported, the old table's output"),
    (r"sizes 1 to (\d+), segmented and in blocks",
     "SDO transfers there and back, segmented and in blocks: every size from 1 to 16 384 bytes"),
    (r"transfers disturbed: (\d+)",
     "transfers aborted, left silent, replaced, reset, or sent nonsense, after each of their frames"),
)  # fmt: skip
SOAKED = (
    (r"; (\d+) faults:", "faults"),
    (r"(\d+) sets came out whole",
     "sets that came out whole, each within two increments of the table's sine"),
    (r"(\d+) actual positions came back", "actual positions that came back exactly as commanded"),
    (r"(\d+) other frames bit-identical", "other frames, bit-identical (offset mode passes none on)"),
)  # fmt: skip
# The largest steps are shares of what the rate limit permits, rounded to whole increments.
OF_DRIVES = (
    (r"events: (.+)", "events"),
    (r"(\d+) sets judged", "sets judged"),
    (r"(\d+) corrections suspended", "corrections suspended"),
    (r"suspended, (\d+) came back", "of them came back"),
    (r"; (\d+) turns of the axis", "wraps of the axis that turns without end"),
    (r"largest step .*: output ([\d.]+)", "largest step of an output, permitted step 1 (0.01 is an increment)"),
    (r"actual position ([\d.]+)", "the same of an un-corrected actual position"),
)  # fmt: skip


def commands(build: Path) -> dict[str, list[str]]:
    """The campaigns by name."""
    firmware = build / "firmware"
    brief = "--gtest_brief=1"
    return {
        "storage": [str(firmware / "storage/storage_test"), "--gtest_filter=PowerCut.*", brief],
        "node": [str(firmware / "ports/common/ports_common_test"), "--gtest_filter=NodePowerCut.*", brief],
        "disturbed": [str(firmware / "canopen/canopen_test"), "--gtest_filter=TroubledTransfer.*", brief],
        "sizes": [str(firmware / "testing/canopen_sizes")],
        **{name: [str(firmware / "testing/canopen_soak"), *args] for name, args in SOAK_HOURS.items()},
        **{name: [str(firmware / "testing/canopen_drive_soak"), *args] for name, args in DRIVE_HOURS.items()},
    }


def grouped(number: int) -> str:
    """The number with its thousands apart: 70 812."""
    return f"{number:,}".replace(",", " ")


def find(pattern: str, said: str) -> str:
    """The only match of a pattern in the campaigns' output. Raises ValueError if there is none, or several."""
    found: list[str] = re.findall(pattern, said)
    if len(found) != 1:
        raise ValueError(f"no campaign printed '{pattern}', or several did")
    return found[0]


def as_shown(text: str) -> str:
    """A share as it was printed, a count with its thousands apart, a list of counts as their sum."""
    return text if "." in text else grouped(sum(map(int, re.findall(r"\d+", text))))


def hours(
    of: dict[str, list[str]], rows: Iterable[tuple[str, str]], wrong: str, said: dict[str, str]
) -> list[str]:
    """The table of campaigns that simulate an hour each; `wrong` names its last row."""
    lines = ["| | " + " | ".join(of) + " |", "|---" * (1 + len(of)) + "|"]
    for pattern, what in rows:
        lines.append(f"| {what} | " + " | ".join(as_shown(find(pattern, said[name])) for name in of) + " |")
    clean = (said[name].rstrip().endswith("nothing wrong") for name in of)
    return [*lines, f"| {wrong} | " + " | ".join("0" if each else "1" for each in clean) + " |"]


def tables(said: dict[str, str]) -> str:
    """The tables, from what each campaign printed."""
    lines = ["| | cases |", "|---|---|"]
    simulated = {**SOAK_HOURS, **DRIVE_HOURS}
    everything = "\n".join(text for name, text in said.items() if name not in simulated)
    for pattern, what in COUNTED:
        count = int(find(pattern, everything)) * (TRANSFERS_OF_A_SIZE if "sizes" in pattern else 1)
        lines.append(f"| {what} | {grouped(count)} |")
    lines += [
        "",
        "An hour of simulated 1 kHz motion with nineteen kinds of fault, each in one of a thousand cycles "
        f"(`canopen_soak 3600`, seeds 1 to {len(SOAK_HOURS)}):",
        "",
        *hours(SOAK_HOURS, SOAKED, "wrong outputs, stuck states", said),
        "",
        "An hour with drives that do not always follow: an axis disabled, in fault, homing, guided by hand or in "
        "another mode, another table, correction disabled and enabled, power lost, pauses, lost targets, the node "
        "stopped (`canopen_drive_soak 3600 1`):",
        "",
        *hours(DRIVE_HOURS, OF_DRIVES, "wrong outputs, steps above the limit", said),
    ]
    return "\n".join(lines)


def main() -> int:
    """Run the campaigns, two at a time, and print."""
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    wanted = commands(Path(sys.argv[1]))

    def run(name: str) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            wanted[name], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        print(done.stdout, end="", file=sys.stderr, flush=True)
        return done

    with ThreadPoolExecutor(2) as workers:
        results = dict(zip(wanted, workers.map(run, wanted), strict=True))
    failed = [name for name, done in results.items() if done.returncode != 0]
    if failed:
        print(f"faults_report: {', '.join(failed)} failed", file=sys.stderr)
        return 1
    print(tables({name: done.stdout for name, done in results.items()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
