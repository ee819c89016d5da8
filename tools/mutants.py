"""Mutation testing of host_tools: small faults put into the code one at a time, and whether a test notices.

Judged by the Python tests of `./dev test` that need neither a bus nor a browser: first the files that name the changed
module, then its folder's, then all. (The workbench, whose tests need a browser, is left out. C++: tools/cpp_mutants.py,
which compiles all faults of a sample at once.) Works on copies of the tracked files (build/mutants/host_tools/N), with
a time limit. A mutant that no test fails is printed and listed in survivors.txt beside them: judge it, and add the test
that it asks for.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import os
import queue
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import python_mutants

ROOT = Path(__file__).resolve().parents[1]
SCRATCH = ROOT / "build" / "mutants" / "host_tools"
# Folders whose own tests are asked before all others.
ROOMS = [f"host_tools/armtrue/{room}" for room in ("checking", "cli", "device", "io", "report", "tables")]
# Of `tests`, those without a bus, an emulator or a browser.
PYTHON_TESTS = [
    "fitting", "init", "refining", "hidden_effects", "truth", "ladder", "planning", "test_bad_input.py", "test_docs.py",
    *(f"firmware/test_{name}.py" for name in ("accuracy", "format", "tables", "truth")),
]  # fmt: skip
_LEFT_OUT = ("test_", "conftest", "/testing/", "/workbench/")
TIME_LIMIT_S = 900.0
SHARE_OF_CHANGED = 0.7


@dataclass(frozen=True)
class Mutant:
    """One changed line of one file."""

    file: str
    line: int  # 1-based
    kind: str
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.kind}\n  - {self.before.strip()}\n  + {self.after.strip()}"


def mutants_of(file: Path, name: str) -> list[Mutant]:
    """Every mutant of a file."""
    text = file.read_text()
    lines = text.splitlines()
    return [
        Mutant(name, number, kind, lines[number - 1], after)
        for number, kind, after in python_mutants.changes_of(text)
    ]


def tracked() -> list[str]:
    """Files that are mutated."""
    command = ["git", "ls-files", "host_tools/*.py"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in listed.stdout.split() if not any(part in name for part in _LEFT_OUT)]


def sample(count: int, seed: int, base: str) -> list[Mutant]:
    """`count` mutants: files changed since `base` first, then all others; no two of one line."""
    changed = subprocess.run(
        ["git", "diff", "--name-only", base, "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    chosen = random.Random(seed)
    groups: dict[bool, list[Mutant]] = {True: [], False: []}
    for name in tracked():
        by_line: dict[int, list[Mutant]] = {}
        for mutant in mutants_of(ROOT / name, name):
            by_line.setdefault(mutant.line, []).append(mutant)
        groups[name in changed] += [chosen.choice(mutants) for mutants in by_line.values()]
    for group in groups.values():
        chosen.shuffle(group)
    first = groups[True][: round(SHARE_OF_CHANGED * count)]
    return (first + groups[False] + groups[True][len(first) :])[:count]


def prepare(number: int, near: bool = False) -> Path:
    """A copy of the tracked files, whose tests passed without a fault."""
    tree = SCRATCH / str(number)
    shutil.rmtree(tree, ignore_errors=True)
    tree.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "x"], cwd=tree, input=archive, check=True)
    for pattern in ("armtrue/*.so", "armtrue/*/*.so", "armtrue/device/*.eds"):
        for built in (ROOT / "host_tools").glob(pattern):
            shutil.copy(built, tree / built.relative_to(ROOT))
    if (status := _test(tree, ROOMS[:1] if near else ["host_tools", "tests"])) != "survived":
        raise SystemExit(f"mutants: without any fault: {status}")
    return tree


def _test(tree: Path, folders: list[str]) -> str:
    """survived, killed or timed out."""
    environment = os.environ | {
        "PYTHONPATH": f"{tree}/host_tools:{tree}/sim",
        "OPENBLAS_NUM_THREADS": "1",
    }
    for folder in folders:
        try:
            ran = subprocess.run(
                _pytest(folder), cwd=tree, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                timeout=TIME_LIMIT_S, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return "timed out"
        if ran.returncode != 0:
            return "killed"
    return "survived"


def _naming(file: str) -> list[str]:
    """The test files that name a Python module, the shortest first."""
    module = file.removeprefix("host_tools/").removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    found = [
        path
        for folder in ("host_tools", *(f"tests/{name}" for name in PYTHON_TESTS))
        for path in ([ROOT / folder] if folder.endswith(".py") else (ROOT / folder).rglob("test_*.py"))
        if module in path.read_text() or path.stem == f"test_{Path(file).stem}"
    ]
    return [str(path.relative_to(ROOT)) for path in sorted(found, key=lambda path: path.stat().st_size)]


def _pytest(folder: str) -> list[str]:
    where = [f"tests/{name}" for name in PYTHON_TESTS] if folder == "tests" else folder.split()
    return [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", "not full", *where]


def judge(mutant: Mutant, trees: queue.Queue[Path], end: float, near: bool = False) -> str:
    """What became of a mutant; `near`: by the tests that name its module and those of its folder alone."""
    if time.monotonic() > end:
        return "not begun"
    tree = trees.get()
    path = tree / mutant.file
    original = path.read_text()
    lines = original.splitlines()
    lines[mutant.line - 1] = mutant.after
    tests = [" ".join(_naming(mutant.file)), *(room for room in ROOMS if mutant.file.startswith(room))]
    if not near:
        tests += ["host_tools", "tests"]
    try:
        path.write_text("\n".join(lines) + "\n")
        return _test(tree, [test for test in tests if test])
    finally:
        path.write_text(original)
        trees.put(tree)


def main() -> int:
    """Run a sample; 1 if fewer than 95 % of the mutants are noticed."""
    parser = argparse.ArgumentParser(prog="./dev mutants")
    parser.add_argument("--part", choices=["host_tools"], required=True)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--base", default="HEAD~30", help="files changed since then come first")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=600.0, help="no mutant is begun after so long")
    parser.add_argument("--near", action="store_true", help="only the tests beside a change: more survive")
    given = parser.parse_args()
    chosen = sample(given.count, given.seed, given.base)
    trees: queue.Queue[Path] = queue.Queue()
    for number in range(given.jobs):
        trees.put(prepare(number, given.near))
    end = time.monotonic() + 60.0 * given.minutes
    outcomes: Counter[str] = Counter()
    survivors = SCRATCH / "survivors.txt"
    survivors.write_text("")
    with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
        running = {pool.submit(judge, mutant, trees, end, given.near): mutant for mutant in chosen}
        for done in concurrent.futures.as_completed(running):
            outcome = done.result()
            outcomes[outcome] += 1
            if outcome == "survived":
                print(running[done], flush=True)
                with survivors.open("a") as listed:
                    listed.write(f"{running[done]}\n")
    ran = outcomes["killed"] + outcomes["timed out"] + outcomes["survived"]
    noticed = outcomes["killed"] + outcomes["timed out"]
    print(f"{ran} mutants of {len(chosen)}: {noticed} noticed ({100 * noticed / max(1, ran):.1f} %)")
    print(", ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items())), f"({survivors})")
    return 0 if noticed >= 0.95 * ran else 1


if __name__ == "__main__":
    sys.exit(main())
