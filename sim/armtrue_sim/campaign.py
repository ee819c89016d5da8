"""From a scenario to a campaign: the real arm, the poses, the recorded columns, and their files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .arm import MEASUREMENT_EFFECTS, Arm
from .build import build_arm, context_of, published_robot
from .effects import default_joints, mesh_orders
from .errors import ScenarioError
from .instrument import Instrument, drive_sigma_for_tool_repeatability
from .poses import random_poses
from .presets import PRESETS
from .scenario import Scenario
from .transforms import Array, exp_so3, quaternion_from_matrix

Table = dict[str, Array]
DECIMALS = {"q": 10, "temp": 3, "payload": 3, "time": 1, "tau": 4, "sigma": 9, "qr": 10}
# Keys of an entry that say which effect it is, not how large: they belong in a model file.
_SHAPE_KEYS = ("orders", "name", "coordinate", "expression")


@dataclass
class Campaign:
    """One data set in memory; `write` puts it down in the contract's form.

    robot, model: contents of robot.yaml and model.yaml. data, test: columns as in the files (equal-length arrays; test
    holds exact positions). hidden: content of hidden.json; truth: of truth.json. arm: the exact arm. exact: positions
    (N, 3) of the data rows before instrument and gross errors, drives included. unrecorded: data's columns that the
    scenario omits. gross_rows: data rows (from 0) with a gross error.
    """

    name: str
    robot: dict[str, Any]
    model: dict[str, Any]
    data: Table
    test: Table
    hidden: list[dict[str, Any]]
    truth: dict[str, Any]
    arm: Arm
    exact: Array
    unrecorded: Table
    gross_rows: list[int]

    @property
    def q(self) -> Array:
        """Commanded joints of the data rows (N, n)."""
        return joints_of(self.data, self.arm.chain.n)

    @property
    def positions(self) -> Array:
        """Measured positions (N, 3)."""
        return np.stack([self.data[c] for c in "xyz"], axis=1)

    @property
    def true_model(self) -> dict[str, Any]:
        """model.yaml of an owner who knows what is hidden: the reference that a diagnosis is held against."""
        hidden = []
        for entry in self.hidden:
            kept = {
                key: value
                for key, value in entry.items()
                if key != "joints" or (value and not _is_custom(entry))
            }
            if entry["effect"] != "none":
                hidden.append(entry["effect"] if set(kept) == {"effect"} else kept)
        return {"effects": [*self.model["effects"], *hidden]}

    def write(self, out_dir: str | Path) -> None:
        """Writes robot.yaml, model.yaml, data.csv, test.csv, hidden.json and truth.json, each beside and renamed."""
        folder = Path(out_dir)
        folder.mkdir(parents=True, exist_ok=True)
        contents = {
            "robot.yaml": yaml.safe_dump(self.robot, sort_keys=False),
            "model.yaml": yaml.safe_dump(self.model, sort_keys=False),
            "data.csv": csv_text(self.data),
            "test.csv": csv_text(self.test),
            "hidden.json": json.dumps(self.hidden) + "\n",
            "truth.json": json.dumps(self.truth, indent=1) + "\n",
        }
        for name, text in contents.items():
            beside = folder / f".{name}.{os.getpid()}"
            beside.write_text(text, encoding="utf-8")
            beside.replace(folder / name)


def _is_custom(entry: Mapping[str, Any]) -> bool:
    """A custom effect's expression says what it reads; in a model file it names no joints."""
    return bool(entry["effect"] == "custom")


def joints_of(table: Mapping[str, Array], n: int) -> Array:
    """Columns q1...qn of a table as (N, n)."""
    return np.stack([table[f"q{k}"] for k in range(1, n + 1)], axis=1)


def csv_text(table: Table) -> str:
    """A table as CSV with the decimals of its columns."""
    columns = []
    for name, values in table.items():
        if values.dtype.kind in "iu" or values.dtype.kind in "US":
            columns.append([str(v) for v in values])
        else:
            decimals = DECIMALS.get(name.rstrip("0123456789").partition("_")[0], 9)
            columns.append([f"{v:.{decimals}f}" for v in values])
    rows = (",".join(row) for row in zip(*columns, strict=True))
    return "\n".join([",".join(table), *rows]) + "\n"


def simulate(
    scenario: Scenario | Mapping[str, Any] | str | Path, out_dir: str | Path | None = None
) -> Campaign:
    """Simulates a scenario; with `out_dir` writes its files there too. The same scenario gives the same bytes.

    scenario: a Scenario, the mapping of a YAML file, or a path. Raises ScenarioError.
    """
    if isinstance(scenario, str | Path):
        scenario = Scenario.from_file(scenario)
    elif isinstance(scenario, Mapping):
        scenario = Scenario.from_dict(scenario)
    arm = build_arm(scenario)
    try:
        campaign = measure(scenario, arm)
    except ValueError as error:
        raise ScenarioError(f"{scenario.where}: {error}") from error
    if out_dir is not None:
        campaign.write(out_dir)
    return campaign


