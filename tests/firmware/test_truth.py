"""From measurements with noise to the tool of the real arm: fit, export, compensate, and compare with the simulator.

The simulator shares no code with the fitter, the exporter or the firmware. A compensated arm cannot miss its intended
point by less than the error of its fit; it must not miss it by more than 1.02 times that.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import arms
import armtrue_sim
import numpy as np
import pytest
from armtrue.cli.conftest import run_forked
from armtrue.tables.image import Image
from armtrue_sim.arm import Arm
from armtrue_sim.campaign import csv_text
from armtrue_sim.session import joints_of

FRESH_POSES = 400
# The device computes loads for the nominal arm at the target, the fit for the fitted arm
# (docs/decisions/0068-loads-where-the-arm-stands.md). On the softest arm, the seven-axis one, that is 0.9 µm.
LOADS_OF_THE_NOMINAL_ARM_M = 1e-6
AWAY_FROM_SINGULAR = 0.10
CASES: dict[str, list[Any]] = {
    "kr30": [
        "joint_offset",
        "link_geometry",
        "joint_compliance",
        "gear_harmonics",
        "thermal_expansion",
        "backlash",
    ],
    "irb2400": ["joint_offset", "link_geometry", "joint_compliance", "parallelogram"],
    "lbr": ["joint_offset", "link_geometry", {"effect": "joint_compliance", "joints": [2, 4, 6]}],
    "cobot": ["joint_offset", "link_geometry", "joint_compliance", "gear_harmonics"],
    "stanford": ["joint_offset", "link_geometry", "gear_harmonics"],
    "rail": ["joint_offset", "link_geometry", "joint_compliance", "gear_harmonics", "axis_straightness"],
    "scara": ["joint_offset", "link_geometry", "gear_harmonics"],
    # Its waves come from bars of wrong lengths (HIDDEN); the model lacks their exact form, and 3 µm remain.
    "palletiser": [
        "joint_offset",
        "link_geometry",
        {"effect": "joint_compliance", "joints": [2, 3, 4]},
        {"effect": "coupling_harmonics", "scale": 0.0},
    ],
}

HIDDEN = {"palletiser": ["levelling_bars"]}


def armtrue(*arguments: object) -> None:
    run_forked(*map(str, arguments)).check_returncode()


def table(path: Path) -> dict[str, np.ndarray]:
    with path.open() as stream:
        rows = list(csv.DictReader(stream))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def reach_m(arm: str) -> float:
    """The reach of the arm; the travel of a rail does not count."""
    if arm == "rail":
        return reach_m("kr30")
    return float(arms.full_arm(arm).chain.reach_m)


def smallest_singular_value(arm: Arm, joints: np.ndarray, columns: dict[str, np.ndarray]) -> np.ndarray:
    """Of the simulated arm's position Jacobian, by finite differences [m/rad]."""
    step = 1e-6
    here = arm.true_position(joints, columns, measurement_effects=False)
    moved = [
        arm.true_position(joints + step * unit, columns, measurement_effects=False)
        for unit in np.eye(joints.shape[1])[~arm.chain.passive]
    ]
    jacobian = np.stack([(there - here) / step for there in moved], axis=2)
    return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[:, -1])


@pytest.mark.quick("cobot-deflected")
@pytest.mark.parametrize(
    ("arm", "statics"),
    [
        *(("cobot", "deflected"), ("irb2400", "deflected"), ("scara", "deflected"), ("kr30", "nominal")),
        ("palletiser", "deflected"),
        *(pytest.param(*rest, marks=pytest.mark.full)
          for rest in [("kr30", "deflected"), ("lbr", "deflected"), ("stanford", "deflected"), ("rail", "deflected"),
                       ("cobot", "nominal")]),
    ],
)  # fmt: skip
def test_the_tool_reaches_the_intended_point(arm: str, statics: str, tmp_path: Path) -> None:
    campaign = armtrue_sim.simulate(
        {
            "arm": arm,
            "seed": 11,
            "statics": statics,
            # With 2 µm noise a fit can tell where loads act; with 8 µm it cannot, and assumes the deflected arm.
            "instrument": {"sigma": 8e-6 if statics == "deflected" else 2e-6},
            "repeatability": {"drive": 2.5e-6 if statics == "deflected" else 0.0},
            "believed": ["base_frame", "tool_offset", *CASES[arm]],
            "poses": 300,
            "test_poses": FRESH_POSES,
            "hidden": HIDDEN.get(arm, []),
        },
        tmp_path,
    )
    armtrue(
        "fit", tmp_path / "data.csv", "--robot", tmp_path / "robot.yaml", "--model", tmp_path / "model.yaml",
        "--out", tmp_path / "fit.json",
    )  # fmt: skip
    assert json.loads((tmp_path / "fit.json").read_text())["statics"] == statics
    armtrue("export", tmp_path / "fit.json", "--out", tmp_path / "tables.bin")
    assert Image.load(tmp_path / "tables.bin").loads_act_at() in (
        None,
        "command" if statics == "nominal" else "target",
    )
    fresh = {name: values for name, values in campaign.test.items() if name not in ("x", "y", "z")}
    (tmp_path / "poses.csv").write_text(csv_text(fresh))
    armtrue("compensate", tmp_path / "tables.bin", tmp_path / "poses.csv", "--out", tmp_path / "c.csv")
    corrected = table(tmp_path / "c.csv")
    n = campaign.arm.chain.n
    joints = joints_of(corrected, n)
    intended = np.column_stack([corrected[axis] for axis in ("tx", "ty", "tz")])
    asked = joints_of(fresh, n)
    reached = campaign.arm.true_position(joints, fresh, measurement_effects=False)
    # Not counted: postures stretched or folded, where some intended points are out of the real arm's reach or need
    # large corrections (test_accuracy.py has the measure).
    regular = smallest_singular_value(campaign.arm, asked, fresh) > AWAY_FROM_SINGULAR * reach_m(arm)
    assert regular.mean() > 0.6
    missed = np.linalg.norm(reached - intended, axis=1)[regular]

    # The fit's own error at the commands that were sent.
    sent = fresh | {name: values for name, values in corrected.items() if name in fresh}
    (tmp_path / "sent.csv").write_text(csv_text(sent))
    armtrue("predict", tmp_path / "fit.json", tmp_path / "sent.csv", "--out", tmp_path / "p.csv")
    predicted = table(tmp_path / "p.csv")
    own = np.linalg.norm(np.column_stack([predicted[axis] for axis in "xyz"]) - reached, axis=1)[regular]

    uncorrected = np.linalg.norm(
        campaign.arm.true_position(asked, fresh, measurement_effects=False) - intended, axis=1
    )[regular]
    print(
        f"{arm}, {statics}: uncorrected {1e6 * uncorrected.mean():.0f} µm, compensated {1e6 * missed.mean():.2f} µm, "
        f"fit {1e6 * own.mean():.2f} µm"
    )
    loads_m = LOADS_OF_THE_NOMINAL_ARM_M if statics == "deflected" else 0.0
    assert missed.mean() <= 1.02 * own.mean() + loads_m
    assert missed.mean() < 0.05 * uncorrected.mean()
