"""From a scenario to a campaign: the real arm, the poses, the recorded columns, and their files."""

from __future__ import annotations

import json
import os
import shutil
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
from .mechanics.transforms import Array, exp_so3
from .scenario import Scenario
from .session import DECIMALS, Table, fresh_rows, joints_of, plan_rows, quaternions

# Keys of an entry that define an effect's form, not its size: they belong in a model file.
_SHAPE_KEYS = ("orders", "name", "coordinate", "expression")
BETWEEN_TWO = ("joint_coupling", "coupling_harmonics", "cross_compliance")


@dataclass
class Campaign:
    """One data set in memory; `write` writes it to files in the contract's form.

    robot, model: contents of robot.yaml and model.yaml. data, test: columns as in the files (equal-length arrays; test
    holds exact positions). hidden: content of hidden.json; truth: of truth.json. arm: the exact arm. exact: positions
    (N, 3) of the data rows with the errors of the drives, without those of the instrument and gross errors. unrecorded:
    columns of data that the scenario omits. gross_rows: data rows (from 0) with a gross error.
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
        """model.yaml with the hidden effects added: the reference to which a diagnosis is compared."""
        hidden = []
        for entry in self.hidden:
            # A custom effect's expression states its variables: it has no joints in a model file.
            has_joints = entry["joints"] and entry["effect"] != "custom"
            kept = {key: value for key, value in entry.items() if key != "joints" or has_joints}
            if entry["effect"] != "none":
                hidden.append(entry["effect"] if set(kept) == {"effect"} else kept)
        return {"effects": [*self.model["effects"], *hidden]}

    def write(self, out_dir: str | Path) -> None:
        """Writes robot.yaml, model.yaml, data.csv, test.csv, hidden.json and truth.json: all of them or none."""
        folder = Path(out_dir)
        is_new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        contents = {
            "robot.yaml": yaml.safe_dump(self.robot, sort_keys=False),
            "model.yaml": yaml.safe_dump(self.model, sort_keys=False),
            "data.csv": csv_text(self.data),
            "test.csv": csv_text(self.test),
            "hidden.json": json.dumps(self.hidden) + "\n",
            "truth.json": json.dumps(self.truth, indent=1) + "\n",
        }
        beside = {name: folder / f".{name}.{os.getpid()}" for name in contents}
        try:
            for name, text in contents.items():
                beside[name].write_text(text, encoding="utf-8")
            for name, path in beside.items():
                path.replace(folder / name)
        except BaseException:  # a full disk, an interrupt
            for path in beside.values():
                path.unlink(missing_ok=True)
            if is_new:
                shutil.rmtree(folder, ignore_errors=True)
            raise


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
    """Measures an arm, which may differ from the scenario's, with the scenario's plan and instrument."""
    plan = np.random.default_rng([scenario.seed, 1])
    noise = np.random.default_rng([scenario.seed, 2])
    table = plan_rows(scenario, arm, plan)
    q = joints_of(table, arm.chain.n)
    drive = _drive_sigma(scenario, arm, q)
    joint_sigma = _joint_sigmas(scenario, arm, drive)
    visits = np.unique(table["time"], return_inverse=True)[1]
    settled = joint_sigma * noise.standard_normal((visits.max() + 1, arm.chain.n))[visits]
    rotation, exact = arm.true_pose(q, table, motor_error=settled)
    instrument = Instrument.from_dict(scenario.instrument, f"{scenario.where}: instrument")
    seen = arm.tracker.as_seen(exact, rotation, table, np.array(instrument.position))
    measured = seen + instrument.noise(exact, noise)
    gross_rows = _add_gross_errors(scenario, measured, noise)
    turned = arm.tracker.turned(rotation, table)
    data = _with_results(scenario, arm, table, measured, turned, instrument, noise)
    test = fresh_rows(scenario, arm, table, plan)
    unrecorded = {name: data[name] for name in data if _omitted(scenario, arm, name)}
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
        "joint_repeatability": [float(v) for v in joint_sigma],
        "links": [{"mass": link.mass, "com": [float(v) for v in link.com]} for link in arm.heavy.links],
        "gravity": [float(v) for v in arm.heavy.gravity],
        "payload_centre": [float(v) for v in arm.body.payload_centre],
        "tracker": arm.tracker.as_dict(),
        "gross_error_rows": [row + 1 for row in gross_rows],
        "measurement_effects": sorted(MEASUREMENT_EFFECTS),
    }
    return Campaign(
        name=scenario.name,
        robot=published_robot(scenario, arm.robot),
        model={"effects": [_model_entry(e) for e in scenario.believed]},
        data={name: values for name, values in data.items() if name not in unrecorded},
        test={name: values for name, values in test.items() if not _omitted(scenario, arm, name)},
        hidden=_hidden_entries(scenario),
        truth=truth,
        arm=arm,
        exact=exact,
        unrecorded=unrecorded,
        gross_rows=gross_rows,
    )


def _omitted(scenario: Scenario, arm: Arm, column: str) -> bool:
    omit, stem = scenario.columns.get("omit", []), column.rstrip("0123456789")
    seldom = stem.startswith("_") or (
        stem in ("travel", "duty") and stem not in scenario.columns.get("add", [])
    )
    number = column[len(stem) :]
    of_motor = stem in ("q", "qr", "dir", "tau", "travel", "duty") and number
    passive = bool(of_motor) and bool(arm.chain.passive[int(number) - 1])
    return seldom or passive or column in omit or stem in omit


def _model_entry(entry: Any) -> Any:
    """A scenario's entry without its sizes, as the owner of the arm would write it."""
    if isinstance(entry, str):
        return entry
    kept = {key: entry[key] for key in ("effect", "joints", *_SHAPE_KEYS) if key in entry}
    if entry.get("soft"):
        kept["soft"] = True
    return entry["effect"] if set(kept) == {"effect"} else kept