def measure(scenario: Scenario, arm: Arm) -> Campaign:
    """The campaign that the scenario's plan and instrument give on an arm (which may be other than the scenario's)."""
    plan = np.random.default_rng([scenario.seed, 1])
    noise = np.random.default_rng([scenario.seed, 2])
    table = _plan_rows(scenario, arm, plan)
    q = joints_of(table, arm.chain.n)
    drive = _drive_sigma(scenario, arm, q)
    visits = np.unique(table["time"], return_inverse=True)[1]
    settled = drive * noise.standard_normal((visits.max() + 1, arm.chain.n))[visits]
    rotation, exact = arm.true_pose(q, table, motor_error=settled)
    instrument = Instrument.from_dict(scenario.instrument, f"{scenario.where}: instrument")
    measured = exact + instrument.noise(exact, noise)
    gross_rows = _add_gross_errors(scenario, measured, noise)
    data = _with_results(scenario, arm, table, measured, rotation, instrument, noise)
    test = _test_rows(scenario, arm, table, plan)
    unrecorded = {name: data[name] for name in data if _omitted(scenario, name)}
    truth = {
        "scenario": scenario.name,
        "arm": scenario.arm,
        "seed": scenario.seed,
        "measuring_from_base": arm.measuring_from_base.xyz_rpy(),
        "flange_from_tool": {name: pose.xyz_rpy() for name, pose in arm.flange_from_tool.items()},
        "terms": [term.as_dict() for term in arm.terms],
        "linkage": arm.linkage.__dict__ | {"first_order": arm.linkage.first_order()} if arm.linkage else None,
        "instrument": {key: list(v) if isinstance(v, tuple) else v for key, v in instrument.__dict__.items()},
        "drive_repeatability": drive,
        "gross_error_rows": [row + 1 for row in gross_rows],
        "measurement_effects": sorted(MEASUREMENT_EFFECTS),
    }
    return Campaign(
        name=scenario.name,
        robot=published_robot(scenario, arm.robot),
        model={"effects": [_model_entry(e) for e in scenario.believed]},
        data={name: values for name, values in data.items() if name not in unrecorded},
        test={name: values for name, values in test.items() if not _omitted(scenario, name)},
        hidden=_hidden_entries(scenario),
        truth=truth,
        arm=arm,
        exact=exact,
        unrecorded=unrecorded,
        gross_rows=gross_rows,
    )


def _omitted(scenario: Scenario, column: str) -> bool:
    omit = scenario.columns.get("omit", [])
    return column in omit or column.rstrip("0123456789") in omit


def _model_entry(entry: Any) -> Any:
    """A scenario's entry without its sizes: what the owner of the arm would write."""
    if isinstance(entry, str):
        return entry
    kept = {key: entry[key] for key in ("effect", "joints", *_SHAPE_KEYS) if key in entry}
    return entry["effect"] if set(kept) == {"effect"} else kept


def _hidden_entries(scenario: Scenario) -> list[dict[str, Any]]:
    """What hidden.json lists; an effect between two joints comes once a pair."""
    context = context_of(scenario)
    entries = []
    for role, name, joints, sizes in scenario.entries():
        if role != "hidden":
            continue
        chosen = joints if joints is not None else default_joints(name, context)
        shape = {key: sizes[key] for key in _SHAPE_KEYS if key in sizes}
        if name == "gear_mesh":
            shape.setdefault("orders", mesh_orders(context))
        step = 2 if name == "joint_coupling" else max(len(chosen), 1)
        entries += [
            {"effect": name, "joints": chosen[i : i + step], **shape}
            for i in range(0, max(len(chosen), 1), step)
        ]
    return entries or [{"effect": "none", "joints": []}]


def _drive_sigma(scenario: Scenario, arm: Arm, q: Array) -> float:
    if "tool_mean" in scenario.repeatability:
        return drive_sigma_for_tool_repeatability(arm, q, float(scenario.repeatability["tool_mean"]))
    return float(scenario.repeatability.get("drive", 0.0))


