"""Tables of fits, diagnoses and checks for a notebook, as HTML or text in place of Python's default repr.

The terminal, the report and the workbench take base, tool and nominal values of parameters from here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.candidates import name
from armtrue.io.catalogue import with_role
from armtrue.io.rotation import matrix_about, matrix_from_rpy, rpy_from_matrix
from armtrue.units import value_and_sigma
from armtrue.verdicts import (
    ERROR_FIGURES,
    FLOOR_SOURCES,
    PARTS_OF_ERROR,
    chance,
    error_words,
    length_words,
    verdict_words,
    why_words,
)

_MOST_ROWS = 60
_AXES = ("x", "y", "z")
POSE_HEADERS = ("", "x [mm]", "y [mm]", "z [mm]", "roll [°]", "pitch [°]", "yaw [°]")


def html_table(headers: Sequence[str], rows: Iterable[Sequence[str]], caption: str) -> str:
    """A table of escaped texts."""
    head = "".join(f"<th>{escape(header)}</th>" for header in headers)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def error_rows(document: Mapping[str, Any]) -> list[list[str]]:
    """Name and figures [µm] of each part of a fit's error."""
    error = document["error"]
    return [[words, *error_words(error[part])] for part, words in PARTS_OF_ERROR.items() if error.get(part)]


def floor_sentence(document: Mapping[str, Any]) -> str:
    """The noise floor of a fit and its source."""
    floor = document.get("noise_floor") or {}
    if floor.get("um") is None:
        return "noise floor: not known, as the data hold no repeats and no sigma"
    source = floor.get("source", "none")
    return f"noise floor: {floor['um']:.1f} µm ({FLOOR_SOURCES.get(source, source)})"


def fit_text(document: Mapping[str, Any]) -> str:
    """A fit as a table of text: errors, noise floor, effects."""
    width = max(len(words) for words in PARTS_OF_ERROR.values())
    rows = [["error [µm]", *ERROR_FIGURES.values()], *error_rows(document)]
    lines = [f"{row[0]:{width}}" + "".join(f"{cell:>10}" for cell in row[1:]) for row in rows]
    effects = "; ".join(name(entry) for entry in document["model"]["effects"])
    return "\n".join([*lines, floor_sentence(document), f"effects: {effects}"])


def fit_html(document: Mapping[str, Any]) -> str:
    """A fit as a notebook shows it: errors, noise floor, effects, and parameters with their standard deviations."""
    errors = html_table(["error [µm]", *ERROR_FIGURES.values()], error_rows(document), "Error of the fit")
    rows = []
    told = [entry for entry in beside_the_poses(document) if not entry.get("held")]
    for entry in told[:_MOST_ROWS]:
        value, sigma, unit = value_and_sigma(entry["value"], entry.get("sigma"), entry["unit"])
        rows.append([entry["name"], value, sigma, unit])
    more = len(told) - len(rows)
    caption = f"Parameters{f', the first {len(rows)} of {len(told)}' if more else ''}"
    effects = "; ".join(name(entry) for entry in document["model"]["effects"])
    return (
        errors
        + f"<p>{escape(floor_sentence(document))}<br>effects: {escape(effects)}</p>"
        + html_table(POSE_HEADERS, pose_rows(document), "Base and tool")
        + html_table(["parameter", "value", "± sigma", "unit"], rows, caption)
    )


def diagnosis_html(diagnosis: Mapping[str, Any]) -> str:
    """A diagnosis as a notebook shows it: the verdict and the candidates, most evidence first."""
    rows = []
    for candidate in diagnosis["candidates"][:10]:
        why = "recommended" if candidate["recommend"] else why_words(candidate)
        explained, after = f"{100 * candidate['explained']:.1f} %", candidate["held_out_mean_um_if_added"]
        rows.append([name(candidate), chance(candidate["probability"]), explained, length_words(after), why])
    headers = ["candidate", "probability", "explains", "held-out mean if added [µm]", ""]
    return f"<p>{escape(verdict_words(dict(diagnosis)))}</p>" + html_table(headers, rows, "Candidates")


def pose_rows(document: Mapping[str, Any]) -> list[list[str]]:
    """Base and tools of a fit under the POSE_HEADERS."""
    poses = {"base in the measuring frame": document["measuring_from_base"]}
    for target, pose in document["flange_from_tool"].items():
        poses[f"tool {target} in the flange".replace("  ", " ")] = pose
    rows = []
    for what, pose in poses.items():
        lengths = [f"{1000 * value:.3f}" for value in pose["xyz"]]
        rows.append([what, *lengths, *(f"{math.degrees(value):.4f}" for value in pose["rpy"])])
    return rows


def beside_the_poses(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Parameters without those of the placement: these are 0, as the poses of base and tool contain their sums."""
    placed = with_role("placement")
    return [entry for entry in document["parameters"] if entry["effect"] not in placed]


def nominal_words(parameter: str, robot: dict[str, Any]) -> str:
    """The nominal value that `parameter` corrects, with its unit; empty where robot.yaml holds none."""
    nominal = nominal_value(parameter, robot)
    if nominal is None:
        return ""
    value, unit = nominal
    # + 0.0: what rounds to zero has no minus sign.
    shown, sign = (1000 * value, " mm") if unit == "m" else (math.degrees(value), "°")
    return f"{round(shown, 3) + 0.0:.3f}{sign}"


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
