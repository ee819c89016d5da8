"""Checks that C++ folders include downwards only.

    python tools/include_order.py [ROOT]

Prints every #include that points up or sideways; exit status 1 where there is one. Tests, benches, fuzz harnesses,
programs (*_main.cc) and the folders `testing` may include anything.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

# From the bottom up: a folder may include those of earlier lines. Folders on one line may not include each other.
ORDER = [
    ["firmware/core/fixed", "firmware/core/crypto", "fitter/common", "fitter/model/expression"],
    ["firmware/core/table", "fitter/model"],
    ["firmware/core/evaluation", "fitter/effects"],
    ["firmware/core", "fitter/design"],
    ["firmware/core/senseless", "firmware/storage", "firmware/replay", "fitter/start"],
    ["firmware/canopen/protocol", "fitter/inference"],
    ["fitter/solve"],
    ["fitter/evidence/search"],
    ["fitter/evidence"],
    ["firmware/canopen/motion", "firmware/canopen/sdo", "firmware/canopen/table", "fitter/diagnose"],
    ["firmware/canopen/node", "fitter/plan", "fitter/refine"],
    ["firmware/ports/common", "fitter/python"],
    ["firmware/ports/arm"],
    [f"firmware/ports/{port}" for port in ("posix", "host", "cortex_m7", "r5f", "stm32f405")],
]
RANK = {folder: rank for rank, folders in enumerate(ORDER) for folder in folders}
# Written at build time: the object dictionary for the protocol, a device's identity for the ports.
GENERATED = {"firmware/canopen/od_generated.h", "firmware/ports/identity.h"}
FREE = re.compile(
    r"_(test|fuzz|bench|main)\.(cc|h)$|/testing/|/fuzz/|^firmware/ports/host/node_in_process\.cc$"
)
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)


def folder_of(path: str) -> str:
    """The longest folder of ORDER that holds a file; its own folder where none does."""
    held = [folder for folder in RANK if path.startswith(folder + "/")]
    return max(held, key=len) if held else path.rpartition("/")[0]


def violations(root: Path) -> list[str]:
    """One line per include that the order does not allow, or that leads to a folder that ORDER does not name."""
    found = []
    for file in sorted(path for part in ("firmware", "fitter") for path in (root / part).rglob("*")):
        name = file.relative_to(root).as_posix()
        if file.suffix not in (".cc", ".h") or FREE.search(name):
            continue
        here = folder_of(name)
        if here not in RANK:
            found.append(f"{name}: its folder has no place in tools/include_order.py")
            continue
        for included in INCLUDE.findall(file.read_text(encoding="utf-8")):
            there = folder_of(included)
            if not included.startswith(("firmware/", "fitter/")) or included in GENERATED or there == here:
                continue
            same_part = here.partition("/")[0] == there.partition("/")[0]
            if not same_part or there not in RANK or RANK[there] >= RANK[here]:
                found.append(f"{name}: includes {included}; {here} stands below {there} or beside it")
    return found


def main() -> int:
    """The command line."""
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1]
    found = violations(root)
    print(*found, sep="\n", end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
