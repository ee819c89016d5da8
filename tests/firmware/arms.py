"""Fits with known truth: a simulated arm's own terms written as a fit.json, nothing estimated.

A compensator's output for such a fit can be compared with the fitted model in double precision and with the simulator,
which shares no code with either.
"""

from __future__ import annotations

import functools
import itertools
import json
import pathlib
import re
import tempfile
from typing import Any

import numpy as np
import yaml
from armtrue.io import load_robot
from armtrue.tables import FittedArm, Surroundings, fitted_arm
from armtrue_sim.arm import MEASUREMENT_EFFECTS, Arm
from armtrue_sim.build import build_arm
from armtrue_sim.scenario import Scenario

Array = np.ndarray

# Every effect of the catalogue that is exported, on arms of each kind. `residual_grid` and `transmission_pwl` of the
# simulator have their own shapes; tests add their tables by `with_tables`.
ALL_EFFECTS: dict[str, list[Any]] = {
    "kr30": [
        "joint_offset", "link_geometry", "joint_scale", "joint_compliance", "stiffness_nonlinear", "bending_compliance",
        "base_compliance", "gravity_balancer", "gear_harmonics", "gear_mesh", "backlash", "joint_coupling",
        "thermal_expansion", "thermal_joint_drift", "thermal_base", "warm_up",
    ],
    "irb2400": [
        "joint_offset", "link_geometry", "joint_compliance", "bending_compliance", "gear_harmonics", "gear_mesh",
        "backlash", "thermal_expansion",
    ],
    "cobot": [
        "joint_offset", "link_geometry", "joint_compliance", "stiffness_nonlinear", "base_compliance", "gear_harmonics",
        "gear_mesh", "backlash", "thermal_joint_drift",
    ],
    "lbr": [
        "joint_offset", "link_geometry", "joint_scale", "joint_compliance", "bending_compliance", "gear_harmonics",
        "gear_mesh", "thermal_expansion",
    ],
    "stanford": ["joint_offset", "link_geometry", "joint_compliance", "gear_harmonics", "thermal_expansion"],
    "scara": ["joint_offset", "link_geometry", "joint_compliance", "gear_harmonics", "backlash"],
    "palletiser": [
        "joint_offset", "link_geometry", {"effect": "joint_compliance", "joints": [2, 3, 4]}, "gear_harmonics",
        {"effect": "coupling_harmonics", "joints": [4, 2, 4, 3]}, "thermal_expansion",
    ],
}  # fmt: skip

# Too few motors for an attitude: the damped step approximates position and attitude, and meets neither exactly.
FOUR_MOTORS = ("scara", "palletiser")

# The simulator's parallelogram is the exact four-bar; these are the linear terms that a fit of it has.
EXTRA_TERMS: dict[str, list[tuple[str, str, float]]] = {
    "irb2400": [
        ("link3.rz", "1/sin((1.6707963267948966 + th3))", 2e-4),
        ("link3.rz", "cos((1.6707963267948966 + th3))/sin((1.6707963267948966 + th3))", -1.5e-4),
        ("link3.rz", "cos(q2)/sin((1.6707963267948966 + th3))", 1e-4),
        ("link3.rz", "sin(q2)/sin((1.6707963267948966 + th3))", 1.2e-4),
    ],
}


@functools.cache
def simulated(arm: str, seed: int = 1) -> Arm:
    """An exact arm that has every effect."""
    return build_arm(
        Scenario.from_dict({"arm": arm, "seed": seed, "believed": [], "hidden": ALL_EFFECTS[arm]})
    )


def normalised_robot(content: dict[str, Any]) -> dict[str, Any]:
    """robot.yaml's content as the fitter keeps it in fit.json."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder, "robot.yaml")
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        return load_robot(path).spec


# Error figures of a fit without measurements.
NO_FIGURES = dict.fromkeys(("mean_um", "rms_um", "p95_um", "max_um"))


def document_of(arm: Arm, robot: dict[str, Any]) -> dict[str, Any]:
    """The fit.json that an estimator without any error would write for `arm`."""
    tools = {name: pose.xyz_rpy() for name, pose in arm.flange_from_tool.items()}
    return {
        "format": "armtrue-fit",
        "version": 1,
        "robot": normalised_robot(robot),
        "model": {"effects": []},
        "data": {"path": "nowhere.csv", "relative": "nowhere.csv", "sha256": "0" * 64},
        "options": {"folds": 5, "seed": 0},
        "error": {
            **dict.fromkeys(("nominal", "train", "held_out"), NO_FIGURES),
            "held_out_by": dict.fromkeys(("random", "time", "region"), NO_FIGURES),
        },
        **{key: {} for key in ("noise", "noise_floor", "solver")},
        **{key: [] for key in ("rejected", "nonlinear", "unobservable", "warnings")},
        "measuring_from_base": arm.measuring_from_base.xyz_rpy(),
        "flange_from_tool": tools,
        "payload_point": [float(v) for v in arm.nominal_tool.translation],
        "parameters": [
            parameter(
                term.coordinate,
                # A device computes the gravity torque; what a balancer takes off it is not in these arms' tables.
                re.sub(r"\bload(\d+)", r"tau\1", term.expression),
                term.value,
                effect=term.effect,
                exported=term.effect not in MEASUREMENT_EFFECTS,
            )
            for term in arm.terms
        ],
    }


def parameter(
    coordinate: str,
    expression: str,
    value: float,
    *,
    effect: str = "custom",
    exported: bool = True,
    table: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """One parameter of a fit.json with one term."""
    term = {"coordinate": coordinate, "expression": expression, "weight": 1.0, "table": table}
    return {
        "name": f"{effect}.{coordinate}",
        "effect": effect,
        "joints": [],
        "value": float(value),
        "unit": "",
        "exported": exported,
        "terms": [term],
    }


def hat(variable: str, nodes: list[float], index: int) -> str:
    """The basis of one node of a table: beyond the ends it falls to zero over the outermost cell's width."""
    padded = [nodes[0] - (nodes[1] - nodes[0]), *nodes, nodes[-1] + (nodes[-1] - nodes[-2])]
    left, centre, right = padded[index : index + 3]
    return f"hat({variable}, {left!r}, {centre!r}, {right!r})"


