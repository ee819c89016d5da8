"""Sigma that repeats contradict, rounded columns and a loose reflector: each gives one warning, good data none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armtrue.checking import Finding, check
from armtrue.checking.conftest import Campaign
from armtrue.checking.residuals import nominal_positions
from armtrue.checking.run import cheap_findings
from armtrue.io import Dataset, Robot


def changed(data: Dataset, **columns: np.ndarray) -> Dataset:
    return replace(data, columns={**data.columns, **columns})


def warnings(data: Dataset, robot: Robot) -> list[Finding]:
    return [finding for finding in check(data, robot).findings if finding.severity != "note"]


def rounded(data: Dataset, step: float, *names: str) -> Dataset:
    return changed(data, **{name: np.round(data.columns[name] / step) * step for name in names})


@pytest.fixture
def quiet(campaign: Campaign) -> tuple[Dataset, Robot]:
    data, robot = campaign(seed=7)
    assert warnings(data, robot) == []
    return data, robot


def test_sigma_far_below_the_scatter_of_repeats_is_a_warning(quiet: tuple[Dataset, Robot]) -> None:
    data, robot = quiet
    (found,) = warnings(changed(data, sigma=np.full(data.count, 5e-7)), robot)
    assert found.code == "sigma_too_small"
    assert "found 0.5 µm (median), less than 1/4 of what repeated poses scatter by" in found.message
    assert warnings(changed(data, sigma=np.full(data.count, 5e-6)), robot) == []


def test_sigma_is_not_compared_with_repeats_under_other_loads(quiet: tuple[Dataset, Robot]) -> None:
    data, robot = quiet
    under_others = changed(data, sigma=np.full(data.count, 5e-7), payload=np.linspace(0.0, 8.0, data.count))
    assert "sigma_too_small" not in [finding.code for finding in warnings(under_others, robot)]


def test_positions_rounded_to_tenths_of_mm_warn_of_added_noise(
    quiet: tuple[Dataset, Robot],
) -> None:
    data, robot = quiet
    # Repeats whose rounded positions are equal are not reported as duplicates.
    (found,) = warnings(rounded(data, 1e-4, *"xyz"), robot)
    assert found.code == "rounded_positions"
    assert "steps of 0.1 mm, which alone add noise of 29 µm an axis" in found.message
    assert warnings(rounded(data, 1e-5, *"xyz"), robot) == []


def test_equal_rows_are_duplicates_despite_rounded_positions(
    quiet: tuple[Dataset, Robot],
) -> None:
    data, robot = quiet
    coarse = rounded(data, 1e-4, *"xyz")
    twice = coarse.take(np.array([*range(coarse.count), 3]))
    (found,) = [finding for finding in cheap_findings(twice, robot) if finding.code == "duplicate_rows"]
    assert found.message.startswith("rows equal in every column occur more than once")


def test_joints_rounded_to_hundredths_of_a_degree_warn_of_cost(quiet: tuple[Dataset, Robot]) -> None:
    data, robot = quiet
    joints = [f"q{k}" for k in range(1, 7)]
    (found,) = warnings(rounded(data, np.radians(0.01), *joints), robot)
    assert found.code == "rounded_joints"
    assert "steps of 0.01° in q1, q2, q3, q4, q5, q6" in found.message
    assert 50e-6 < found.evidence["cost_m"] < 300e-6
    assert warnings(rounded(data, np.radians(0.0005), *joints), robot) == []


def test_joints_commanded_in_round_steps_give_no_finding(quiet: tuple[Dataset, Robot]) -> None:
    data, robot = quiet
    sent = rounded(data, np.radians(0.5), *(f"q{k}" for k in range(1, 7)))
    reached = nominal_positions(sent, robot, robot.spec["base"], robot.spec["tool"])
    reached = reached + np.random.default_rng(1).normal(0.0, 1e-5, reached.shape)
    assert warnings(changed(sent, **dict(zip("xyz", reached.T, strict=True))), robot) == []


def test_loose_reflector_is_named_from_distances_to_the_others(campaign: Campaign) -> None:
    data, robot = campaign(seed=8, targets={"names": ["A", "B", "C"]})
    assert "loose_reflector" not in [finding.code for finding in warnings(data, robot)]
    loose = (data.columns["target"] == 1.0) & (np.arange(data.count) > data.count // 2)
    rng = np.random.default_rng(1)
    shaken = {name: data.columns[name] + loose * rng.normal(0.0, 1e-4, data.count) for name in "xyz"}
    (found,) = [f for f in warnings(changed(data, **shaken), robot) if f.code == "loose_reflector"]
    assert "the distance from reflector 'B' to the others scatters by" in found.message
    assert "between 'A' and 'C' scatters by" in found.message


def test_distance_of_two_reflectors_is_compared_with_repeats(campaign: Campaign) -> None:
    data, robot = campaign(seed=8, targets={"names": ["A", "B"]})
    assert "loose_reflector" not in [finding.code for finding in warnings(data, robot)]
    # Loose only at the poses that are not repeated.
    _, of_row, sizes = np.unique(data.columns["repeat"], return_inverse=True, return_counts=True)
    loose = (data.columns["target"] == 1.0) & (sizes[of_row] == sizes.min())
    rng = np.random.default_rng(1)
    shaken = {name: data.columns[name] + loose * rng.normal(0.0, 2e-4, data.count) for name in "xyz"}
    (found,) = [f for f in warnings(changed(data, **shaken), robot) if f.code == "loose_reflector"]
    assert "between reflectors 'A' and 'B' scatters by" in found.message