def _hidden_entries(scenario: Scenario) -> list[dict[str, Any]]:
    """Entries of hidden.json; an effect between two joints has one entry per pair."""
    context = context_of(scenario)
    entries = []
    for role, name, joints, sizes in scenario.entries():
        if role != "hidden":
            continue
        chosen = joints if joints is not None else default_joints(name, context)
        shape = {key: sizes[key] for key in _SHAPE_KEYS if key in sizes}
        if sizes.get("soft"):
            shape["soft"] = True
        if name == "gear_mesh":
            shape.setdefault("orders", mesh_orders(context))
        step = 2 if name in BETWEEN_TWO else max(len(chosen), 1)
        entries += [
            {"effect": name, "joints": chosen[i : i + step], **shape}
            for i in range(0, max(len(chosen), 1), step)
        ]
    return entries or [{"effect": "none", "joints": []}]


def _drive_sigma(scenario: Scenario, arm: Arm, q: Array) -> float:
    if "tool_mean" in scenario.repeatability:
        return drive_sigma_for_tool_repeatability(arm, q, float(scenario.repeatability["tool_mean"]))
    return float(scenario.repeatability.get("drive", 0.0))


def _joint_sigmas(scenario: Scenario, arm: Arm, drive: float) -> Array:
    """Repeatability of each joint (n,), rad or m, one standard deviation."""
    sigmas = np.where(arm.chain.passive, 0.0, drive)
    for joint, sigma in scenario.repeatability.get("joints", {}).items():
        if not isinstance(joint, int) or not 1 <= joint <= arm.chain.n:
            raise ScenarioError(
                f"{scenario.where}: repeatability.joints has {joint!r}, expected joints from 1 to {arm.chain.n}"
            )
        sigmas[joint - 1] = float(sigma)
    return sigmas


def _add_gross_errors(scenario: Scenario, measured: Array, rng: np.random.Generator) -> list[int]:
    """Displaces rows of `measured` in place; returns them (from 0). A bump shifts all rows from its row on."""
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
    """Planned and measured columns in the order of the examples: joints, position, then the rest."""
    n, add = arm.chain.n, scenario.columns.get("add", [])
    data: Table = {f"q{k}": table[f"q{k}"] for k in range(1, n + 1)}
    data |= {c: np.round(measured[:, i], 9) for i, c in enumerate("xyz")}
    if "orientation" in add:
        turned = rotation @ exp_so3(instrument.orientation * rng.standard_normal((len(rotation), 3)))
        data |= quaternions(turned)
    data |= {name: values for name, values in table.items() if name not in data}
    if "sigma" in add:
        data["sigma"] = np.round(instrument.sigma_per_axis(measured), DECIMALS["sigma"])
    if "tau" in add:
        torque = arm.standing_state(joints_of(table, n), table).loads.motor_torque
        torque = torque + scenario.torque_noise * rng.standard_normal(torque.shape)
        data |= {f"tau{k + 1}": np.round(torque[:, k], DECIMALS["tau"]) for k in range(n)}
    return data


def cli_simulate(scenario_path: str | Path, out_dir: str | Path) -> Campaign:
    """What `armtrue simulate SCENARIO --out DIR` does: one scenario file to one folder of files.

    Raises ScenarioError, whose text is the sentence for stderr, before anything is written.
    """
    folder = Path(out_dir)
    if folder.exists() and not folder.is_dir():
        raise ScenarioError(f"{folder}: is a file, expected a folder to write the campaign to")
    return simulate(Scenario.from_file(scenario_path), folder)