def table_parameters(joint: int, nodes: list[float], values: Array) -> list[dict[str, Any]]:
    """A 1-D table on a motor side, as transmission_pwl makes it."""
    variable = f"q{joint}"
    table = {"id": f"transmission_pwl[{joint}]", "axes": [{"variable": variable, "nodes": nodes}]}
    return [
        parameter(
            f"motor{joint}",
            hat(variable, nodes, i),
            value,
            effect="transmission_pwl",
            table={**table, "index": [i]},
        )
        for i, value in enumerate(values)
    ]


def with_tables(
    document: dict[str, Any],
    *,
    spacing_rad: float | None = np.radians(3.0),
    grid_nodes: int | None = None,
    seed: int = 7,
) -> dict[str, Any]:
    """`document` with smooth random tables on every turning joint and a grid over joints 1 to 3."""
    rng = np.random.default_rng(seed)
    rows = document["robot"]["kinematics"]["joints"]
    limits = [row.get("limits") or [-np.pi, np.pi] for row in rows]
    extra = []
    for k, (low, high) in enumerate(limits):
        if spacing_rad is None or rows[k].get("type") == "prismatic":
            continue
        count = int(np.ceil((high - low) / spacing_rad)) + 1
        nodes = [float(v) for v in np.linspace(low, high, count)]
        at = np.array(nodes)
        values = sum(
            6e-5 * rng.normal() * np.sin(order * at + rng.uniform(0.0, 6.28)) for order in (5, 9, 14, 22)
        )
        extra += table_parameters(k + 1, nodes, np.asarray(values))
    if grid_nodes:
        extra += _grid_parameters([limits[k] for k in range(3)], grid_nodes, rng)
    return {**document, "parameters": [*document["parameters"], *extra]}


def _grid_parameters(limits: list[list[float]], count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    axes = [
        {"variable": f"q{a + 1}", "nodes": [float(v) for v in np.linspace(*limits[a], count)]}
        for a in range(3)
    ]
    result = []
    for index in itertools.product(range(count), repeat=3):
        basis = "*".join(hat(axis["variable"], axis["nodes"], i) for axis, i in zip(axes, index, strict=True))
        for component in ("tx", "ty", "tz"):
            table = {"id": f"residual_grid.{component}", "axes": axes, "index": list(index)}
            result.append(
                parameter(
                    f"link1.{component}", basis, 5e-5 * rng.normal(), effect="residual_grid", table=table
                )
            )
    return result


@functools.cache
def full_document(arm: str, *, grid_nodes: int | None = None, seed: int = 1) -> str:
    """Every effect and 3 degree tables, as JSON text: the result is cached, and text cannot be changed."""
    exact = simulated(arm, seed)
    document = document_of(exact, exact.robot)
    document["parameters"] += [parameter(*term, effect="parallelogram") for term in EXTRA_TERMS.get(arm, [])]
    return json.dumps(with_tables(document, grid_nodes=grid_nodes))


def full_arm(arm: str, *, grid_nodes: int | None = None, seed: int = 1, geometry: float = 1.0) -> FittedArm:
    """The arm of `full_document`, its lengths and zeros `geometry` times as far from nominal."""
    document = json.loads(full_document(arm, grid_nodes=grid_nodes, seed=seed))
    for entry in document["parameters"]:
        if entry["effect"] in ("joint_offset", "link_geometry"):
            entry["value"] *= geometry
    return fitted_arm(document, arm)


def random_surroundings(
    arm: FittedArm, rows: int, rng: np.random.Generator, payload_max: float
) -> Surroundings:
    """Random temperatures, payloads, times and approach directions within usual ranges."""
    return Surroundings(
        {sensor: rng.uniform(10.0, 45.0, rows) for sensor in arm.chain.sensors},
        payload=rng.uniform(0.0, payload_max, rows),
        time=rng.uniform(0.0, 4e4, rows),
        direction=rng.choice([-1.0, 0.0, 1.0], (rows, arm.chain.joint_count)),
    )


def random_joints(arm: FittedArm, rows: int, rng: np.random.Generator) -> Array:
    """Random commands at which the arm can stand: within the limits, its linkage not folded."""
    low, high = arm.chain.limits.T
    poses = rng.uniform(low, high, (4 * rows, arm.chain.joint_count))
    return poses[arm.chain.can_stand(poses)][:rows]
