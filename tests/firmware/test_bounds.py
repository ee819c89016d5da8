"""Machine-checked error bounds: gappa verifies the proofs of firmware/core; their constants are those of the code."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

CORE = Path(__file__).resolve().parents[2] / "firmware" / "core"
BOUNDS = CORE / "fixed" / "bounds"
PROOFS = sorted(BOUNDS.glob("*.g"))
_GOAL = re.compile(r"->\s*([\w\s*.\-]+?) in \[-([\d.e-]+),([\d.e-]+)\]")
_FOUND = re.compile(r" in \[\S+ \{(\S+), [^}]*\}, \S+ \{(\S+), [^}]*\}\]")


def gappa(text: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["gappa"], input=text, capture_output=True, text=True, timeout=300.0, check=False)


def best_bound(text: str) -> float:
    """The smallest bound that gappa finds for the goal of `text`."""
    said = gappa(_GOAL.sub(r"-> \1 in ?", text))
    found = _FOUND.search(said.stdout + said.stderr)
    assert found, said.stdout + said.stderr
    return max(abs(float(edge)) for edge in found.groups())


def stated_bound(text: str) -> float:
    goal = _GOAL.search(text)
    assert goal
    assert goal[2] == goal[3]
    return float(goal[2])


def test_all_proofs_are_there() -> None:
    assert [path.stem for path in PROOFS] == [
        "chain", "harmonic", "line", "power_of_two", "sine", "slow_wave", "term",
    ]  # fmt: skip


@pytest.mark.parametrize("path", PROOFS, ids=lambda path: path.stem)
def test_bound_is_proved_and_tight(path: Path) -> None:
    text = path.read_text()
    said = gappa(text)
    assert said.returncode == 0, said.stderr
    # Gappa trusts every hint; it warns of one that it cannot recognise as an identity.
    assert "Warning" not in said.stdout + said.stderr
    # A bound that gappa also proves at 0.8 of its size is stated too wide to notice a lost bit.
    assert 0.8 * stated_bound(text) < best_bound(text) <= stated_bound(text)


@pytest.mark.parametrize("path", PROOFS, ids=lambda path: path.stem)
def test_rounding_that_drops_six_bits_breaks_the_bound(path: Path) -> None:
    """The same arithmetic with its last rounding six bits earlier does not keep its bound."""
    text = path.read_text()
    head, goal = text.split("\n{ ", 1)
    last = max(head.rfind(f"fixed<{bits},ne>(") for bits in (-30, -27, -12))
    coarse = re.sub(r"fixed<-(\d+),", lambda m: f"fixed<-{int(m[1]) - 6},", head[last:], count=1)
    assert best_bound(head[:last] + coarse + "\n{ " + goal) > stated_bound(text)


def integers(source: Path, pattern: str) -> list[int]:
    found = re.search(pattern, source.read_text(), re.S)
    assert found, pattern
    return [int(value) for value in re.findall(r"(?:=|,|\{)\s*(-?\d+)", found[0])]


def quoted(name: str) -> list[int]:
    """Integer coefficients of a proof, in the order of their powers."""
    text = (BOUNDS / f"{name}.g").read_text().split("\n\n")[0]
    return [int(value) for value in re.findall(r"(-?\d{6,})b-\d+", text)]


def test_sine_proof_has_the_code_s_coefficients() -> None:
    code = integers(CORE / "fixed/angle.h", r"namespace sine_polynomial \{.*?\}  // namespace")
    assert quoted("sine")[::-1] == code


def test_power_of_two_proof_has_the_code_s_coefficients() -> None:
    code = integers(CORE / "evaluation/terms.cc", r"kPowerPolynomial = \{.*?\};")
    assert quoted("power_of_two")[::-1] == code


def test_largest_slow_wave_of_the_proof_is_the_readers_limit() -> None:
    found = re.search(r"kMaxWave = std::int64_t\{1\} << (\d+)", (CORE / "table/checks_terms.cc").read_text())
    assert found
    assert 2.0 ** (int(found[1]) - 32) == 0.125
    assert "[-0.125,0.125]" in (BOUNDS / "slow_wave.g").read_text()


def largest_error(polynomial: list[float], exact: np.ufunc, curvature: float, *, odd: bool) -> float:
    """Bound of |p - exact| on 0 … 1: the largest at a million points, and what it can grow by between two of them
    (a function whose second derivative is within `curvature` leaves its chord by at most step² curvature / 8)."""
    x = np.linspace(0.0, 1.0, 1_000_001)
    value = np.polynomial.polynomial.polyval(x * x if odd else x, polynomial)
    error = np.abs((value * x if odd else value) - exact(x)).max()
    return float(error + 1e-12 * curvature / 8.0 + 1e-15)


def test_sine_polynomial_is_close_to_the_sine() -> None:
    text = (BOUNDS / "sine.g").read_text()
    exact_coefficients = [float(re.search(rf"^P{i} = (\S+) \+", text, re.M)[1]) for i in range(5)]  # type: ignore[index]
    exact_coefficients.append(float(re.search(r"^P4 = .* \+ z \* (\S+);", text, re.M)[1]))  # type: ignore[index]
    # Both second derivatives are below 5 on 0 … 1.
    error = largest_error(exact_coefficients, lambda x: np.sin(0.5 * np.pi * x), 10.0, odd=True)
    assert error < 1.5e-11
    assert error + stated_bound(text) < 2.0e-9


def test_power_polynomial_is_close_to_the_power() -> None:
    code = integers(CORE / "evaluation/terms.cc", r"kPowerPolynomial = \{.*?\};")
    error = largest_error([value / 2.0**30 for value in code], np.exp2, 2.0, odd=False)
    assert error < 2.8e-9
