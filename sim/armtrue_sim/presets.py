"""The arms by name: nominal robot.yaml dictionaries and the sizes of the errors of an arm of that kind.

Sizes follow "Sizes that are real" in shared/reading/calibration.md; where it is silent, decision 0021 gives the source.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import yaml

from .errors import ScenarioError
from .mechanics.transforms import Pose, rot_x


@dataclass(frozen=True)
class Preset:
    """Error sizes and properties of a kind of arm. Ranges are (low, high).

    payloads: kg at the tool point. torsion: rad/Nm of each motor axis (m/N where prismatic). bending, base_tilt:
    rad/Nm.
    strain_wave: gears of that kind (larger mesh error, at twice the motor turn). wrist_pairs: (driven, driving) joints.
    compliant: joints whose torsion a believed model holds. tool: flange to reflector, metres. reach: metres.
    """

    payloads: tuple[float, ...]
    torsion: tuple[tuple[float, float], ...]
    bending: tuple[float, float]
    base_tilt: tuple[float, float]
    strain_wave: bool
    wrist_pairs: tuple[tuple[int, int], ...]
    compliant: tuple[int, ...]
    tool: tuple[float, float, float]
    reach: float


_HEAVY = ((5e-7, 1.2e-6), (1e-6, 2.5e-6), (1e-6, 2.5e-6), (4e-6, 1.2e-5), (4e-6, 1.2e-5), (8e-6, 2e-5))
_MIDDLE = ((8e-7, 2e-6), (1.2e-6, 3e-6), (1.2e-6, 3e-6), (8e-6, 2e-5), (8e-6, 2e-5), (1e-5, 4e-5))
_LIGHT = ((1e-5, 4e-5), (2e-5, 5e-5), (2e-5, 5e-5), (4e-5, 9e-5), (4e-5, 9e-5), (4e-5, 9e-5))
_WRIST = ((5, 4), (6, 4), (6, 5))
# Joint 4 yields by the stretch of its bars, the others by the torsion of their gears.
_HUGE = ((1e-7, 3e-7), (1.5e-7, 4e-7), (2e-7, 5e-7), (4e-7, 1.2e-6), (3e-6, 1e-5))

PRESETS: dict[str, Preset] = {
    "kr30": Preset(
        payloads=(0.0, 8.0, 16.0),
        torsion=_HEAVY,
        bending=(1e-7, 5e-7),
        base_tilt=(3e-8, 2e-7),
        strain_wave=False,
        wrist_pairs=_WRIST,
        compliant=(2, 3),
        tool=(0.06, 0.03, 0.16),
        reach=2.0,
    ),
    "irb2400": Preset(
        payloads=(0.0, 8.0, 16.0),
        torsion=_MIDDLE,
        bending=(2e-7, 8e-7),
        base_tilt=(6e-8, 3e-7),
        strain_wave=False,
        wrist_pairs=_WRIST,
        compliant=(2, 3),
        tool=(0.06, 0.03, 0.16),
        reach=1.6,
    ),
    "cobot": Preset(
        payloads=(0.0, 2.4, 4.8),
        torsion=_LIGHT,
        bending=(3e-6, 1.2e-5),
        base_tilt=(1.5e-6, 7e-6),
        strain_wave=True,
        wrist_pairs=_WRIST,
        compliant=(2, 3),
        tool=(0.08, -0.01, 0.17),
        reach=1.3,
    ),
    "lbr": Preset(
        payloads=(0.0, 2.5, 7.5),
        torsion=(*_LIGHT, (4e-5, 9e-5)),
        bending=(4e-6, 1.5e-5),
        base_tilt=(2e-6, 8e-6),
        strain_wave=True,
        wrist_pairs=(),
        compliant=(2, 4, 6),
        tool=(0.06, 0.03, 0.14),
        reach=0.9,
    ),
    "scara": Preset(
        payloads=(0.0, 1.5, 3.0),
        torsion=((1e-5, 3e-5), (1e-5, 3e-5), (5e-7, 2e-6), (4e-5, 9e-5)),
        bending=(1e-5, 4e-5),
        base_tilt=(2e-6, 8e-6),
        strain_wave=True,
        wrist_pairs=(),
        compliant=(3,),
        tool=(0.04, 0.02, 0.06),
        reach=0.6,
    ),
    "stanford": Preset(
        payloads=(0.0, 2.0, 4.0),
        torsion=((5e-6, 1e-5), (8e-6, 2e-5), (2e-7, 8e-7), (2e-5, 6e-5), (2e-5, 6e-5), (4e-5, 9e-5)),
        bending=(1e-6, 6e-6),
        base_tilt=(5e-7, 2e-6),
        strain_wave=False,
        wrist_pairs=_WRIST,
        compliant=(2, 3),
        tool=(0.05, 0.02, 0.12),
        reach=1.1,
    ),
    "rail": Preset(
        payloads=(0.0, 8.0, 16.0),
        torsion=((1e-8, 3e-8), *_HEAVY),
        bending=(1e-7, 5e-7),
        base_tilt=(3e-8, 2e-7),
        strain_wave=False,
        wrist_pairs=((6, 5), (7, 5), (7, 6)),
        compliant=(3, 4),
        tool=(0.06, 0.03, 0.16),
        reach=2.0,
    ),
    "palletiser": Preset(
        payloads=(0.0, 120.0, 240.0),
        torsion=_HUGE,
        bending=(2e-8, 8e-8),
        base_tilt=(5e-9, 3e-8),
        strain_wave=False,
        wrist_pairs=((4, 2), (4, 3)),
        compliant=(2, 3),
        tool=(0.25, 0.06, 0.3),
        reach=3.2,
    ),
}


@cache
def _load(name: str) -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load(
        (resources.files(__package__) / "robots" / f"{name}.yaml").read_text()
    )
    return loaded


def nominal_robot(name: str, convention: str = "mdh", variant: int | None = None) -> dict[str, Any]:
    """robot.yaml dictionary of an arm of PRESETS, or of `variant_of` it, without base and tool, as mdh or dh."""
    if name not in PRESETS:
        raise ScenarioError(f"arm is '{name}', expected one of {', '.join(PRESETS)}")
    if convention not in ("mdh", "dh"):
        raise ScenarioError(f"convention is '{convention}', expected mdh or dh")
    robot = copy.deepcopy(_load(name)) if variant is None else variant_of(_load(name), variant)
    return robot if convention == "mdh" else as_standard_dh(robot)


def variant_of(robot: dict[str, Any], seed: int) -> dict[str, Any]:
    """A random arm like a preset, with its own lengths, masses, centres of mass, gear ratios and ranges.

    Lengths: one factor of 0.6 to 1.6 for all, times 0.75 to 1.3 each. Masses: the same factor times 0.6 to 1.6 each.
    Gear ratios: 0.6 to 1.7.
    """
    robot = copy.deepcopy(robot)
    # 77: random numbers independent of those of the case with this seed.
    rng = np.random.default_rng([seed, 77, len(robot["name"])])
    size = rng.uniform(0.6, 1.6)
    for joint in robot["kinematics"]["joints"]:
        for key in ("a", "d"):
            if joint[key]:
                joint[key] = float(joint[key] * size * rng.uniform(0.75, 1.3))
        if joint.get("gear_ratio"):
            joint["gear_ratio"] = round(float(joint["gear_ratio"] * rng.uniform(0.6, 1.7)), 2)
        if joint.get("lead"):
            joint["lead"] = round(float(joint["lead"] / rng.uniform(0.6, 1.7)), 4)
        if joint.get("type", "revolute") == "revolute" and not joint.get("passive"):
            low, high = joint["limits"]
            narrower = (high - low) * rng.uniform(0.0, 0.12, 2)
            joint["limits"] = [float(low + narrower[0]), float(high - narrower[1])]
    for link in robot["links"]:
        link["mass"] = float(link["mass"] * size * rng.uniform(0.6, 1.6))
        link["com"] = [float(value * size * rng.uniform(0.7, 1.3)) for value in link["com"]]
    return robot


def as_standard_dh(robot: dict[str, Any]) -> dict[str, Any]:
    """The same arm written in standard DH: row k takes a and alpha of Craig's row k+1; centres of mass move along.

    Exact where the first row has neither a nor alpha, as in every preset. Raises ScenarioError otherwise.
    """
    robot = copy.deepcopy(robot)
    rows = robot["kinematics"]["joints"]
    if rows[0]["a"] or rows[0]["alpha"]:
        raise ScenarioError(
            f"robot '{robot['name']}': a or alpha in its first row has no place in standard DH"
        )
    shifted = [(row["a"], row["alpha"]) for row in rows[1:]] + [(0.0, 0.0)]
    for k, (row, (a, alpha)) in enumerate(zip(rows, shifted, strict=True)):
        # The DH link frame is where Craig's next row would start.
        dh_from_mdh = Pose(rot_x(alpha), np.array([a, 0.0, 0.0])).inverse()
        row["a"], row["alpha"] = a, alpha
        if k < len(robot.get("links", [])):
            com = np.asarray(robot["links"][k]["com"], dtype=float)
            robot["links"][k]["com"] = [
                float(v) for v in dh_from_mdh.rotation @ com + dh_from_mdh.translation
            ]
    robot["kinematics"]["convention"] = "dh"
    return robot
