"""Gravity of robot.yaml: left at its default of an arm that hangs or stands on a wall, or of a wrong direction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armtrue.checking.report import Finding
from armtrue.io.robot import STANDARD_GRAVITY, Robot
from armtrue.io.rotation import matrix_from_rpy

# Floors and foundations are never as oblique.
_UPRIGHT_DEGREES = 20.0
# Standard deviations hold for a model that is complete. One that lacks effects errs by several; under the right
# gravity springs are known by a hundred.
_SURE_DEVIATIONS = 10.0
# Units of what gives way under a load.
_OF_A_SPRING = ("/Nm", "/N")


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


def find_contradictions(
    parameters: list[dict[str, Any]], base: dict[str, Any], robot: Robot
) -> list[Finding]:
    """A warning where fitted springs say that gravity points another way than in robot.yaml.

    `parameters`, `base`: `parameters` and `measuring_from_base` of fit.json. Springs are the parameters that a load
    moves and that physics allows no negative value; nothing is said where the model has none of known value.
    """
    springs = [
        parameter
        for parameter in parameters
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
            Finding(
                "gravity_contradicted",
                "warning",
                f"{', '.join(negative)} come{'s' if len(negative) == 1 else ''} out negative, by {counts} standard "
                "deviations, as if the arm rose under its weight: gravity of robot.yaml points the other way",
                {"deviations": negative, "gravity": gravity},
                f"Give robot.yaml 'gravity: {other_way}', in the base's axes, in place of {gravity}.",
            )
        ]
    down = matrix_from_rpy(base["rpy"]) @ gravity
    tilt = math.degrees(math.acos(float(np.clip(-down[2] / np.linalg.norm(down), -1.0, 1.0))))
    if tilt < _UPRIGHT_DEGREES:
        return []
    level = [round(float(value), 2) + 0.0 for value in matrix_from_rpy(base["rpy"]).T @ STANDARD_GRAVITY]
    return [
        Finding(
            "gravity_contradicted",
            "warning",
            f"the arm gives way nowhere ({', '.join(deviations)}: found 0 within {_SURE_DEVIATIONS:.0f} standard "
            f"deviations), and gravity of robot.yaml, {gravity}, lies {tilt:.0f}° from the measuring frame's −z",
            {"deviations": deviations, "gravity": gravity, "tilt_rad": math.radians(tilt)},
            f"If the tracker is level (its z is up), give robot.yaml 'gravity: {level}', in the base's axes.",
        )
    ]
