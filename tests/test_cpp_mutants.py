"""Faults that `./dev mutants` puts into C++, and how long it lets one run."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

import cpp_mutants


@pytest.fixture
def program(tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    path = tmp_path / "out/some_test"
    path.write_text("")
    path.chmod(0o755)
    return path


@pytest.mark.full
@pytest.mark.parametrize(
    ("script", "outcome"),
    [
        ("sleep 3", "survived"),  # a loaded machine: time passes, little of it is the program's
        ("while :; do :; done", "timed out"),
        ("exit 1", "killed"),
    ],
)
def test_time_limit_counts_processor_seconds(
    tmp_path: Path, program: Path, script: str, outcome: str
) -> None:
    program.write_text(f"#!/bin/sh\n{script}\n")
    assert cpp_mutants.run_test(tmp_path, "some_test", 0, 1) == outcome


@pytest.mark.full
def test_limit_is_relative_to_the_unfaulted_run(
    tmp_path: Path, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cpp_mutants, "LEAST_LIMIT_S", 0)
    program.write_text("#!/bin/sh\ni=0; while [ $i -lt 1000000 ]; do i=$((i + 1)); done\n")
    assert cpp_mutants.measured_limits(tmp_path, {"some_test"})["some_test"] >= 1


def test_program_that_fails_without_a_fault_is_refused(tmp_path: Path, program: Path) -> None:
    program.write_text("#!/bin/sh\nexit 1\n")
    with pytest.raises(SystemExit, match="some_test without any fault: killed"):
        cpp_mutants.measured_limits(tmp_path, {"some_test"})


def test_constants_of_the_compiler_are_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The compiler folds a constant before any switch is asked: its mutants could not be noticed."""
    monkeypatch.setattr(cpp_mutants, "ROOT", tmp_path)
    (tmp_path / "a.cc").write_text(
        "const int kA[] = {\n    0x4cc5, 2U,\n};\nint f(int a) {\n  a = multiply<30>(a);\n  return a + 2;\n}\n"
        "constexpr std::array<F, 2> kF{{{kSin, 1},\n                               {kSign, 1}}};\n"
    )
    assert {mutant.line for mutant in cpp_mutants.mutants_of("a.cc")} == {6}


def test_brackets_of_a_mutant_do_not_regroup_the_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`a == (0 && b)` is a fault of its own, also with the switch off."""
    monkeypatch.setattr(cpp_mutants, "ROOT", tmp_path)
    (tmp_path / "a.cc").write_text("bool f(int a, bool b) {\n  return a == 0 && b;\n}\n")
    assert {mutant.whole[mutant.begin : mutant.end] for mutant in cpp_mutants.mutants_of("a.cc")} == {
        "a == 0",
        "0",
    }
