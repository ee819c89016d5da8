"""Findings from residuals after alignment: gross errors, and a base or tool far from the stated one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.checking.alignment import Alignment
from armtrue.checking.motion import name_rows
from armtrue.checking.report import Finding
from armtrue.io.columns import commanded_joints
from armtrue.io.dataset import Dataset
from armtrue.io.robot import Robot

# A gross error is this many robust standard deviations above the median, and at least this large [m].
_GROSS_DEVIATIONS = 10.0
_GROSS_M = 3e-3
# Base and tool from a drawing are seldom more accurate than this [m].
_STATED_APART_M = 0.02


def gross_limit_m(residual_m: Array) -> float:
    """The distance [m] from which on one of `residual_m` (N,) is a gross error."""
    centre = float(np.median(residual_m))
    spread = 1.4826 * float(np.median(np.abs(residual_m - centre)))
    return max(_GROSS_M, centre + _GROSS_DEVIATIONS * spread)


def find_gross(data: Dataset, alignment: Alignment) -> Iterator[Finding]:
    """A warning that names the rows whose position stands out from all others."""
    residual = alignment.residual_m
    gross = residual > gross_limit_m(residual)
    if gross.any():
        yield Finding(
            "gross_errors",
            "warning",
            f"{name_rows(data, gross)}: up to {float(residual[gross].max()) * 1000:.1f} mm off, while half of all rows "
            f"are within {float(np.median(residual)) * 1000:.2f} mm",
            {"rows": data.rows[gross].tolist(), "residual_m": residual[gross].tolist()},
            "Check whether the reflector was bumped or another one was measured; a fit leaves such rows out.",
        )


def find_stated_poses(data: Dataset, alignment: Alignment, robot: Robot) -> Iterator[Finding]:
    """A note if base and tool of robot.yaml put the points far from where they were measured; a fit finds its own."""
    base, tool = robot.spec.get("base"), robot.spec.get("tool")
    if base is None or tool is None or len(alignment.flange_from_tool) != 1:
        return
    apart = np.linalg.norm(data.positions_m - nominal_positions(data, robot, base, tool), axis=1)
    off = float(np.median(apart))
    if off < _STATED_APART_M + 3.0 * alignment.rms_m:
        return
    found_tool = next(iter(alignment.flange_from_tool.values()))
    yield Finding(
        "base_or_tool_elsewhere",
        "note",
        f"with base and tool as robot.yaml states them the points lie {off * 1000:.0f} mm from where they are "
        "measured",
        {
            "stated": {"base": base, "tool": tool},
            "found": {"base": alignment.measuring_from_base, "tool": found_tool},
        },
        "Nothing to do for a fit, which finds both from the data; correct robot.yaml to avoid this note.",
    )


def nominal_positions(data: Dataset, robot: Robot, base: dict[str, Any], tool: dict[str, Any]) -> Array:
    """Positions (N, 3) [m] in the measuring frame with nominal kinematics and the given base and tool."""
    from armtrue import _core

    document = {
        "robot": robot.spec,
        "model": {"effects": []},
        "parameters": [],
        "measuring_from_base": base,
        "flange_from_tool": {"": tool},
    }
    joints = {name: data.columns[name] for name in commanded_joints(data.columns)}
    return np.asarray(_core.predict(json.dumps(document), joints), dtype=np.float64)
