"""Figures in a unit that cannot be."""

from __future__ import annotations

import re

import numpy as np

from armtrue.checking import lengths
from armtrue.checking.alignment import Columns, alignment_columns
from armtrue.checking.report import Finding
from armtrue.io.columns import POSITION
from armtrue.io.dataset import Dataset, fixed_targets, without_fixed_targets
from armtrue.io.plausible import too_few_poses, wrong_units
from armtrue.io.robot import Robot

_LIKELY = re.compile(r"\(these look like .*\)")


def find(data: Dataset, robot: Robot) -> list[Finding]:
    """One error for each column whose unit must be wrong."""
    findings = []
    for name, at, expected in wrong_units(data.columns, robot):
        evidence = {"column": name, "row": int(data.rows[at]), "found": float(data.columns[name][at])}
        if name in POSITION and (scale := _scale(data, robot)):
            # The arm tells more than the size of a figure.
            expected = _LIKELY.sub(f"(these look like {lengths.words_of_points(scale)})", expected)
            evidence |= {"scale": scale, "unit": lengths.unit_of_points(scale, robot)}
        findings.append(
            Finding(
                "units",
                "error",
                f"column {name} row {data.rows[at]}: found {data.columns[name][at]:.6g}, expected {expected}",
                evidence,
                "Give the column's unit in a dataset.yaml, or write the file in SI units.",
            )
        )
    return findings


def _scale(data: Dataset, robot: Robot) -> float | None:
    """How many times too large positions are, where that is the scale of a known unit."""
    riding = without_fixed_targets(data) if fixed_targets(data) else data
    if too_few_poses(riding.joints):
        return None
    scale = lengths.scale_of(_joints_in_si_units(alignment_columns(riding), robot), robot)
    return scale if lengths.unit_of_points(scale, robot) else None


def positions_are_in_another(columns: Columns, robot: Robot) -> bool:
    """True where the unit of x, y, z must be wrong."""
    return any(name in POSITION for name, _, _ in wrong_units(columns, robot))


def in_si_units(columns: Columns, robot: Robot) -> Columns:
    """`columns` with joints and positions that must be in another unit brought to SI, for the checks to go on."""
    repaired = _joints_in_si_units(columns, robot)
    if positions_are_in_another(columns, robot):
        repaired = lengths.scaled(repaired, lengths.nearest_unit(repaired, robot))
    return repaired


def _joints_in_si_units(columns: Columns, robot: Robot) -> Columns:
    wrong = {name for name, _, _ in wrong_units(columns, robot)}
    revolute = [f"q{k}" for k, joint in enumerate(robot.joints, start=1) if joint["type"] == "revolute"]
    if not wrong & set(revolute):
        return columns
    return columns | {name: np.radians(columns[name]) for name in revolute}
