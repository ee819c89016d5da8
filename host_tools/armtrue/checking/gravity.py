"""Check for an arm that hangs or stands on a wall while robot.yaml does not state gravity."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armtrue.checking.report import Finding
from armtrue.io.robot import STANDARD_GRAVITY, Robot
from armtrue.io.rotation import matrix_from_rpy

# Floors and foundations are never as oblique.
_UPRIGHT_DEGREES = 20.0


def find(base: dict[str, Any], robot: Robot) -> list[Finding]:
    """A warning where the base is found far from upright, links have masses, and robot.yaml has no `gravity`.

    `base`: the frame measuring_from_base as alignments and fit.json have it, `rpy` in radians.
    """
    if robot.gravity_stated or not any(link["mass"] > 0.0 for link in robot.spec.get("links", [])):
        return []
    measuring_from_base = matrix_from_rpy(base["rpy"])
    tilt = math.degrees(math.acos(float(np.clip(measuring_from_base[2, 2], -1.0, 1.0))))
    if tilt < _UPRIGHT_DEGREES:
        return []
    # Adding 0 turns −0.0 into 0.0.
    down = [round(float(value), 2) + 0.0 for value in measuring_from_base.T @ STANDARD_GRAVITY]
    return [
        Finding(
            "gravity_not_given",
            "warning",
            f"the base is found {tilt:.0f}° from upright in the measuring frame, and gravity is taken along the "
            "base's −z, as robot.yaml has no 'gravity'",
            {"tilt_rad": math.radians(tilt), "gravity": down},
            f"If the tracker is level (its z is up), give robot.yaml 'gravity: {down}'; else give it gravity in the "
            f"base's axes, or 'gravity: {STANDARD_GRAVITY}' where it is right as it is.",
        )
    ]
