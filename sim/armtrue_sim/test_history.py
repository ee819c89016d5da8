"""States that depend on the path to a pose: travel, warmth."""

import numpy as np

from .campaign import simulate
from .history import one_way_travel, warmth
from .session import joints_of


def test_travel_counts_from_the_last_reversal():
    q = np.array([[0.2], [0.5], [0.4], [0.1], [0.3], [0.3]])
    time = np.arange(6.0)
    assert np.allclose(one_way_travel(1).along(q, time), [0.2, 0.5, -0.1, -0.4, 0.2, 0.2])


def test_constant_duty_warms_with_the_time_constant_and_rest_cools():
    gear = warmth(1, tau=100.0, full_speed=0.01)
    time = np.concatenate([np.arange(1.0, 301.0), [400.0]])
    q = np.concatenate([0.01 * np.arange(1.0, 301.0), [3.0]])[:, None]
    warm = gear.along(q, time)
    assert np.allclose(warm[:300], 1.0 - np.exp(-time[:300] / 100.0), atol=1e-12)
    assert np.isclose(warm[300], warm[299] * np.exp(-1.0))


def test_new_pose_is_reached_from_the_last_row_before_its_time():
    q, time = np.array([[0.1], [0.5], [0.2]]), np.array([0.0, 10.0, 20.0])
    beside = one_way_travel(1).beside(
        (q, time), np.array([[0.7], [0.0], [0.1]]), np.array([12.0, 25.0, 12.0])
    )
    assert np.allclose(beside, [0.7, -0.5, -0.4])


def test_directions_by_order_agree_with_travel():
    campaign = simulate({"arm": "kr30", "poses": 60, "directions": "order", "columns": {"add": ["travel"]}})
    for table in (campaign.data, campaign.test):
        assert {f"travel{k}" for k in range(1, 7)} <= set(table)
    way = one_way_travel(2).along(joints_of(campaign.data, 6), campaign.data["time"])
    assert np.array_equal(np.sign(way), campaign.data["dir2"])
    assert np.allclose(np.abs(way), campaign.data["travel2"])


def test_internal_states_are_in_no_file():
    campaign = simulate({"arm": "kr30", "poses": 40, "hidden": [{"effect": "self_heating", "joints": [2]}]})
    assert "_warm2" in campaign.unrecorded
    assert not any(name.startswith(("_", "travel", "duty")) for name in {*campaign.data, *campaign.test})


def test_gears_cool_in_pauses():
    plan = {"arm": "kr30", "poses": 90, "hidden": [{"effect": "self_heating", "joints": [2], "tau": 600.0}]}
    warm = simulate(plan | {"rests": {"count": 2, "seconds": 6000.0}}).unrecorded["_warm2"]
    assert warm[30] < 0.3 * warm[29]
    assert warm[60] < 0.3 * warm[59]


def test_cold_pause_restarts_the_temperature_history():
    plan = {"arm": "kr30", "poses": 90, "temperature": {"time_constant": 600.0, "jitter": 0.0}}
    kept = simulate(plan | {"rests": {"count": 2, "seconds": 6000.0}}).data["temp_arm"]
    cold = simulate(plan | {"rests": {"count": 2, "seconds": 6000.0, "cold": True}})
    again = cold.data["temp_arm"]
    assert np.all(np.diff(kept) >= 0.0)
    assert np.array_equal(again[:30], kept[:30])
    assert np.allclose([again[30:60], again[60:]], again[:30], atol=2e-3)
    assert cold.data["time"][30] - cold.data["time"][29] == 6025.0
    assert cold.test["temp_arm"].min() < again[10]
