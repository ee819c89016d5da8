"""Mutation testing of the C++ code: one place is changed at a time, and the tests run to see if one fails.

All mutants of a sample are compiled together into a copy of the tracked files (build/mutants/PART), each behind a
switch: `a < b` becomes `(mutant(7) ? (a <= b) : (a < b))`. The tests then run once for each mutant, with ARMTRUE_MUTANT
set to its number: the unit tests of the firmware, or those of the fitter followed by the Python tests of `./dev test`
that use it. A mutant with which no test fails is printed and listed in survivors.txt of that folder: review it, and add
the missing test. Mutants that change no observable behaviour are listed with the reason in PART/equivalent-mutants.txt
and are not run.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mutants import ROOT, SCRATCH, copy_head, environment_of, pytest_command, sample, verdict

# Folders of each part and their tests, the fastest first. A test is a program, or `pytest` with arguments.
PARTS = {
    "firmware": {
        "firmware/core": ["firmware/core/firmware_core_test", "firmware/canopen/canopen_test"],
        "firmware/storage": ["firmware/storage/storage_test"],
        "firmware/canopen": ["firmware/canopen/canopen_test", "firmware/testing/canopen_soak_test"],
    },
    "fitter": {
        "fitter": [
            "fitter/fitter_test",
            "pytest tests/recorded",
            "pytest tests/fitting tests/truth tests/refining tests/planning",
        ]
    },
}
# Files that are not mutated: tests, and format.h, whose numbers the test images use too (tests/firmware/test_format.py
# checks them).
_LEFT_OUT = re.compile(
    r"_test\.cc|_bench\.cc|_fuzz\.cc|_main\.cc|test_|/testing/|senseless|simulated|/fuzz/|format\.h"
)
# Left out: tests that run the same code tens of thousands of times. tools/test.d/15-faults.full.sh runs them.
FILTER = "-PowerCut.AtEveryPairOfOperations:PowerCut.AtEveryOperationOfTheLargestTable"
# Time limit for a mutant, as a multiple of the processor seconds of the unchanged program. Wall time says little on a
# loaded machine; its limit only ends a program that waits forever.
TIMES_UNFAULTED = 5
LEAST_LIMIT_S = 20
LONGEST_WALL_S = 1200

SWITCH = """\
#ifdef __cplusplus
#include <cstdlib>
namespace armtrue {
inline int chosen_mutant() {
  static const int number = [] {
    const char* text = std::getenv("ARMTRUE_MUTANT");
    return text == nullptr ? -1 : std::atoi(text);
  }();
  return number;
}
constexpr bool mutant(int number) {
  if (__builtin_is_constant_evaluated()) return false;
  return chosen_mutant() == number;
}
}  // namespace armtrue
#endif
"""

_SWAPS = {
    "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "+": "-", "-": "+", "*": "+", "/": "*",
    "%": "/", "<<": ">>", ">>": "<<", "&": "|", "|": "&", "&&": "||", "||": "&&",
}  # fmt: skip
_OPERAND = r"[A-Za-z0-9_](?:[\w.:]|->|\[[\w.]*\]|\([\w., :]*\))*"
# Not after `==`, `<=` and the like: brackets would turn `a == 0 && b` into `a == (0 && b)`.
_BEFORE = r"(?<=[(,])|(?<=[^=!<>]= )|(?<=return )|(?<=&& )|(?<=\|\| )|(?<=\? )|(?<=: )|(?<=, )"
_AFTER = r"(?=[),;]| &&| \|\|| \?| :)"
_BINARY = re.compile(
    rf"(?:{_BEFORE})({_OPERAND}) (<=|>=|==|!=|<<|>>|&&|\|\||[<>+\-*/%&|]) ({_OPERAND}){_AFTER}"
)
_NUMBER = re.compile(r"(?<![\w.'])(0x[0-9A-Fa-f]+|\d+)(U?)(?![\w.'])")
_CALL = re.compile(r"^(\s+)((?!return\b|throw\b|else\b|using\b)[A-Za-z_][\w.:>-]*\(.*\);)$")
_CONDITION = re.compile(r"\b(if|while) \(")
_TEMPLATE_ARGUMENTS = re.compile(r"(?<=\w)<[^<>;()]*>")
_NOT_A_NUMBER = str.maketrans("0123456789+-*/", "N" * 14)
_COMMENT_OR_TEXT = re.compile(r'//.*|"(?:[^"\\]|\\.)*"|\'(?:[^\'\\]|\\.)\'')


@dataclass(frozen=True)
class Mutant:
    """A change at one place of one line."""

    file: str
    line: int  # 1-based
    kind: str
    begin: int
    end: int
    after: str  # replaces the text from begin to end
    whole: str  # the original line

    def change(self) -> str:
        """The original line and the changed line."""
        after = self.whole[: self.begin] + self.after + self.whole[self.end :]
        return f"  - {self.whole.strip()}\n  + {after.strip()}\n"

    def text(self) -> str:
        """Place, kind and change, for the list of survivors."""
        return f"{self.file}:{self.line}: {self.kind}\n{self.change()}"

    def is_listed(self, listed: set[tuple[str, str]]) -> bool:
        """Whether a list (`changes_in`) contains this mutant; the line may have moved in its file."""
        return (self.file, self.change()) in listed

    def switched(self, line: str, number: int) -> str:
        """The line with both the original and the changed code, selected by the switch."""
        head, original, tail = line[: self.begin], line[self.begin : self.end], line[self.end :]
        if self.kind == "removed call":
            return f"{head}if (!::armtrue::mutant({number})) {original}{tail}"
        return f"{head}(::armtrue::mutant({number}) ? ({self.after}) : ({original})){tail}"


def _places_of(line: str) -> Iterator[tuple[str, int, int, str]]:
    # Comments, strings and template arguments are masked, without a change of length, so that they are not mutated.
    code = _COMMENT_OR_TEXT.sub(lambda m: "\0" * len(m[0]), line)
    code = _TEMPLATE_ARGUMENTS.sub(lambda m: m[0].translate(_NOT_A_NUMBER), code)
    for match in _BINARY.finditer(code):
        kind = (
            "logic" if match[2] in ("&&", "||") else "comparison" if match[2][0] in "<>=!" else "arithmetic"
        )
        if match[2] in ("<<", ">>"):
            kind = "arithmetic"
        yield kind, match.start(), match.end(), f"{match[1]} {_SWAPS[match[2]]} {match[3]}"
    for match in _NUMBER.finditer(code):
        yield "constant", match.start(), match.end(), f"{int(match[1], 0) + 1}{match[2]}"
    if call := _CALL.match(code):
        yield "removed call", call.start(2), call.end(2), ";"
    for match in _CONDITION.finditer(code):
        end = _closing(code, match.end() - 1)
        inside = line[match.end() : max(end, 0)]
        if end > 0 and not re.search(r"[;\0]|[^=!<>]=[^=]", inside):  # no initialiser, no string
            yield "negated condition", match.end(), end, f"!({inside})"


def _closing(code: str, opening: int) -> int:
    depth = 0
    for at in range(opening, len(code)):
        depth += (code[at] == "(") - (code[at] == ")")
        if depth == 0:
            return at
    return -1


def mutants_of(name: str) -> list[Mutant]:
    """Every mutant of a file; constant expressions and code outside of functions are not mutated."""
    result = []
    in_constant = False  # inside a constant of several lines: the compiler evaluates it, so no switch works
    for number, line in enumerate((ROOT / name).read_text().splitlines(), 1):
        code = _COMMENT_OR_TEXT.sub("", line).strip()
        in_constant = in_constant or re.search(r"\bconstexpr\b[^(]*(?: =|\{)", code) is not None
        if in_constant:
            in_constant = not code.endswith(";")
            continue
        skipped = code.startswith(
            ("#", "static_assert", "template", "using", "case ", "enum", "static constexpr", "virtual")
        )
        is_table = re.search(r"constexpr|std::array<|= default|asm\(|\[\]|^k\w+ = ", code) is not None
        is_row = re.fullmatch(r"(?:(?:0x[0-9A-Fa-f]+|\d+)U?,?\s*)+", code) is not None
        if line.startswith(" ") and code and not skipped and not is_table and not is_row:
            result += [Mutant(name, number, *place, line) for place in _places_of(line)]
    return result


def changes_in(path: Path) -> set[tuple[str, str]]:
    """File and change of each mutant in a list with the format of survivors.txt; `#` begins a comment."""
    found: set[tuple[str, str]] = set()
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    for head, before, after in zip(lines[::3], lines[1::3], lines[2::3], strict=True):
        found.add((head.split(":")[0], f"{before}\n{after}\n"))
    return found


def files_of(folders: list[str]) -> list[str]:
    """Source files that have mutants."""
    listed = subprocess.run(
        ["git", "ls-files", *folders], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [
        name for name in listed.stdout.split() if name.endswith((".cc", ".h")) and not _LEFT_OUT.search(name)
    ]


def changes_of_interest(part: str, folders: list[str]) -> dict[str, list[Mutant]]:
    """The mutants of each file, except those listed as equivalent."""
    listed = ROOT / part / "equivalent-mutants.txt"
    equivalent = changes_in(listed) if listed.is_file() else set()
    return {
        name: [mutant for mutant in mutants_of(name) if not mutant.is_listed(equivalent)]
        for name in files_of(folders)
    }


def one_of_each_line(mutants: list[Mutant]) -> list[Mutant]:
    """The first mutant of each line, because a line can have only one switch."""
    return list({(mutant.file, mutant.line): mutant for mutant in reversed(mutants)}.values())[::-1]


def copy_tree(tree: Path, part: str) -> None:
    """Copy the files of HEAD and configure a quick build that checks array bounds."""
    if not tree.is_dir():
        tree.mkdir(parents=True)
        for fetched in (".venv", ".cache"):  # files that the build has downloaded
            (tree / fetched).symlink_to(ROOT / fetched)
    shutil.rmtree(tree / part, ignore_errors=True)
    copy_head(tree)
    (tree / "mutant_switch.h").write_text(SWITCH)
    subprocess.run(
        ["cmake", "-S", ".", "-B", "out", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
         f"-DARMTRUE_PYTHON={'ON' if part == 'fitter' else 'OFF'}",
         f"-DCMAKE_CXX_FLAGS=-w -include {tree}/mutant_switch.h",
         "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -D_GLIBCXX_ASSERTIONS"],
        cwd=tree, check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip


def build(tree: Path, mutants: list[Mutant], tests: set[str]) -> list[Mutant]:
    """Compile all mutants behind their switches; returns those that compile, in the order of their numbers."""
    files = {
        mutant.file for mutant in mutants
    }  # including files whose mutants are all removed below, so that these are restored
    while True:
        for name in files:
            lines = (ROOT / name).read_text().splitlines()
            for number, mutant in enumerate(mutants):
                if mutant.file == name:
                    lines[mutant.line - 1] = mutant.switched(lines[mutant.line - 1], number)
            target = tree / name
            if target.read_text() != "\n".join(lines) + "\n":
                target.write_text("\n".join(lines) + "\n")
        # The pytest tests need the default target.
        targets = [Path(test).name if not test.startswith("pytest ") else "all" for test in sorted(tests)]
        built = subprocess.run(
            ["cmake", "--build", "out", "-j", "2", "--target", *targets, "--", "-k", "0"],
            cwd=tree, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if built.returncode == 0:
            return mutants
        # If a template does not compile, the compiler names the line that instantiates it last.
        place = rf"{re.escape(str(tree))}/([\w/.]+):(\d+):\d+: +(?:(?:fatal )?error|required from here)"
        wrong = set(re.findall(place, built.stdout + built.stderr))
        left = [mutant for mutant in mutants if (mutant.file, str(mutant.line)) not in wrong]
        if len(left) == len(mutants):
            raise SystemExit("mutants: the copy does not compile:\n" + built.stdout[-3000:])
        print(f"{len(mutants) - len(left)} do not compile and are left out", flush=True)
        mutants = left  # the numbers change, so all files are written again


def run_test(tree: Path, test: str, number: int, cpu_limit_s: int) -> str:
    """Outcome of a test for a mutant: survived, killed or timed out. `number` -1: the unchanged code."""
    if test.startswith("pytest "):
        command = pytest_command(test.split()[1:])
    else:
        command = [
            str(tree / "out" / test),
            *["--gtest_brief=1", "--gtest_fail_fast"],
            f"--gtest_filter={FILTER}",
        ]
    environment = os.environ | environment_of(tree) | {"ARMTRUE_MUTANT": str(number)}
    try:
        ran = subprocess.run(
            ["prlimit", f"--cpu={cpu_limit_s}", *command], cwd=tree, env=environment, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, timeout=LONGEST_WALL_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "timed out"
    if ran.returncode in (-signal.SIGXCPU, -signal.SIGKILL):  # sent at the soft and at the hard limit
        return "timed out"
    return "survived" if ran.returncode == 0 else "killed"


def run(tree: Path, tests: list[str], number: int, limits: dict[str, int]) -> str:
    """Outcome of the first test that notices a mutant; "survived" if none does."""
    for test in tests:
        if (outcome := run_test(tree, test, number, limits[test])) != "survived":
            return outcome
    return "survived"


def measured_limits(tree: Path, tests: set[str]) -> dict[str, int]:
    """The limit of processor seconds for each test: a multiple of the time for the unchanged code."""
    limits = {}
    for test in sorted(tests):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        if (outcome := run_test(tree, test, -1, LONGEST_WALL_S)) != "survived":
            raise SystemExit(f"mutants: {test} without any fault: {outcome}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        limits[test] = max(LEAST_LIMIT_S, round(TIMES_UNFAULTED * took))
        print(f"{test}: {took:.1f} processor seconds without any fault", flush=True)
    return limits


def main() -> int:
    """Run a sample; the exit status is 1 if the tests notice fewer than 95 % of the mutants run."""
    parser = argparse.ArgumentParser(prog="./dev mutants")
    parser.add_argument("--part", choices=list(PARTS), default="firmware")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--base", default="HEAD~30", help="files changed since then come first")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--folder",
        choices=[folder for part in PARTS.values() for folder in part],
        help="mutants of this one alone",
    )
    parser.add_argument(
        "--own", action="store_true", help="run a folder's own tests alone, not those above it"
    )
    parser.add_argument("--again", type=Path, metavar="LIST", help="those of an earlier survivors.txt alone")
    parser.add_argument("--minutes", type=float, default=600.0, help="no mutant is run after so long")
    given = parser.parse_args()
    end = time.monotonic() + 60.0 * given.minutes
    part = given.folder.split("/")[0] if given.folder else given.part
    tests_of = {
        folder: tests[:1] if given.own else tests
        for folder, tests in PARTS[part].items()
        if given.folder in (None, folder)
    }
    if given.again:
        listed = changes_in(given.again)
        every = [mutant for name in files_of(list(tests_of)) for mutant in mutants_of(name)]
        # If a file contains the line several times, each of them is chosen.
        chosen = one_of_each_line([mutant for mutant in every if mutant.is_listed(listed)])
    else:
        chosen = sample(changes_of_interest(part, list(tests_of)), given.count, given.seed, given.base)
    tree = SCRATCH / part
    every_test = {test for tests in tests_of.values() for test in tests}
    copy_tree(tree, part)
    mutants = build(tree, chosen, every_test)
    limits = measured_limits(tree, every_test)
    survivors = tree / "survivors.txt"
    survivors.write_text("")
    outcomes: Counter[str] = Counter()

    def judge(number: int) -> str:
        if time.monotonic() > end:
            return "not run"
        tests = next(tests for folder, tests in tests_of.items() if mutants[number].file.startswith(folder))
        return run(tree, tests, number, limits)

    with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
        for number, outcome in zip(range(len(mutants)), pool.map(judge, range(len(mutants))), strict=True):
            outcomes[outcome] += 1
            if outcome == "survived":
                print(mutants[number].text(), end="", flush=True)
                with survivors.open("a") as listed:
                    listed.write(mutants[number].text())
    return verdict(outcomes, len(chosen), survivors)


if __name__ == "__main__":
    sys.exit(main())
