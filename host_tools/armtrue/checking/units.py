"""Figures in a unit that cannot be."""

from __future__ import annotations

import numpy as np

from armtrue.checking import lengths
from armtrue.checking.alignment import Columns
from armtrue.checking.report import Finding
from armtrue.io.columns import POSITION
from armtrue.io.dataset import Dataset
from armtrue.io.plausible import wrong_units
from armtrue.io.robot import Robot


def find(data: Dataset, robot: Robot) -> list[Finding]:
    """One error for each column whose unit must be wrong."""
    return [
        Finding(
            "units",
            "error",
            f"column {name} row {data.rows[at]}: found {data.columns[name][at]:.6g}, expected {expected}",
            {"column": name, "row": int(data.rows[at]), "found": float(data.columns[name][at])},
            "Give the column's unit in a dataset.yaml, or write the file in SI units.",
        )
        for name, at, expected in wrong_units(data.columns, robot)
    ]


def positions_are_in_another(columns: Columns, robot: Robot) -> bool:
    """True where the unit of x, y, z must be wrong."""
    return any(name in POSITION for name, _, _ in wrong_units(columns, robot))


def in_si_units(columns: Columns, robot: Robot) -> Columns:
    """`columns` with joints and positions that must be in another unit brought to SI, for the checks to go on."""
    wrong = {name for name, _, _ in wrong_units(columns, robot)}
    repaired = dict(columns)
    revolute = [f"q{k}" for k, joint in enumerate(robot.joints, start=1) if joint["type"] == "revolute"]
    if wrong & set(revolute):
        repaired |= {name: np.radians(columns[name]) for name in revolute}
    if wrong & set(POSITION):
        repaired = lengths.scaled(repaired, lengths.nearest_unit(repaired, robot))
    return repaired
