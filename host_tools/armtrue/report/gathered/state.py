"""The state variables that the residual may depend on, and the directions along which it is read."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue import _core
from armtrue.arrays import Array
from armtrue.fitting import Fit
from armtrue.report.parts import ARCSECOND
from armtrue.tables.chain import chain_from_robot, pose

_DEGREE = np.pi / 180.0
_MICROMETRE = 1e-6
_HOUR = 3600.0
# Names of the variables of docs/model.md, with the display unit and its size in SI.
_STATE = {
    "th": ("link angle {}", "°", _DEGREE),
    "dir": ("direction joint {} came from", "", 1.0),
    "payload": ("payload", "kg", 1.0),
    "tau": ("gravity torque on joint {}", "Nm", 1.0),
    "gmx": ("gravity moment about x of link {}", "Nm", 1.0),
    "gmy": ("gravity moment about y of link {}", "Nm", 1.0),
    "bmx": ("gravity moment about x of the base", "Nm", 1.0),
    "bmy": ("gravity moment about y of the base", "Nm", 1.0),
}
# Variables that move less than this share of their size have not moved.
_STANDSTILL = 1e-9
# Residuals are not read as the error of a joint if its axis is nearer to the reflector than this share of the largest
# distance: they would show little but noise.
_TINY_LEVER = 0.01
# Rows with the reflector nearer to an axis than this share of its median distance do not show that axis's angle.
_SHORT_LEVER = 0.25


def joint_unit(joint: dict[str, Any]) -> tuple[str, float]:
    """The display unit of a joint's variable, and its size in SI."""
    return ("mm", 1e-3) if joint.get("type") == "prismatic" else ("°", _DEGREE)


def axis_of(fit: Fit, name: str) -> tuple[str, str, float]:
    """Name of a state variable of docs/model.md, its display unit, and that unit's size in SI."""
    found = re.fullmatch(r"([a-zA-Z]+)(\d*)", name)
    stem, number = found.groups() if found else (name, "")
    if stem == "q":
        return f"joint {number}", *joint_unit(fit.robot.joints[int(number) - 1])
    if stem == "time":
        return "time", "h", _HOUR
    if name.startswith("dT"):
        return f"temperature {name[3:]} above its reference".replace("  ", " "), "K", 1.0
    words, unit, factor = _STATE.get(stem, (name, "", 1.0))
    return words.format(number), unit, factor


def state_variable(fit: Fit, name: str) -> Variable:
    """A state variable of docs/model.md over the fitted rows, in its display unit."""
    what, unit, factor = axis_of(fit, name)
    return Variable(name, what, unit, fit.state_column(name) / factor)


@dataclass(frozen=True)
class Variable:
    """A state variable over the fitted rows, in its display unit. `values` (N,); `joint`: its joint, 0 for none."""

    name: str
    what: str
    unit: str
    values: Array
    joint: int = 0

    @property
    def label(self) -> str:
        """The label of an axis."""
        return f"{self.what} [{self.unit}]" if self.unit else self.what


@dataclass(frozen=True)
class Direction:
    """A way to read a residual vector as one number: `values = Σ along · residual`, with `weight` (N,) in means.

    `along` (N, 3) contains the conversion to `unit`; `drawn` (N,): mask of the rows to draw as dots.
    """

    name: str
    what: str
    unit: str
    along: Array
    weight: Array
    drawn: NDArray[np.bool_]

    @property
    def size(self) -> float:
        """Its unit in SI."""
        return ARCSECOND if self.unit == "″" else _MICROMETRE

    def read(self, residual_m: Array) -> Array:
        """The residuals (N, 3) [m] along this direction, in `unit`."""
        return np.asarray(np.einsum("ij,ij->i", self.along, residual_m))


def independent(residual: Array, lever: Array, visit: NDArray[np.intp]) -> float:
    """Number of independent readings in the residuals r (N, k) along a coordinate's columns `lever` g (N, k).

    It is k per row where residuals have random directions, one per `visit` (N,) where all point along g: Σ r² is
    compared with the scatter of g·r (White, Econometrica 48, 1980). Residuals and levers must be in units of the same
    noise, positions and orientations alike.
    """
    along = float(np.sum(np.bincount(visit, np.einsum("ij,ij->i", lever, residual)) ** 2))
    return float(np.sum(residual**2) * np.sum(lever**2)) / along if along > 0.0 else float(residual.size)


