"""Joints and positions that were written in coarse steps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from armtrue.arrays import Array, rms_length
from armtrue.checking.report import Finding
from armtrue.io.dataset import Dataset
from armtrue.io.robot import Robot

if TYPE_CHECKING:
    from armtrue.fitting import Fit

# Usual rounding steps, coarsest first; no arm resolves finer ones [m, rad].
_LENGTHS_M = [digit * 10.0**power for power in range(-2, -7, -1) for digit in (5, 2, 1)]
_DEGREES = [math.radians(digit * 10.0**power) for power in range(0, -5, -1) for digit in (5, 2, 1)]
_ANGLES = sorted(
    [*_DEGREES, *(digit * 10.0**power for power in range(-2, -6, -1) for digit in (5, 2, 1))], reverse=True
)
# A column with fewer distinct values has those of a plan.
_FEWEST_VALUES = 10
# Tolerance in steps: radians that were converted from rounded degrees are rounded once more.
_OFF_STEP = 0.01
# Smaller errors at the tool, all axes together, do not matter for an arm [m].
_LEAST_M = 20e-6
# Rounding of less than this share of the noise is lost in it.
_SHARE_OF_NOISE = 0.5
# If a fit leaves less than this share of the cost of rounding, the arm went to the rounded angles.
_SHARE_LEFT = 0.7


def position_step_m(data: Dataset) -> float:
    """The step [m] to which positions are rounded; 0 where they are finer than a micrometre."""
    return _step(data.positions_m.ravel(), _LENGTHS_M)


def find(data: Dataset, robot: Robot, geometry: Fit, noise_m: float) -> list[Finding]:
    """Warnings where rounding adds an error that is not negligible beside the noise.

    `geometry`: a fit to rows of `data`. `noise_m`: scatter of repeats, all axes together; inf without repeats.
    """
    left_m = rms_length(geometry.residuals())
    least_m = max(_LEAST_M, _SHARE_OF_NOISE * min(noise_m, left_m))
    return [*_of_positions(data, least_m), *_of_joints(data, robot, geometry, left_m, least_m)]


def _of_positions(data: Dataset, least_m: float) -> Iterator[Finding]:
    step = position_step_m(data)
    cost = _deviation(step)
    if cost * math.sqrt(3.0) < least_m:
        return
    yield Finding(
        "rounded_positions",
        "warning",
        f"{data.file.name} columns x, y, z: found steps of {step * 1e3:g} mm, which alone add noise of "
        f"{cost * 1e6:.0f} µm an axis (step/√12)",
        {"step_m": step, "cost_m": cost},
        "Write x, y and z to a micrometre, as instruments give them.",
    )


def _of_joints(
    data: Dataset, robot: Robot, geometry: Fit, left_m: float, least_m: float
) -> Iterator[Finding]:
    costs: dict[int, float] = {}
    steps: dict[str, list[str]] = {}
    for k in robot.motors:
        is_angle = robot.joints[k - 1]["type"] == "revolute"
        step = _step(data.columns[f"q{k}"], _ANGLES if is_angle else _LENGTHS_M)
        cost = _deviation(step) * rms_length(geometry.coordinate_column(f"motor{k}"))
        # The steps of a joint that was sent to rounded angles, as on a grid, are no errors.
        if 0.0 < _SHARE_LEFT * cost <= left_m:
            costs[k] = cost
            steps.setdefault(_words(step, is_angle), []).append(f"q{k}")
    cost = math.hypot(*costs.values())
    if cost < least_m or _SHARE_LEFT * cost > left_m:
        return
    found = "; ".join(f"steps of {step} in {', '.join(names)}" for step, names in steps.items())
    yield Finding(
        "rounded_joints",
        "warning",
        f"{data.file.name}: found {found}: unless the arm was sent to just these values, they put the tool off by "
        f"{cost * 1e6:.0f} µm RMS (step/√12 on each joint)",
        {"cost_m": cost, "cost_of_joints_m": {str(k): own for k, own in costs.items()}},
        "Write the joints with the digits that the controller has, to 0.0001° and 0.001 mm.",
    )


def _step(values: Array, steps: Sequence[float]) -> float:
    """The largest of `steps`, in falling order, that all `values` are multiples of; 0 for none."""
    if np.unique(values).size < _FEWEST_VALUES:
        return 0.0
    for step in steps:
        multiples = values / step
        if np.abs(multiples - np.round(multiples)).max() < _OFF_STEP:
            return step
    return 0.0


def _deviation(step: float) -> float:
    """Standard deviation of the error of rounding to `step`."""
    return step / math.sqrt(12.0)


def _words(step: float, is_angle: bool) -> str:
    if not is_angle:
        return f"{step * 1e3:g} mm"
    return f"{math.degrees(step):g}°" if step in _DEGREES else f"{step:g} rad"
