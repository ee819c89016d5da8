"""Standard deviations are right: over repeated noise, estimates scatter as much as each fit states."""

from __future__ import annotations

import pytest
from repetitions import scatter

# 20 of the 200 repetitions of `./dev bench`; the band: a mean of 30 correlated chi-squares of 20 degrees of freedom.
REPETITIONS = 20


@pytest.mark.quick("stanford-hidden2")
@pytest.mark.parametrize(
    ("arm", "hidden"),
    [
        ("kr30", ["joint_compliance", "joint_scale"]),
        pytest.param("irb2400", ["joint_compliance"], marks=pytest.mark.full),
        ("stanford", []),
    ],
)
def test_estimates_scatter_as_stated(arm: str, hidden: list[str]) -> None:
    found = scatter(arm, hidden, REPETITIONS)
    assert 0.8 < found.mean_square < 1.25
    assert abs(found.largest_mean) < 4.5 / REPETITIONS**0.5, f"{found.worst_mean} is biased"
    assert found.worst_p > 1e-5, f"{found.worst_chi2} scatters otherwise than stated"


@pytest.mark.full
def test_sigma_a_third_off_is_detected() -> None:
    found = scatter("kr30", ["joint_compliance", "joint_scale"], REPETITIONS, pretend=0.7)
    assert found.mean_square > 1.5