def variables(fit: Fit) -> list[Variable]:
    """Every state variable that varies over the fitted rows: joints, loads, temperatures, directions, place, time."""
    columns = fit.data.columns
    joints = fit.robot.joints
    numbers = range(1, len(joints) + 1)
    found: list[Variable] = []

    def add(name: str, what: str, unit: str, values: Array, joint: int = 0) -> None:
        if np.ptp(values) > _STANDSTILL * max(1.0, float(np.max(np.abs(values)))):
            found.append(Variable(name, what, unit, values, joint))

    def derive(name: str, joint: int = 0) -> None:
        with contextlib.suppress(_core.ModelError):  # masses or a column that it needs are missing
            derived = state_variable(fit, name)
            add(name, derived.what, derived.unit, derived.values, joint)

    for k in numbers:
        unit, factor = joint_unit(joints[k - 1])
        add(f"q{k}", f"joint {k}", unit, columns[f"q{k}"] / factor, k)
        if f"qr{k}" in columns:
            apart = (columns[f"q{k}"] - columns[f"qr{k}"]) / factor
            add(f"q{k}−qr{k}", f"joint {k}, commanded less read back", unit, apart)
    for entry in fit.robot.spec.get("coupling", []):
        derive(f"th{entry['joint']}")
    for k in numbers:
        derive(f"tau{k}", k)
    for k in numbers:
        derive(f"gmx{k}")
        derive(f"gmy{k}")
    derive("bmx")
    derive("bmy")
    for sensor in fit.robot.sensors:
        if f"temp_{sensor}" in columns:
            add(f"temp_{sensor}", f"temperature {sensor}", "°C", columns[f"temp_{sensor}"])
    if "payload" in columns:
        add("payload", "payload", "kg", columns["payload"])
    for k in numbers:
        if f"dir{k}" in columns:
            add(f"dir{k}", f"direction joint {k} came from", "", columns[f"dir{k}"], k)
    for axis, values in zip("xyz", fit.data.positions_m.T, strict=True):
        add(axis, f"reflector's {axis}", "m", values)
    if "time" in columns:
        add("time", "time", "h", (columns["time"] - columns["time"].min()) / _HOUR)
    return found


def directions(fit: Fit) -> list[Direction]:
    """The residual along x, y and z of the measuring frame, and as an error of a joint's angle (or travel).

    Joints of `tiny_levers` are left out.
    """
    count = fit.data.count
    everywhere = np.ones(count, dtype=np.bool_)
    found = []
    for axis, along in zip("xyz", np.eye(3) / _MICROMETRE, strict=True):
        each = np.tile(along, (count, 1))
        found.append(Direction(axis, f"error along {axis}", "µm", each, np.ones(count), everywhere))
    tiny = tiny_levers(fit)
    for number, joint in enumerate(fit.robot.joints, start=1):
        if number not in tiny:
            turns = joint.get("type") != "prismatic"
            found.append(reading(fit, f"motor{number}", f"error as joint {number}", turns))
    return found


def reading(fit: Fit, coordinate: str, what: str, turns: bool) -> Direction:
    """The residual as an error of one coordinate: by least squares at each pose, (g·e) / (g·g)."""
    lever = fit.coordinate_column(coordinate)
    square = np.einsum("ij,ij->i", lever, lever)
    unit, factor = ("″", ARCSECOND) if turns else ("µm", _MICROMETRE)
    along = lever / np.maximum(square, 1e-12 * (float(square.max()) or 1.0))[:, None] / factor
    drawn = square > _SHORT_LEVER**2 * float(np.median(square))
    return Direction(coordinate, what, unit, along, square, drawn)


def turned_by(fit: Fit, number: int) -> Array:
    """Rotation of the tool per unit of motor `number` (1-based): (N, 3), about the measuring frame's axes."""
    chain = chain_from_robot(fit.document["robot"])
    measuring_from_base = pose(fit.document["measuring_from_base"])[:3, :3]
    result = np.zeros((fit.data.count, 3))
    for k, frames in enumerate(chain.frames(fit.data.joints)):
        if not chain.prismatic[k]:
            result += chain.coupling[k, number - 1] * frames[:, :3, 2] @ measuring_from_base.T
    return result


def tiny_levers(fit: Fit) -> dict[int, float]:
    """Revolute joints (1-based) whose angle hardly moves the reflector, by its median distance from their axis [m]."""
    levers = {}
    for number, joint in enumerate(fit.robot.joints, start=1):
        if joint.get("type") != "prismatic":
            lever = fit.coordinate_column(f"motor{number}")
            levers[number] = float(np.median(np.linalg.norm(lever, axis=1)))
    longest = max(levers.values(), default=0.0)
    return {number: lever for number, lever in levers.items() if lever <= _TINY_LEVER * longest}
