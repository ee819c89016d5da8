"""Repeats are compared only where set-up, seat, reflector and load are the same; in one set-up drift is still found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armtrue.checking import check
from armtrue.checking.conftest import Campaign
from armtrue.checking.run import cheap_findings
from armtrue.io import Dataset, Robot
from armtrue.io.rotation import matrix_about, matrix_from_rpy
from armtrue.tables.chain import flanges

FIRST = 120


def with_points(data: Dataset, points: np.ndarray, **more: np.ndarray) -> Dataset:
    columns = dict(zip("xyz", np.ascontiguousarray(points.T), strict=True))
    return replace(data, columns={**data.columns, **columns, **more})


def from_two_set_ups(data: Dataset, second: np.ndarray, shift_m: float = 3.0) -> Dataset:
    """`data` where the rows `second` (N,) were seen by a tracker that stood elsewhere, and column station says so."""
    elsewhere = data.positions_m @ matrix_about("z", 0.4 * shift_m).T + [shift_m, -0.3 * shift_m, 0.0]
    return with_points(data, np.where(second[:, None], elsewhere, data.positions_m), station=1.0 + second)


def without(data: Dataset, name: str) -> Dataset:
    return replace(data, columns={key: values for key, values in data.columns.items() if key != name})


def messages(data: Dataset, robot: Robot) -> dict[str, str]:
    return {finding.code: finding.message for finding in check(data, robot).findings}


@pytest.fixture
def half_way(campaign: Campaign) -> tuple[Dataset, Robot]:
    """A campaign whose tracker was moved half way; its repeats lie on both sides."""
    data, robot = campaign(seed=8)
    return from_two_set_ups(data, np.arange(data.count) >= FIRST), robot


def test_repeats_from_two_set_ups_are_no_drift(half_way: tuple[Dataset, Robot]) -> None:
    # A drift of three metres was reported.
    assert "repeats_drift" not in messages(*half_way)


def test_drift_within_each_set_up_is_reported(campaign: Campaign) -> None:
    """Sixty poses in four rounds, two rounds from each set-up."""
    data, robot = campaign(seed=8)
    rounds = data.take(np.tile(np.arange(60), 4))
    noise = np.random.default_rng(3).normal(0.0, 1e-5, (rounds.count, 3))
    more = {"time": 25.0 * np.arange(240.0), "repeat": np.tile(np.arange(60.0), 4)}
    rounds = with_points(rounds, rounds.positions_m + noise, **more)
    second = np.arange(240) >= 120
    assert "repeats_drift" not in messages(from_two_set_ups(rounds, second), robot)
    rising = with_points(rounds, rounds.positions_m + np.outer(np.linspace(0.0, 1.0, 240), [0.0, 0.0, 5e-4]))
    found = messages(from_two_set_ups(rising, second), robot)["repeats_drift"]
    assert found.startswith("repeated poses moved by 5")


def test_scatter_of_repeats_is_that_within_a_set_up(half_way: tuple[Dataset, Robot]) -> None:
    data, robot = half_way
    found = messages(without(data, "repeat"), robot)["repeated_poses"]
    scatter_um = float(found.split("scatter by ")[1].split(" µm")[0])
    assert scatter_um < 60.0
    stated = with_points(data, data.positions_m, sigma=np.full(data.count, 15e-6))
    assert not {"sigma_too_small", "sigma_too_large"} & set(messages(stated, robot))


def test_repeats_under_other_loads_are_no_drift(campaign: Campaign) -> None:
    data, robot = campaign(seed=8)
    later = np.arange(data.count) >= FIRST
    sags = data.positions_m - later[:, None] * [0.0, 0.0, 3e-3]
    assert "repeats_drift" in messages(with_points(data, sags, payload=np.zeros(data.count)), robot)
    loaded = with_points(data, sags, payload=8.0 * later)
    assert "repeats_drift" not in messages(loaded, robot)


def test_fixed_reflector_seen_from_two_set_ups_did_not_move(campaign: Campaign) -> None:
    data, robot = campaign(seed=8)
    nest = np.arange(data.count) % 10 == 5
    noise = np.random.default_rng(2).normal(0.0, 1e-5, (data.count, 3))
    points = np.where(nest[:, None], noise + np.array([1.0, -2.0, 0.3]), data.positions_m)
    watched = with_points(data, points, target=nest.astype(float))
    watched = replace(watched, labels={**data.labels, "target": ["tool", "floor"]})
    assert "fixed_reflector" in messages(watched, robot)
    # A set-up 0.4 mm off in a common frame is still the same fixed reflector.
    later = np.arange(data.count) >= FIRST
    seen = with_points(watched, watched.positions_m + later[:, None] * [4e-4, 0.0, 0.0], station=1.0 + later)
    assert "base_drift" not in messages(seen, robot)
    assert "base_drift" in messages(without(seen, "station"), robot)


def test_distances_of_reflectors_are_not_taken_across_set_ups(campaign: Campaign) -> None:
    """At each pose the first set-up sees A, the second one A, B and C."""
    data, robot = campaign(seed=8, targets={"names": ["A", "B", "C"]})
    first, *others = (np.flatnonzero(data.columns["target"] == code) for code in (0.0, 1.0, 2.0))
    rows = np.stack([first, first, *others], axis=1).ravel()
    assert all(np.array_equal(data.joints[first], data.joints[other]) for other in others)
    seen = from_two_set_ups(data.take(rows), np.arange(rows.size) % 4 > 0)
    assert "loose_reflector" not in [finding.code for finding in cheap_findings(seen, robot)]


def test_reflector_put_back_into_another_seat_is_not_loose(campaign: Campaign) -> None:
    data, robot = campaign(seed=8, targets={"names": ["A", "B", "C"]})
    later = np.arange(data.count) >= data.count // 2
    base = matrix_from_rpy(robot.spec["base"]["rpy"])
    offset = base @ flanges(data.columns, robot.spec)[:, :3, :3] @ np.array([1e-3, -2e-3, 1e-3])
    moved = later & (data.columns["target"] == 1.0)
    seats = with_points(data, data.positions_m + moved[:, None] * offset, nest=1.0 + later)
    assert "loose_reflector" not in [finding.code for finding in cheap_findings(seats, robot)]
