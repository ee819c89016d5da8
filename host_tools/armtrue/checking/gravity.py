"""Checks of gravity: robot.yaml lacks it for a base that is not upright, or has it pointing up."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.checking.report import Finding
from armtrue.io.robot import STANDARD_GRAVITY, Robot
from armtrue.io.rotation import matrix_from_rpy

# No floor or foundation slopes by this much.
_UPRIGHT_DEGREES = 20.0
# The z axis of a level tracker is within this of the vertical; axes of other frames seldom are.
_PLUMB_DEGREES = 5.0


def find(base: dict[str, Any], robot: Robot) -> Iterator[Finding]:
    """A warning where the base is found far from upright, links have masses, and robot.yaml has no `gravity`.

    Another where its `gravity` points up in the measuring frame: some libraries state the acceleration that a sensor at
    rest measures. `base`: the frame measuring_from_base as alignments and fit.json have it, `rpy` in radians.
    """
    if not any(link["mass"] > 0.0 for link in robot.spec.get("links", [])):
        return
    measuring_from_base = matrix_from_rpy(base["rpy"])
    if robot.gravity_stated:
        gravity = np.array(robot.spec["gravity"], dtype=np.float64)
        if _degrees_from_z(measuring_from_base @ gravity) <= _PLUMB_DEGREES:
            down = [-float(value) + 0.0 for value in gravity]
            yield Finding(
                "gravity_upwards",
                "warning",
                f"'gravity' of robot.yaml, {gravity.tolist()}, points up in the measuring frame: springs would deflect "
                "against their loads",
                {"gravity": down},
                f"If the tracker is level (its z is up), write 'gravity: {down}', the direction in which things fall.",
            )
        return
    tilt = _degrees_from_z(measuring_from_base[:, 2])
    if tilt < _UPRIGHT_DEGREES:
        return
    # Adding 0 turns −0.0 into 0.0.
    down = [round(float(value), 2) + 0.0 for value in measuring_from_base.T @ STANDARD_GRAVITY]
    yield Finding(
        "gravity_not_given",
        "warning",
        f"the base is found {tilt:.0f}° from upright in the measuring frame, and gravity is taken along the "
        "base's −z, as robot.yaml has no 'gravity'",
        {"tilt_rad": math.radians(tilt), "gravity": down},
        f"If the tracker is level (its z is up), give robot.yaml 'gravity: {down}'; else give it gravity in the "
        f"base's axes, or 'gravity: {STANDARD_GRAVITY}' where it is right as it is.",
    )


def _degrees_from_z(direction: Array) -> float:
    return math.degrees(math.atan2(math.hypot(direction[0], direction[1]), direction[2]))
