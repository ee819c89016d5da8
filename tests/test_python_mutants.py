"""The faults that `./dev mutants` puts into Python code."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

from python_mutants import changes_of


@pytest.mark.parametrize(
    ("line", "changed"),
    [
        ("y = a < b", ["y = a <= b"]),
        ("y = a + b", ["y = a - b"]),
        ("y = a is None", ["y = a is not None"]),
        ("y = a and b", ["y = a or b"]),
        ("y = f(2)", ["y = f((2 + 1))"]),
        ("f()", ["pass"]),
        ("y = 'µ' if a else b", ["y = 'µ' if (not (a)) else b"]),
        ("if a: y = b", ["if (not (a)): y = b"]),
        ("y: Literal[2] = b", []),
        ('"""1 + 1"""', []),
    ],
)
def test_only_executable_code_is_mutated(line: str, changed: list[str]) -> None:
    assert [after for _, _, after in changes_of(line)] == changed
