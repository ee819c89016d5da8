"""Warnings where fitted compliances contradict the direction of gravity in robot.yaml."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armtrue.io.robot import STANDARD_GRAVITY, Robot
from armtrue.io.rotation import matrix_from_rpy

# No floor or foundation is tilted by this much.
_UPRIGHT_DEGREES = 20.0
# Standard deviations hold for a complete model; where effects are missing, a value may be wrong by several. Under the
# right gravity a compliance differs from 0 by a hundred.
_SURE_DEVIATIONS = 10.0
# Endings of the units of compliances.
_OF_A_SPRING = ("/Nm", "/N")


def warnings_of_springs(document: dict[str, Any], robot: Robot) -> list[str]:
    """A warning, with its remedy, where fitted springs show that gravity points another way than in robot.yaml.

    `document`: fit.json, of which `parameters` and `measuring_from_base` are read. Springs are compliances that cannot
    physically be negative; without one that has a sigma there is no warning.
    """
    springs = [
        parameter
        for parameter in document["parameters"]
        if parameter.get("sign") == 1 and parameter["unit"].endswith(_OF_A_SPRING) and parameter["sigma"]
    ]
    deviations = {parameter["name"]: parameter["value"] / parameter["sigma"] for parameter in springs}
    if not springs or max(deviations.values()) > _SURE_DEVIATIONS:
        return []
    negative = {name: value for name, value in deviations.items() if value < -_SURE_DEVIATIONS}
    gravity = robot.spec["gravity"]
    if negative:
        counts = ", ".join(f"{-value:.0f}" for value in negative.values())
        other_way = [0.0 - value for value in gravity]
        return [
            f"{', '.join(negative)} come{'s' if len(negative) == 1 else ''} out negative, by {counts} standard "
            "deviations, as if the arm rose under its weight: gravity of robot.yaml points the other way. "
            f"Give robot.yaml 'gravity: {other_way}', in the base's axes, in place of {gravity}."
        ]
    measuring_from_base = matrix_from_rpy(document["measuring_from_base"]["rpy"])
    down = measuring_from_base @ gravity
    tilt = math.degrees(math.acos(float(np.clip(-down[2] / np.linalg.norm(down), -1.0, 1.0))))
    if tilt < _UPRIGHT_DEGREES:
        return []
    # Adding 0 turns −0.0 into 0.0.
    level = [round(float(value), 2) + 0.0 for value in measuring_from_base.T @ STANDARD_GRAVITY]
    return [
        f"no joint deflects under load ({', '.join(deviations)}: found 0 within {_SURE_DEVIATIONS:.0f} standard "
        f"deviations), and gravity of robot.yaml, {gravity}, lies {tilt:.0f}° from the measuring frame's −z. "
        f"If the tracker is level (its z is up), give robot.yaml 'gravity: {level}', in the base's axes."
    ]
