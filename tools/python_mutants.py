"""Mutation testing of host_tools: one place of the code is changed at a time, and the tests run to see if one fails.

A place is an operator, a number, a condition or a call, found in the syntax tree. The tests are those of `./dev test`
that need neither a bus nor a browser: first the files that name the changed module, then those of its folder, then all.
(The workbench is left out, because its tests need a browser.) Each worker changes its own copy of the tracked files
(build/mutants/host_tools/N), and each run of the tests has a time limit. A mutant with which no test fails is printed
and listed in survivors.txt beside the copies: review it, and add the missing test.
"""

from __future__ import annotations

import argparse
import ast
import concurrent.futures
import os
import queue
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mutants import ROOT, SCRATCH, copy_head, environment_of, pytest_command, sample, verdict

COPIES = SCRATCH / "host_tools"
# Folders: a mutant's own folder is tested before all others.
ROOMS = [f"host_tools/armtrue/{room}" for room in ("checking", "cli", "device", "io", "report", "tables")]
# The tests of the folder `tests` that need no bus, emulator or browser.
PYTHON_TESTS = [
    "fitting", "init", "refining", "hidden_effects", "truth", "ladder", "planning", "test_bad_input.py", "test_docs.py",
    *(f"firmware/test_{name}.py" for name in ("accuracy", "format", "tables", "truth")),
]  # fmt: skip
_LEFT_OUT = ("test_", "conftest", "/testing/", "/workbench/")
TIME_LIMIT_S = 900.0

_COMPARED: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: (" is ", " is not "), ast.IsNot: (" is not ", " is "),
    ast.In: (" in ", " not in "), ast.NotIn: (" not in ", " in "),
}  # fmt: skip
_COMPUTED: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "+"), ast.Div: ("/", "*"), ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"), ast.Pow: ("**", "*"),
}  # fmt: skip


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


def changes_of(text: str) -> Iterator[tuple[int, str, str]]:
    """(line from 1, kind, changed line) of every place within one line; type hints and docstrings are not changed."""
    lines = text.splitlines()
    for node in _executed(ast.parse(text)):
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            yield from _between(
                lines, node.left, node.comparators[0], _COMPARED.get(type(node.ops[0])), "comparison"
            )
        elif isinstance(node, ast.BinOp):
            yield from _between(lines, node.left, node.right, _COMPUTED.get(type(node.op)), "arithmetic")
        elif isinstance(node, ast.BoolOp):
            swap = (" and ", " or ") if isinstance(node.op, ast.And) else (" or ", " and ")
            yield from _between(lines, node.values[0], node.values[1], swap, "logic")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield from _replaced(lines, node, f"({node.value!r} + 1)", "constant")
        elif isinstance(node, ast.If | ast.While | ast.IfExp):
            test = ast.get_source_segment(text, node.test)
            yield from _replaced(lines, node.test, f"(not ({test}))", "negated condition")
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            yield from _replaced(lines, node, "pass", "removed call")


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes below `tree`, except annotations and code that only a type checker reads."""
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "type_params"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if not isinstance(node, ast.AST) or _is_for_types(node):
                continue
            yield node
            yield from _executed(node)


def _is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _between(
    lines: list[str], left: ast.expr, right: ast.expr, swap: tuple[str, str] | None, kind: str
) -> Iterator[tuple[int, str, str]]:
    """The line with the operator between two operands changed."""
    if swap is None or left.end_lineno != right.lineno or left.end_col_offset is None:
        return
    line = lines[right.lineno - 1].encode()
    operator = line[left.end_col_offset : right.col_offset].decode()
    if swap[0] in operator:
        changed = operator.replace(*swap, 1).encode()
        yield right.lineno, kind, (line[: left.end_col_offset] + changed + line[right.col_offset :]).decode()


def _replaced(
    lines: list[str], node: ast.expr | ast.stmt, by: str, kind: str
) -> Iterator[tuple[int, str, str]]:
    if node.lineno == node.end_lineno:
        line = lines[node.lineno - 1].encode()
        changed = line[: node.col_offset] + by.encode() + line[node.end_col_offset :]
        yield node.lineno, kind, changed.decode()


def mutants_of(name: str) -> list[Mutant]:
    """Every mutant of a file."""
    text = (ROOT / name).read_text()
    lines = text.splitlines()
    return [Mutant(name, number, kind, lines[number - 1], after) for number, kind, after in changes_of(text)]


def tracked() -> list[str]:
    """Tracked files that are mutated."""
    command = ["git", "ls-files", "host_tools/*.py"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in listed.stdout.split() if not any(part in name for part in _LEFT_OUT)]


def prepare(number: int, near: bool = False) -> Path:
    """Make a copy of the tracked files, and check that its tests pass for the unchanged code."""
    tree = COPIES / str(number)
    shutil.rmtree(tree, ignore_errors=True)
    tree.mkdir(parents=True)
    copy_head(tree)
    for pattern in ("armtrue/*.so", "armtrue/*/*.so", "armtrue/device/*.eds"):
        for built in (ROOT / "host_tools").glob(pattern):
            shutil.copy(built, tree / built.relative_to(ROOT))
    if (status := _test(tree, ROOMS[:1] if near else ["host_tools", "tests"])) != "survived":
        raise SystemExit(f"mutants: without any fault: {status}")
    return tree


def _test(tree: Path, folders: list[str]) -> str:
    """Outcome of the tests: survived, killed or timed out."""
    for folder in folders:
        paths = [f"tests/{name}" for name in PYTHON_TESTS] if folder == "tests" else folder.split()
        try:
            ran = subprocess.run(
                pytest_command(paths), cwd=tree, env=os.environ | environment_of(tree), stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, timeout=TIME_LIMIT_S, check=False,
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


def judge(mutant: Mutant, trees: queue.Queue[Path], end: float, near: bool = False) -> str:
    """Outcome of a mutant. `near`: run only the tests that name its module and those of its folder."""
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
    """Run a sample; the exit status is 1 if the tests notice fewer than 95 % of the mutants run."""
    parser = argparse.ArgumentParser(prog="./dev mutants")
    parser.add_argument("--part", choices=["host_tools"], required=True)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--base", default="HEAD~30", help="files changed since then come first")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=600.0, help="no mutant is begun after so long")
    parser.add_argument("--near", action="store_true", help="only the tests beside a change: more survive")
    given = parser.parse_args()
    of_file = {name: mutants_of(name) for name in tracked()}
    chosen = sample(of_file, given.count, given.seed, given.base)
    trees: queue.Queue[Path] = queue.Queue()
    for number in range(given.jobs):
        trees.put(prepare(number, given.near))
    end = time.monotonic() + 60.0 * given.minutes
    outcomes: Counter[str] = Counter()
    survivors = COPIES / "survivors.txt"
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
    return verdict(outcomes, len(chosen), survivors)


if __name__ == "__main__":
    sys.exit(main())
