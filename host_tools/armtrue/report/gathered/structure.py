"""Unexplained structure, ready to draw: a curve over one variable, or means of the residual over two."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.report.gathered.binned import DISCRETE, Binned, binned
from armtrue.report.gathered.state import Direction, Variable, axis_of, reading, state_variable
from armtrue.report.gathered.steps import Step
from armtrue.report.scales import tick_text

_MOST_GROUPS = 4  # more values of the second variable than this are grouped in thirds
_THIRDS = 3


@dataclass(frozen=True)
class Part:
    """Bin means of the rows whose second variable has the value or range that `label` names."""

    label: str
    means: Binned


@dataclass(frozen=True)
class Finding:
    """A dependence that no effect explains.

    `entry`: as diagnose gives it. `over`: label of the x axis, `along` of the y axis. For one variable, `x` and `y` are
    the function that the diagnosis found; for two, `parts` are means of the residual for each value or third of the
    second variable `by`. All are empty where the data have no variable for it. `turned`: True where orientations were
    measured, too; the diagnosis uses them, `parts` do not.
    """

    entry: dict[str, Any]
    over: str = ""
    along: str = ""
    by: str = ""
    x: Array | None = None
    y: Array | None = None
    parts: list[Part] = field(default_factory=list)
    turned: bool = False

    @property
    def where(self) -> str:
        """Where it acts, in words; empty where that is not known."""
        coordinate = self.entry.get("coordinate")
        return f" on {coordinate_words(coordinate)}" if coordinate else ""

    @property
    def drawn(self) -> bool:
        """True where there is something to draw."""
        return self.x is not None or bool(self.parts)


def findings_of(step: Step, result: dict[str, Any]) -> list[Finding]:
    """What a diagnosis of `step` cannot explain, one finding for each variable and coordinate."""
    found: dict[tuple[str, str], Finding] = {}
    for entry in result["unexplained"]:
        key = (entry["variable"], entry.get("coordinate", ""))
        if key not in found:
            found[key] = _finding(step, entry)
    return list(found.values())


def coordinate_words(coordinate: str) -> str:
    """`motor2` as `joint 2`, `base.rz` as `base, turn about z`."""
    if motor := re.fullmatch(r"motor(\d+)", coordinate):
        return f"joint {motor[1]}"
    frame, _, component = coordinate.partition(".")
    words = re.sub(r"^link(\d+)$", r"link \1", frame)
    return f"{words}, {'turn about' if component[0] == 'r' else 'shift along'} {component[1]}"


def _finding(step: Step, entry: dict[str, Any]) -> Finding:
    names = entry.get("variables", [])
    if not names:
        return Finding(entry)
    coordinate = entry["coordinate"]
    motor = re.fullmatch(r"motor(\d+)", coordinate)
    slides = motor and step.fit.robot.joints[int(motor[1]) - 1].get("type") == "prismatic"
    turns = not slides if motor else ".r" in coordinate
    direction = reading(step.fit, coordinate, coordinate_words(coordinate), turns)
    along = f"{direction.what} [{direction.unit}]"
    if len(names) > 1:
        return _by_two(step, entry, direction, along)
    curve = entry.get("curve") or {"x": []}
    if len(curve["x"]) < 2:
        return Finding(entry)
    what, unit, factor = axis_of(step.fit, names[0])
    x, y = np.array(curve["x"]) / factor, np.array(curve["y"]) / direction.size
    return Finding(entry, f"{what} [{unit}]" if unit else what, along, x=x, y=y)


def _by_two(step: Step, entry: dict[str, Any], direction: Direction, along: str) -> Finding:
    first, second = (state_variable(step.fit, name) for name in entry["variables"][:2])
    if np.unique(first.values).size <= DISCRETE < np.unique(second.values).size:
        first, second = second, first
    used = step.used
    readings = direction.read(step.residual_m)
    parts = []
    for label, inside in _groups(second):
        rows = inside & used
        if rows.any():
            parts.append(Part(label, binned(first.values[rows], readings[rows], direction.weight[rows])))
    parts = [part for part in parts if part.means.centre.size]
    turned = step.fit.document["noise"]["sigma_rotation_rad"] is not None
    return Finding(entry, first.label, along, by=second.what, parts=parts, turned=turned)


def _groups(variable: Variable) -> list[tuple[str, NDArray[np.bool_]]]:
    """Rows by value of a variable, or by thirds where it has many; each with words for it."""
    unit = variable.unit if variable.unit in ("", "°") else f" {variable.unit}"
    distinct = np.unique(variable.values)
    if distinct.size <= _MOST_GROUPS:
        return [(f"{tick_text(float(v))}{unit}", variable.values == v) for v in distinct]
    edges = np.quantile(variable.values, np.linspace(0.0, 1.0, _THIRDS + 1))
    which = np.searchsorted(edges[1:-1], variable.values, side="right")
    ends = [tick_text(float(f"{edge:.3g}")) for edge in edges]
    return [(f"{ends[k]} to {ends[k + 1]}{unit}", which == k) for k in range(_THIRDS)]