def _plan_rows(scenario: Scenario, arm: Arm, rng: np.random.Generator) -> Table:
    """Commanded columns of the data rows: joints, state, time, repeat, target."""
    repeated, times = scenario.repeats.get("poses", 0), scenario.repeats.get("times", 0)
    fresh = scenario.poses - repeated * times
    # The repeated poses come back at the session's end, so that they tell drift from noise.
    index = np.concatenate([np.arange(fresh), np.tile(np.arange(repeated)[::-1], times)]).astype(int)
    q = random_poses(arm.robot, arm.chain, fresh, rng, scenario.floor, _joint_range(scenario, arm))[index]
    time = np.round(scenario.interval * np.arange(len(index)), 1)
    table: Table = {f"q{k + 1}": q[:, k] for k in range(arm.chain.n)}
    table |= _temperatures(scenario, arm, time, rng)
    payload = _payloads(scenario, fresh, rng)
    table["payload"] = np.round(payload[index], DECIMALS["payload"])
    table |= _directions(scenario, q, index, fresh, rng)
    table["time"] = time
    table["repeat"] = index
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
        result: Array = masses[np.arange(count) * len(masses) // max(count, 1)]
        return result
    return rng.choice(masses, count)


def _temperatures(scenario: Scenario, arm: Arm, time: Array, rng: np.random.Generator) -> Table:
    """Every sensor warms from ambient by `rise` with its time constant; sensors after the first differ by some 20 %."""
    history = {"ambient": arm.reference_temperature, "rise": 13.0, "time_constant": 2000.0, "jitter": 0.25}
    history |= scenario.temperature
    columns: Table = {}
    session = np.random.default_rng([scenario.seed, 4])
    for i, sensor in enumerate(arm.sensors):
        vary = session.uniform(0.7, 1.3, 2) if i else np.ones(2)
        warmth = 1.0 - np.exp(-time / (history["time_constant"] * vary[0]))
        noise = history["jitter"] * rng.standard_normal(len(time))
        columns[f"temp_{sensor}"] = np.round(
            history["ambient"] + history["rise"] * vary[1] * warmth + noise, 3
        )
    return columns


def _directions(scenario: Scenario, q: Array, index: Array, fresh: int, rng: np.random.Generator) -> Table:
    if scenario.directions == "random":
        signs = rng.choice([-1, 1], (fresh, q.shape[1]))[index]
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
    """Joints as read back: lagging behind the command on the side of the approach, by a random share of the lag."""
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


def _add_gross_errors(scenario: Scenario, measured: Array, rng: np.random.Generator) -> list[int]:
    """Displaces rows of `measured` in place; returns them (from 0). A bump shifts every row from one on."""
    given = scenario.gross_errors
    rows: list[int] = []
    count = int(given.get("count", 0))
    if count > len(measured):
        raise ScenarioError(
            f"{scenario.where}: gross_errors.count is {count}, there are {len(measured)} rows"
        )
    if count:
        low, high = given.get("size", [5e-4, 5e-3])
        rows = sorted(int(r) for r in rng.choice(len(measured), count, replace=False))
        direction = rng.standard_normal((count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        measured[rows] += rng.uniform(low, high, (count, 1)) * direction
    bump = given.get("bump")
    if bump:
        start = int(bump["row"]) - 1
        measured[start:] += np.asarray(bump["shift"], dtype=float)
        rows = sorted(set(rows) | set(range(start, len(measured))))
    return rows


def _with_results(
    scenario: Scenario,
    arm: Arm,
    table: Table,
    measured: Array,
    rotation: Array,
    instrument: Instrument,
    rng: np.random.Generator,
) -> Table:
    """The planned columns with the measured ones in the order of the examples: joints, position, then the rest."""
    n, add = arm.chain.n, scenario.columns.get("add", [])
    data: Table = {f"q{k}": table[f"q{k}"] for k in range(1, n + 1)}
    data |= {c: np.round(measured[:, i], 9) for i, c in enumerate("xyz")}
    if "orientation" in add:
        turned = rotation @ exp_so3(instrument.orientation * rng.standard_normal((len(rotation), 3)))
        data |= _quaternions(turned)
    data |= {name: values for name, values in table.items() if name not in data}
    if "sigma" in add:
        data["sigma"] = np.round(instrument.sigma_per_axis(measured), DECIMALS["sigma"])
    if "tau" in add:
        torque = arm.state(joints_of(table, n), table).loads.motor_torque
        torque = torque + scenario.torque_noise * rng.standard_normal(torque.shape)
        data |= {f"tau{k + 1}": np.round(torque[:, k], DECIMALS["tau"]) for k in range(n)}
    return data


def _quaternions(rotation: Array) -> Table:
    quaternion = quaternion_from_matrix(rotation)
    return {f"q{c}": np.round(quaternion[:, i], 10) for i, c in enumerate("wxyz")}


def _test_rows(scenario: Scenario, arm: Arm, data: Table, rng: np.random.Generator) -> Table:
    """Fresh poses at random moments of the session, with exact positions of the first reflector."""
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
    state["time"] = time
    state["repeat"] = scenario.poses + np.arange(count)
    state |= _readback(scenario, arm, table | state, rng)
    if scenario.targets.get("names"):
        state["target"] = np.array([scenario.targets["names"][0]] * count)
    rotation, exact = arm.true_pose(q, state)
    table |= {c: exact[:, i] for i, c in enumerate("xyz")}
    if "orientation" in scenario.columns.get("add", []):
        table |= _quaternions(rotation)
    if "tau" in scenario.columns.get("add", []):
        torque = arm.state(q, state).loads.motor_torque
        state |= {f"tau{k + 1}": np.round(torque[:, k], DECIMALS["tau"]) for k in range(n)}
    return table | state


def cli_simulate(scenario_path: str | Path, out_dir: str | Path) -> Campaign:
    """What `armtrue simulate SCENARIO --out DIR` does: one scenario file to one folder of files.

    Raises ScenarioError, whose text is the sentence for stderr, before anything is written.
    """
    folder = Path(out_dir)
    if folder.exists() and not folder.is_dir():
        raise ScenarioError(f"{folder}: is a file, expected a folder to write the campaign to")
    return simulate(Scenario.from_file(scenario_path), folder)
