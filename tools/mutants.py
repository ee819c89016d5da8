"""Mutation testing, common to C++ and Python: choose a sample of mutants, copy the code, print the verdict."""

from __future__ import annotations

import random
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

ROOT = Path(__file__).resolve().parents[1]
SCRATCH = ROOT / "build" / "mutants"
# Share of a sample that is taken from recently changed files, if they have so many mutants.
SHARE_OF_CHANGED = 0.7
# The tests should notice at least this share of the mutants.
GOAL = 0.95


class OnALine(Protocol):
    """A mutant in any language."""

    @property
    def line(self) -> int:
        """Line number in its file, from 1."""


M = TypeVar("M", bound=OnALine)


def sample(of_file: Mapping[str, Sequence[M]], count: int, seed: int, base: str) -> list[M]:
    """`count` mutants, no two on one line; files changed since the commit `base` have SHARE_OF_CHANGED of them."""
    changed = subprocess.run(
        ["git", "diff", "--name-only", base, "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    chosen = random.Random(seed)
    groups: dict[bool, list[M]] = {True: [], False: []}
    for name, mutants in of_file.items():
        by_line: dict[int, list[M]] = {}
        for mutant in mutants:
            by_line.setdefault(mutant.line, []).append(mutant)
        groups[name in changed] += [chosen.choice(own) for own in by_line.values()]
    for group in groups.values():
        chosen.shuffle(group)
    first = groups[True][: round(SHARE_OF_CHANGED * count)]
    return (first + groups[False] + groups[True][len(first) :])[:count]


def copy_head(tree: Path) -> None:
    """Write the tracked files of HEAD into a folder."""
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "x"], cwd=tree, input=archive, check=True)


def pytest_command(paths: Sequence[str]) -> list[str]:
    """The command that runs the tests of `./dev test` at some paths until one fails."""
    return [sys.executable, *["-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m"], "not full", *paths]


def environment_of(tree: Path) -> dict[str, str]:
    """Environment variables with which Python imports the copy instead of this checkout."""
    return {"PYTHONPATH": f"{tree}/host_tools:{tree}/sim", "OPENBLAS_NUM_THREADS": "1"}


def verdict(outcomes: Counter[str], count: int, survivors: Path) -> int:
    """Print how many mutants the tests noticed; returns 1, an exit status, if their share is below the goal."""
    noticed = outcomes["killed"] + outcomes["timed out"]
    ran = noticed + outcomes["survived"]
    print(f"{ran} mutants of {count} ran: {noticed} noticed ({100 * noticed / max(1, ran):.1f} %)")
    print(", ".join(f"{number} {outcome}" for outcome, number in sorted(outcomes.items())), f"({survivors})")
    return 0 if noticed >= GOAL * ran else 1
