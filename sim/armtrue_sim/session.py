"""A session: the poses in their order, and all columns of a file except the measured positions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .arm import Arm
from .errors import ScenarioError
from .history import one_way_travel
from .mechanics.transforms import Array, quaternion_from_matrix
from .poses import random_poses
from .presets import PRESETS
from .scenario import Scenario

Table = dict[str, Array]
DECIMALS = {"q": 10, "temp": 3, "payload": 3, "time": 1, "tau": 4, "sigma": 9, "qr": 10}
# Range of the last travel before a stop if approaches are drawn, rad (m where a joint slides).
DRAWN_TRAVEL = (0.01, 0.2)


def joints_of(table: Mapping[str, Array], n: int) -> Array:
    """Columns q1...qn of a table as (N, n); a passive joint has no column and is at zero."""
    still = np.zeros(len(table["q1"]))
    return np.stack([table.get(f"q{k}", still) for k in range(1, n + 1)], axis=1)


def plan_rows(scenario: Scenario, arm: Arm, rng: np.random.Generator) -> Table:
    """Commanded columns of the data rows: joints, state, time, repeat, target."""
    repeated, times = scenario.repeats.get("poses", 0), scenario.repeats.get("times", 0)
    fresh = scenario.poses - repeated * times
    # The repeats are at the session's end, so that they separate drift from noise.
    index = np.concatenate([np.arange(fresh), np.tile(np.arange(repeated)[::-1], times)]).astype(int)
    q = random_poses(arm.robot, arm.chain, fresh, rng, scenario.floor, _joint_range(scenario, arm))[index]
    time = np.round(scenario.interval * np.arange(len(index)) + _rests(scenario, len(index)), 1)
    table: Table = {f"q{k + 1}": q[:, k] for k in range(arm.chain.n)}
    table |= _temperatures(scenario, arm, time, rng)
    payload = _payloads(scenario, fresh, rng)
    table["payload"] = np.round(payload[index], DECIMALS["payload"])
    table |= _directions(scenario, q, index, fresh, rng)
    table |= _travels(scenario, q, time)
    table |= {f"duty{k + 1}": duty for k, duty in enumerate(_duties(q, time).T)}
    table["time"] = time
    table["repeat"] = index
    table |= {name: _blocks(count, len(index)) for name, count in _setups(scenario)}
    table |= {history.column: history.along(q, time) for history in arm.histories}
    table |= _readback(scenario, arm, table, rng)
    return _with_targets(scenario, table)


def _joint_range(scenario: Scenario, arm: Arm) -> Array | None:
    if scenario.joint_range is None:
        return None
    limits = arm.chain.limits
    try:
        given = np.array(scenario.joint_range, dtype=float)
    except (TypeError, ValueError):
        given = np.empty(0)
    inside = given.shape == limits.shape and np.all(given[:, 0] <= given[:, 1])
    if not inside or np.any(given[:, 0] < limits[:, 0]) or np.any(given[:, 1] > limits[:, 1]):
        raise ScenarioError(
            f"{scenario.where}: 'joint_range' is {scenario.joint_range}, expected {arm.chain.n} pairs [low, high] "
            "inside the joint limits"
        )
    return given


def _payloads(scenario: Scenario, count: int, rng: np.random.Generator) -> Array:
    masses = np.array(
        scenario.payloads if scenario.payloads is not None else PRESETS[scenario.arm].payloads, float
    )
    if scenario.payload_order == "blocks":
        return masses[np.arange(count) * len(masses) // max(count, 1)]
    return rng.choice(masses, count)


def _temperatures(scenario: Scenario, arm: Arm, time: Array, rng: np.random.Generator) -> Table:
    """Every sensor warms from ambient by `rise` with its time constant; all but the first differ by up to 30 %.

    These also swing by `wave` each, in a time of their own, as where the sun or a door is on one side.
    """
    history = {
        "ambient": arm.reference_temperature,
        "rise": 13.0,
        "time_constant": 2000.0,
        "jitter": 0.25,
        "wave": 0.0,
    }
    history |= scenario.temperature
    columns: Table = {}
    if scenario.rests.get("cold"):
        time = _since_the_last_rest(scenario, time)
    session = np.random.default_rng([scenario.seed, 4])
    for i, sensor in enumerate(arm.sensors):
        vary = session.uniform(0.7, 1.3, 2) if i else np.ones(2)
        warmth = 1.0 - np.exp(-time / (history["time_constant"] * vary[0]))
        noise = history["jitter"] * rng.standard_normal(len(time))
        celsius = history["ambient"] + history["rise"] * vary[1] * warmth + noise
        if i and history["wave"]:
            period_s, phase = session.uniform([0.5, 0.0], [1.5, 2.0 * np.pi]) * [
                history["time_constant"],
                1.0,
            ]
            celsius = celsius + history["wave"] * np.sin(2.0 * np.pi * time / period_s + phase)
        columns[f"temp_{sensor}"] = np.round(celsius, 3)
    return columns


def _directions(scenario: Scenario, q: Array, index: Array, fresh: int, rng: np.random.Generator) -> Table:
    if scenario.directions == "random":
        signs = rng.choice([-1, 1], (fresh, q.shape[1]))[index]
    elif scenario.directions == "up":
        signs = np.ones(q.shape, dtype=int)
    else:
        # A joint that does not move keeps the side it came from; the first pose is reached from joint zeros.
        moves = np.sign(np.diff(q, axis=0, prepend=np.zeros((1, q.shape[1])))).astype(int)
        signs = np.empty_like(moves)
        last: Array = np.ones(q.shape[1], dtype=int)
        for i, move in enumerate(moves):
            last = np.where(move == 0, last, move)
            signs[i] = last
    return {f"dir{k + 1}": signs[:, k].astype(int) for k in range(q.shape[1])}


def _readback(scenario: Scenario, arm: Arm, table: Table, rng: np.random.Generator) -> Table:
    """Joints as read back: behind the command on the side of the approach, by a random lag with mean `lag`."""
    if "qr" not in scenario.columns.get("add", []):
        return {}
    count = len(table["time"])
    lag, noise = scenario.readback.get("lag", 0.0), scenario.readback.get("noise", 0.0)
    columns: Table = {}
    for k in range(1, arm.chain.n + 1):
        behind = lag * rng.exponential(1.0, count) * table[f"dir{k}"]
        read = table[f"q{k}"] - behind + noise * rng.standard_normal(count)
        columns[f"qr{k}"] = np.round(read, DECIMALS["qr"])
    return columns


def _with_targets(scenario: Scenario, table: Table) -> Table:
    names = scenario.targets.get("names")
    if not names:
        return table
    count = len(table["time"])
    if scenario.targets.get("order", "each_pose") == "cycle":
        return table | {"target": np.array([names[i % len(names)] for i in range(count)])}
    repeated = {name: np.repeat(values, len(names)) for name, values in table.items()}
    return repeated | {"target": np.array(list(names) * count)}


def fresh_rows(scenario: Scenario, arm: Arm, data: Table, rng: np.random.Generator) -> Table:
    """Test rows: new poses at random times of the session, with exact positions of the first reflector."""
    count, n = scenario.test_poses, arm.chain.n
    q = (
        random_poses(arm.robot, arm.chain, count, rng, scenario.floor, _joint_range(scenario, arm))
        if count
        else np.empty((0, n))
    )
    time = np.round(rng.uniform(0.0, max(float(data["time"].max()), scenario.interval), count), 1)
    table: Table = {f"q{k + 1}": q[:, k] for k in range(n)}
    state: Table = _temperatures(scenario, arm, time, rng)
    state["payload"] = np.round(rng.permutation(_payloads(scenario, count, rng)), DECIMALS["payload"])
    state |= {f"dir{k + 1}": rng.choice([-1, 1], count) for k in range(n)}
    state |= _ways_from(scenario, data, q, time)
    state["time"] = time
    state["repeat"] = scenario.poses + np.arange(count)
    state |= {name: np.ones(count, dtype=int) for name, _ in _setups(scenario)}
    session = joints_of(data, n), data["time"]
    state |= {history.column: history.beside(session, q, time) for history in arm.histories}
    state |= _readback(scenario, arm, table | state, rng)
    if scenario.targets.get("names"):
        state["target"] = np.array([scenario.targets["names"][0]] * count)
    rotation, exact = arm.true_pose(q, state)
    table |= {c: exact[:, i] for i, c in enumerate("xyz")}
    if "orientation" in scenario.columns.get("add", []):
        table |= quaternions(rotation)
    if "tau" in scenario.columns.get("add", []):
        torque = arm.standing_state(q, state).loads.motor_torque
        state |= {f"tau{k + 1}": np.round(torque[:, k], DECIMALS["tau"]) for k in range(n)}
    return table | state


def _rests(scenario: Scenario, count: int) -> Array:
    """Total seconds (count,) of the pauses before each row; the pauses divide the session into equal parts."""
    pauses = int(scenario.rests.get("count", 0))
    taken: Array = np.arange(count) * (pauses + 1) // max(count, 1)
    return float(scenario.rests.get("seconds", 0.0)) * taken


def _since_the_last_rest(scenario: Scenario, time: Array) -> Array:
    """Seconds from the first row after the last pause, or from the first row of all, to each time."""
    starts = scenario.interval * np.arange(scenario.poses) + _rests(scenario, scenario.poses)
    begins = np.flatnonzero(np.diff(_rests(scenario, scenario.poses), prepend=-1.0))
    first = starts[begins]
    return time - first[np.searchsorted(first, time, side="right") - 1]


def _setups(scenario: Scenario) -> list[tuple[str, int]]:
    """Columns that number set-ups, and how many there are."""
    return [
        (name, int(scenario.setups[key]))
        for name, key in (("station", "stations"), ("nest", "nests"))
        if key in scenario.setups
    ]


def _blocks(numbers: int, count: int) -> Array:
    """1 ... numbers in `numbers` equal blocks of rows."""
    return 1 + np.arange(count) * numbers // max(count, 1)


def _travels(scenario: Scenario, q: Array, time: Array) -> Table:
    """How far each joint has moved in its last direction before it stopped."""
    if scenario.directions == "order":
        return {f"travel{k}": np.abs(one_way_travel(k).along(q, time)) for k in range(1, q.shape[1] + 1)}
    return _drawn_travels(scenario, 5, q.shape)


def _drawn_travels(scenario: Scenario, stream: int, shape: tuple[int, ...]) -> Table:
    low, high = DRAWN_TRAVEL
    drawn = np.random.default_rng([scenario.seed, stream]).uniform(low, high, shape)
    return {f"travel{k + 1}": drawn[:, k] for k in range(shape[1])}


def _ways_from(scenario: Scenario, data: Table, q: Array, time: Array) -> Table:
    """Travels of fresh poses: drawn; or, if the order decides, with directions, by the path from the row before."""
    n = q.shape[1]
    session = joints_of(data, n), data["time"]
    if scenario.directions != "order":
        return _drawn_travels(scenario, 6, q.shape)
    table: Table = {}
    for k in range(1, n + 1):
        way = one_way_travel(k).beside(session, q, time)
        table |= {f"dir{k}": np.where(way < 0.0, -1, 1), f"travel{k}": np.abs(way)}
    return table


def _duties(q: Array, time: Array) -> Array:
    """Mean speed (N, n) of each joint since the row before, rad/s; the first row is reached from the joints' zeros."""
    motion = np.abs(np.diff(q, axis=0, prepend=np.zeros((1, q.shape[1]))))
    seconds = np.diff(time, prepend=2.0 * time[0] - time[1] if len(time) > 1 else -1.0)
    return motion / np.maximum(seconds, 1e-9)[:, None]


def quaternions(rotation: Array) -> Table:
    """Columns qw, qx, qy, qz of rotations (N, 3, 3)."""
    quaternion = quaternion_from_matrix(rotation)
    return {f"q{c}": np.round(quaternion[:, i], 10) for i, c in enumerate("wxyz")}
