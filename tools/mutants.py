"""Mutation testing: small faults put into the code one at a time, and whether a test notices.

The fitter is judged by its unit tests, host_tools by the Python tests of `./dev test` that need neither a bus nor a
browser: first the files that name the changed module, then its folder's, then all. (The workbench, whose tests need a
browser, is left out. Firmware: tools/firmware_mutants.py, which compiles all faults of a sample at once.)
Works on copies of the tracked files (build/mutants/N), builds the test program concerned, and runs it with a time
limit. A mutant that no test fails is printed and listed in build/mutants/survivors.txt: judge it, and add the test that
it asks for.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import os
import queue
import random
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import python_mutants

ROOT = Path(__file__).resolve().parents[1]
SCRATCH = ROOT / "build" / "mutants"
# Each part, its folders, and their tests, the quickest first: programs for C++, folders for Python.
PARTS = {
    "fitter": {"fitter": ["fitter/fitter_test"]},
    "host_tools": {
        **{
            f"host_tools/armtrue/{room}": [f"host_tools/armtrue/{room}", "host_tools", "tests"]
            for room in ("checking", "cli", "device", "io", "report", "tables")
        },
        "host_tools": ["host_tools", "tests"],
    },
}
# Of `tests`, those without a bus, an emulator or a browser.
PYTHON_TESTS = [
    "fitting", "init", "refining", "hidden_effects", "truth", "ladder", "planning", "test_bad_input.py", "test_docs.py",
    *(f"firmware/test_{name}.py" for name in ("accuracy", "format", "tables", "truth")),
]  # fmt: skip
_LEFT_OUT = re.compile(r"_test\.cc|_bench\.cc|_fuzz\.cc|test_|conftest|/testing/|fitter/python/|/workbench/")
TIME_LIMIT_S = 90.0
SHARE_OF_CHANGED = 0.7

_SWAPS = {
    "comparison": [("<", "<="), ("<=", "<"), (">", ">="), (">=", ">"), ("==", "!="), ("!=", "==")],
    "arithmetic": [("+", "-"), ("-", "+"), ("*", "+"), ("/", "*"), ("%", "/"), ("<<", ">>"), (">>", "<<"),
                   ("&", "|"), ("|", "&"), ("+=", "-="), ("-=", "+=")],
    "logic": [("&&", "||"), ("||", "&&")],
}  # fmt: skip
_NUMBER = re.compile(r"(?<![\w.'])(0x[0-9A-Fa-f]+|\d+)(?=U?\b)(?!['.])")
_CALL = re.compile(r"^\s+(?!return\b|throw\b|else\b|co_)[A-Za-z_][\w.:>-]*\(.*\);$")
_CONDITION = re.compile(r"\b(?:if|while) \(")
_COMMENT_OR_TEXT = re.compile(r'//.*|"(?:[^"\\]|\\.)*"|\'(?:[^\'\\]|\\.)\'')


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


def _changes_of(line: str) -> Iterator[tuple[str, str]]:
    """(kind, changed line) for every place of a line of code."""
    # Comments and text keep their length and hold nothing that could be changed.
    code = _COMMENT_OR_TEXT.sub(lambda m: "\0" * len(m[0]), line)
    for kind, swaps in _SWAPS.items():
        for old, new in ((f" {old} ", f" {new} ") for old, new in swaps):  # binary: between spaces
            at = code.find(old)
            while at >= 0:
                yield kind, line[:at] + new + line[at + len(old) :]
                at = code.find(old, at + 1)
    for match in _NUMBER.finditer(code):
        yield "constant", line[: match.start()] + str(int(match[0], 0) + 1) + line[match.end() :]
    if _CALL.match(code):
        yield "removed call", line[: len(line) - len(line.lstrip())] + ";"
    for match in _CONDITION.finditer(code):
        end = _closing(code, match.end() - 1)
        inside = line[match.end() : end]
        if end < 0 or "\0" in inside:
            continue
        first = inside.rfind(";") + 1  # behind an initialiser
        yield "negated condition", f"{line[: match.end() + first]} !({inside[first:].strip()}){line[end:]}"


def _closing(code: str, opening: int) -> int:
    depth = 0
    for at in range(opening, len(code)):
        depth += (code[at] == "(") - (code[at] == ")")
        if depth == 0:
            return at
    return -1


def mutants_of(file: Path, name: str) -> list[Mutant]:
    """Every mutant of a file; declarations of tables, includes and assertions are left alone."""
    if file.suffix == ".py":
        text = file.read_text()
        lines = text.splitlines()
        return [
            Mutant(name, number, kind, lines[number - 1], after)
            for number, kind, after in python_mutants.changes_of(text)
        ]
    result = []
    for number, line in enumerate(file.read_text().splitlines(), 1):
        code = _COMMENT_OR_TEXT.sub("", line)
        skipped = code.lstrip().startswith(("#", "static_assert", "template", "using", "case ", "//"))
        if line.startswith((" ", "constexpr", "inline constexpr")) and not skipped and code.strip():
            result += [Mutant(name, number, kind, line, after) for kind, after in _changes_of(line)]
    return result


def tracked(part: str) -> list[str]:
    """Files of a part that are mutated."""
    command = ["git", "ls-files", *PARTS[part]]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    suffixes = (".cc", ".h", ".py")
    return [name for name in listed.stdout.split() if name.endswith(suffixes) and not _LEFT_OUT.search(name)]


def sample(part: str, count: int, seed: int, base: str) -> list[Mutant]:
    """`count` mutants: files changed since `base` first, then all others; no two of one line."""
    changed = subprocess.run(
        ["git", "diff", "--name-only", base, "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    chosen = random.Random(seed)
    groups: dict[bool, list[Mutant]] = {True: [], False: []}
    for name in tracked(part):
        by_line: dict[int, list[Mutant]] = {}
        for mutant in mutants_of(ROOT / name, name):
            by_line.setdefault(mutant.line, []).append(mutant)
        groups[name in changed] += [chosen.choice(mutants) for mutants in by_line.values()]
    for group in groups.values():
        chosen.shuffle(group)
    first = groups[True][: round(SHARE_OF_CHANGED * count)]
    return (first + groups[False] + groups[True][len(first) :])[:count]


def prepare(part: str, number: int, near: bool = False) -> Path:
    """A copy of the tracked files, its tests built without a fault and passed."""
    tree = SCRATCH / str(number)
    shutil.rmtree(tree, ignore_errors=True)
    tree.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "x"], cwd=tree, input=archive, check=True)
    if part == "host_tools":
        for pattern in ("armtrue/*.so", "armtrue/*/*.so", "armtrue/device/*.eds"):
            for built in (ROOT / "host_tools").glob(pattern):
                shutil.copy(built, tree / built.relative_to(ROOT))
    else:
        shutil.copytree(ROOT / ".cache" / "sdist", tree / ".cache" / "sdist")  # what the build would fetch
        # ARMTRUE_BENCH compiles every file by itself: a fault then costs one file and not eight.
        subprocess.run(
            ["cmake", "-S", ".", "-B", "out", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DARMTRUE_PYTHON=OFF",
             "-DARMTRUE_BENCH=ON", "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -D_GLIBCXX_ASSERTIONS"],
            cwd=tree, check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
    for tests in PARTS[part].values():
        if (status := _test(tree, tests[:1] if near else tests)) != "survived":
            raise SystemExit(f"mutants: without any fault: {status}")
        if part == "host_tools":
            break  # the first room's tests are followed by all
    return tree


def _test(tree: Path, tests: list[str]) -> str:
    """survived, killed, timed out, or does not compile."""
    for test in tests:
        if test.startswith(("host_tools", "tests")):
            command, limit_s = _pytest(test), 10 * TIME_LIMIT_S
        else:
            built = subprocess.run(
                ["cmake", "--build", "out", "-j", "2", "--target", Path(test).name],
                cwd=tree, capture_output=True, text=True, check=False,
            )  # fmt: skip
            if built.returncode != 0:
                return "does not compile"
            command = [str(tree / "out" / test), "--gtest_brief=1", "--gtest_fail_fast"]
            limit_s = TIME_LIMIT_S
        environment = os.environ | {
            "PYTHONPATH": f"{tree}/host_tools:{tree}/sim",
            "OPENBLAS_NUM_THREADS": "1",
        }
        try:
            ran = subprocess.run(
                command, cwd=tree, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                timeout=limit_s, check=False,
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


def judge(part: str, mutant: Mutant, trees: queue.Queue[Path], end: float, near: bool = False) -> str:
    """What became of a mutant; `near`: by the tests that name its module and those of its folder alone."""
    if time.monotonic() > end:
        return "not begun"
    tree = trees.get()
    path = tree / mutant.file
    original = path.read_text()
    lines = original.splitlines()
    lines[mutant.line - 1] = mutant.after
    tests = next(tests for folder, tests in PARTS[part].items() if mutant.file.startswith(folder))
    if mutant.file.endswith(".py") and (naming := _naming(mutant.file)):
        tests = [" ".join(naming), *tests]
    if near:
        tests = [test for test in tests if test not in ("host_tools", "tests")] or tests[:1]
    try:
        path.write_text("\n".join(lines) + "\n")
        return _test(tree, tests)
    finally:
        path.write_text(original)
        trees.put(tree)


def main() -> int:
    """Run a sample; 1 if fewer than 95 % of the mutants that compile are noticed."""
    parser = argparse.ArgumentParser(prog="./dev mutants")
    parser.add_argument("--part", choices=PARTS, required=True)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--base", default="HEAD~30", help="files changed since then come first")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=600.0, help="no mutant is begun after so long")
    parser.add_argument("--near", action="store_true", help="only the tests beside a change: more survive")
    given = parser.parse_args()
    chosen = sample(given.part, given.count, given.seed, given.base)
    trees: queue.Queue[Path] = queue.Queue()
    for number in range(given.jobs):
        trees.put(prepare(given.part, number, given.near))
    end = time.monotonic() + 60.0 * given.minutes
    outcomes: Counter[str] = Counter()
    survivors = SCRATCH / "survivors.txt"
    survivors.write_text("")
    with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
        running = {
            pool.submit(judge, given.part, mutant, trees, end, given.near): mutant for mutant in chosen
        }
        for done in concurrent.futures.as_completed(running):
            outcome = done.result()
            outcomes[outcome] += 1
            if outcome == "survived":
                print(running[done], flush=True)
                with survivors.open("a") as listed:
                    listed.write(f"{running[done]}\n")
    compiled = outcomes["killed"] + outcomes["timed out"] + outcomes["survived"]
    noticed = outcomes["killed"] + outcomes["timed out"]
    print(
        f"{compiled} mutants of {len(chosen)}: {noticed} noticed ({100 * noticed / max(1, compiled):.1f} %)"
    )
    print(", ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items())), f"({survivors})")
    return 0 if noticed >= 0.95 * compiled else 1


if __name__ == "__main__":
    sys.exit(main())
