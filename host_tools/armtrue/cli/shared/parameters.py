"""Prints the parameters of a fit: with sigma, unit, the nominal value, and ties between parameters."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from armtrue.cli.shared.bounds import outside_words
from armtrue.cli.shared.output import Output, plain_table
from armtrue.io.catalogue import with_role
from armtrue.io.rotation import matrix_about, matrix_from_rpy, rpy_from_matrix
from armtrue.units import value_and_sigma

# Tables can have hundreds of parameters; more than this are shown only when asked for.
_SHOWN = 60
# From this correlation on, the combination of two parameters is known better than each of them.
_TIED = 0.95
_AXES = ("x", "y", "z")


def present_parameters(document: dict[str, Any], output: Output, everything: bool) -> None:
    """Print base and tool, then the parameters that are not held at nominal."""
    output.title("Base and tool")
    output.table(_pose_table(document))
    # Placement parameters are 0: the poses of base and tool contain their sums.
    placed = with_role("placement")
    parameters = [entry for entry in document["parameters"] if entry["effect"] not in placed]
    told = [entry for entry in parameters if not entry.get("held")]
    held = len(parameters) - len(told)
    output.title(f"{len(told)} parameters" + (f", and {held} held at nominal" if held else ""))
    if not everything and len(told) > _SHOWN:
        by_effect: dict[str, int] = {}
        for entry in told:
            by_effect[entry["effect"]] = by_effect.get(entry["effect"], 0) + 1
        output.items([f"{effect}: {count}" for effect, count in by_effect.items()])
        output.say("  (--parameters prints each)")
        told = [entry for entry in told if outside_words(entry)]
        if not told:
            return
    output.table(_parameter_table(told, document["robot"]))
    output.say("value: where the column nominal has a figure, what the fit adds to it")


def _pose_table(document: dict[str, Any]) -> Table:
    table = plain_table("", "x [mm]", "y [mm]", "z [mm]", "roll [°]", "pitch [°]", "yaw [°]")
    poses = {"base in the measuring frame": document["measuring_from_base"]}
    for target, pose in document["flange_from_tool"].items():
        poses[f"tool {target} in the flange".replace("  ", " ")] = pose
    for name, pose in poses.items():
        millimetres = [f"{1000 * value:.3f}" for value in pose["xyz"]]
        table.add_row(name, *millimetres, *(f"{math.degrees(value):.4f}" for value in pose["rpy"]))
    return table


def _parameter_table(parameters: list[dict[str, Any]], robot: dict[str, Any]) -> Table:
    table = plain_table("parameter", "value", "± sigma", "unit", "nominal", "note")
    for entry in parameters:
        value, sigma, unit = value_and_sigma(entry["value"], entry.get("sigma"), entry["unit"])
        if entry.get("fixed"):
            sigma = "fixed"
        ties = [tie for tie in entry.get("correlations", []) if abs(tie["r"]) >= _TIED]
        notes = [f"tied to {tie['with']} ({tie['r']:+.3f})" for tie in ties]
        outside = outside_words(entry)
        notes = [outside, *notes] if outside else notes
        table.add_row(entry["name"], value, sigma, unit, _nominal_words(entry, robot), ", ".join(notes))
    return table


def _nominal_words(entry: dict[str, Any], robot: dict[str, Any]) -> str:
    nominal = nominal_value(entry["name"], robot)
    if nominal is None:
        return ""
    value, unit = nominal
    return f"{1000 * value:.3f} mm" if unit == "m" else f"{math.degrees(value):.3f}°"


def nominal_value(name: str, robot: dict[str, Any]) -> tuple[float, str] | None:
    """The nominal `(value, unit)` that the parameter `name` corrects, where robot.yaml holds one; SI units."""
    joints = robot["kinematics"]["joints"]
    match = re.fullmatch(r"joint_offset\[(\d+)\]", name)
    if match:
        joint = joints[int(match[1]) - 1]
        return float(joint["offset"]), "rad" if joint["type"] == "revolute" else "m"
    match = re.fullmatch(r"link_geometry\[(\d+)\]\.([tr])([xyz])", name)
    if not match:
        return None
    translation, rpy = _link(robot["kinematics"], int(match[1]))
    axis = _AXES.index(match[3])
    return (float(translation[axis]), "m") if match[2] == "t" else (rpy[axis], "rad")


def _link(kinematics: dict[str, Any], k: int) -> tuple[NDArray[np.float64], list[float]]:
    """From frame k to the next joint (docs/model.md): translation [m] and roll, pitch, yaw [rad]."""
    joints = kinematics["joints"]
    if kinematics["convention"] == "chain":
        pose = joints[k] if k < len(joints) else kinematics["end"]
        turn = matrix_from_rpy(pose["rpy"])
        return np.asarray(pose["xyz"], dtype=np.float64), rpy_from_matrix(turn)
    if kinematics["convention"] == "dh":
        row = joints[k - 1]
        following = joints[k] if k < len(joints) else {}
        return np.array([row["a"], 0.0, row["d"]]), _turned(row["alpha"], following.get("theta", 0.0))
    if k == len(joints):
        return np.zeros(3), [0.0, 0.0, 0.0]
    row = joints[k]
    translation = matrix_about("x", row["alpha"]) @ np.array([row["a"], 0.0, row["d"]])
    return translation, _turned(row["alpha"], row.get("theta", 0.0))


def _turned(alpha_rad: float, theta_rad: float) -> list[float]:
    """Roll, pitch and yaw [rad] of a turn by alpha about x, then by theta about z (theta of a prismatic joint)."""
    return rpy_from_matrix(matrix_about("x", alpha_rad) @ matrix_about("z", theta_rad))
