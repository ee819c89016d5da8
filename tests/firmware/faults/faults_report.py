"""Runs the fault campaigns of tools/test.d/15-faults.full.sh and prints as three tables what they counted.

python tests/firmware/faults/faults_report.py BUILD: the tables on standard output, what the campaigns say on
standard error. Exit status 1 where one of them failed.
"""

from __future__ import annotations

import re
import subprocess
import sys
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

# What a campaign prints, and how the table says it.
COUNTED = (
    (r"single power cuts: (\d+)",
     "power cut at every flash operation of prepare, commit, activate, confirm and revert: six histories, four "
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


def find(pattern: str, said: str) -> int:
    """The one number that a campaign printed. Raises ValueError where it did not."""
    found = re.findall(pattern, said)
    if len(found) != 1:
        raise ValueError(f"no campaign printed '{pattern}', or several did")
    return int(found[0])


def of_drives(pattern: str, said: str) -> str:
    """What a campaign with drives printed: a number, or its events added up."""
    found = re.findall(pattern, said)
    if len(found) != 1:
        raise ValueError(f"no campaign printed '{pattern}', or several did")
    if pattern.startswith("events"):
        return grouped(sum(map(int, re.findall(r"\d+", found[0]))))
    return found[0] if "." in found[0] else grouped(int(found[0]))


def tables(said: dict[str, str]) -> str:
    """The tables, from what each campaign printed."""
    lines = ["| | cases |", "|---|---|"]
    hours = {**SOAK_HOURS, **DRIVE_HOURS}
    everything = "\n".join(text for name, text in said.items() if name not in hours)
    for pattern, what in COUNTED:
        count = find(pattern, everything) * (TRANSFERS_OF_A_SIZE if "sizes" in pattern else 1)
        lines.append(f"| {what} | {grouped(count)} |")
    lines += [
        "",
        "An hour of simulated 1 kHz motion with nineteen kinds of fault, each in one of a thousand cycles "
        f"(`canopen_soak 3600`, seeds 1 to {len(SOAK_HOURS)}):",
        "",
        "| | " + " | ".join(SOAK_HOURS) + " |",
        "|---" * (1 + len(SOAK_HOURS)) + "|",
    ]
    for pattern, what in SOAKED:
        lines.append(
            f"| {what} | " + " | ".join(grouped(find(pattern, said[name])) for name in SOAK_HOURS) + " |"
        )
    wrong = [0 if said[name].rstrip().endswith("nothing wrong") else 1 for name in SOAK_HOURS]
    lines.append("| wrong outputs, stuck states | " + " | ".join(map(str, wrong)) + " |")
    lines += [
        "",
        "An hour with drives that do not always follow: an axis disabled, in fault, homing, guided by hand or in "
        "another mode, another table, correction disabled and enabled, power lost, pauses, lost targets, the node "
        "stopped (`canopen_drive_soak 3600 1`):",
        "",
        "| | " + " | ".join(DRIVE_HOURS) + " |",
        "|---" * (1 + len(DRIVE_HOURS)) + "|",
    ]
    for pattern, what in OF_DRIVES:
        lines.append(
            f"| {what} | " + " | ".join(of_drives(pattern, said[name]) for name in DRIVE_HOURS) + " |"
        )
    wrong = [0 if said[name].rstrip().endswith("nothing wrong") else 1 for name in DRIVE_HOURS]
    lines.append("| wrong outputs, steps above the limit | " + " | ".join(map(str, wrong)) + " |")
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
