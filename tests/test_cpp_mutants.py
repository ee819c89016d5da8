"""C++ faults that `./dev mutants` injects, and the time limit of each run."""

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
        ("sleep 3", "survived"),  # a loaded machine: the program gets little processor time
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


def test_compile_time_constants_are_not_mutated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The compiler folds constants before a mutant's switch is read, so no test could detect such a mutant."""
    monkeypatch.setattr(cpp_mutants, "ROOT", tmp_path)
    (tmp_path / "a.cc").write_text(
        "const int kA[] = {\n    0x4cc5, 2U,\n};\nint f(int a) {\n  a = multiply<30>(a);\n  return a + 2;\n}\n"
        "constexpr std::array<F, 2> kF{{{kSin, 1},\n                               {kSign, 1}}};\n"
    )
    assert {mutant.line for mutant in cpp_mutants.mutants_of("a.cc")} == {6}


def test_brackets_of_a_mutant_keep_operator_precedence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bracketing `0 && b` would change the line to `a == (0 && b)` even with the mutant switched off."""
    monkeypatch.setattr(cpp_mutants, "ROOT", tmp_path)
    (tmp_path / "a.cc").write_text("bool f(int a, bool b) {\n  return a == 0 && b;\n}\n")
    assert {mutant.whole[mutant.begin : mutant.end] for mutant in cpp_mutants.mutants_of("a.cc")} == {
        "a == 0",
        "0",
    }
