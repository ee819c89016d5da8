"""The contract's column names: what each holds, for an arm of n joints, and the units it may come in."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armtrue.io.robot import Robot

TEXT_COLUMNS = ("target", "repeat")
QUATERNION = ("qw", "qx", "qy", "qz")
POSITION = ("x", "y", "z")

# unit → (kind, factor to SI, added after the factor)
UNITS: dict[str, tuple[str, float, float]] = {
    "m": ("length", 1.0, 0.0),
    "cm": ("length", 1e-2, 0.0),
    "mm": ("length", 1e-3, 0.0),
    "um": ("length", 1e-6, 0.0),
    "in": ("length", 0.0254, 0.0),
    "ft": ("length", 0.3048, 0.0),
    "rad": ("angle", 1.0, 0.0),
    "mrad": ("angle", 1e-3, 0.0),
    "deg": ("angle", math.pi / 180.0, 0.0),
    "arcsec": ("angle", math.pi / 648000.0, 0.0),
    "turn": ("angle", 2.0 * math.pi, 0.0),
    "degC": ("temperature", 1.0, 0.0),
    "K": ("temperature", 1.0, -273.15),
    "degF": ("temperature", 5.0 / 9.0, -160.0 / 9.0),
    "kg": ("mass", 1.0, 0.0),
    "g": ("mass", 1e-3, 0.0),
    "lb": ("mass", 0.45359237, 0.0),
    "Nm": ("torque", 1.0, 0.0),
    "s": ("time", 1.0, 0.0),
    "ms": ("time", 1e-3, 0.0),
    "min": ("time", 60.0, 0.0),
    "h": ("time", 3600.0, 0.0),
}

_PER_JOINT = re.compile(r"^(qr|q|dir|tau|travel|duty)([0-9]+)$")
# Columns of the contract that only one effect reads; if a column holds other than numbers, it is not used.
_OF_ONE_EFFECT = re.compile(r"^(station|nest|(travel|duty)[0-9]+)$")
TRAVEL = re.compile(r"\btravel[0-9]+\b")
# Travel of a joint in its last direction where it is not known, on a device or in a planned pose: most motions are
# long [rad, m].
FAR_TRAVEL = 1e9
_KIND_OF = {
    **dict.fromkeys(TEXT_COLUMNS, "text"),
    **dict.fromkeys((*POSITION, "sigma"), "length"),
    **dict.fromkeys((*QUATERNION, "station", "nest"), "number"),
    "payload": "mass",
    "time": "time",
}
_KINDS_OF_JOINTS = {"dir": "number", "duty": "number", "tau": "torque"}


def is_sensor(name: str) -> bool:
    """True where expressions can read `dT_name`: letters, digits and underscores."""
    return re.fullmatch(r"[A-Za-z0-9_]+", name) is not None


def contract_name(header: str) -> str:
    """`temp_arm_1` for `temp_arm 1` or `temp_arm-1 (°C)`; any other header as it is."""
    if not header.startswith("temp_"):
        return header
    sensor = re.sub(r"\s*[(\[].*$", "", header.removeprefix("temp_"))
    return "temp_" + re.sub(r"[^A-Za-z0-9_]+", "_", sensor).strip("_")


def commanded_joints(names: Iterable[str]) -> list[str]:
    """Those of `names` that are `q1…qn`, in the arm's order."""
    return sorted(
        (name for name in names if name[0] == "q" and name[1:].isdigit()), key=lambda name: int(name[1:])
    )


def span(stem: str, joints: list[int]) -> str:
    """The columns `stem` of `joints` in words: `dir1…dir6` where they are consecutive, else each by its name."""
    if len(joints) > 2 and joints == list(range(joints[0], joints[-1] + 1)):
        return f"{stem}{joints[0]}…{stem}{joints[-1]}"
    return ", ".join(f"{stem}{k}" for k in joints)


@dataclass(frozen=True)
class ColumnNames:
    """The columns that data of `robot` may have."""

    robot: Robot

    def kind(self, name: str) -> str | None:
        """What `name` holds: a kind of `UNITS`, "number" (no unit), "text", or None where the name is not known."""
        if name.startswith("temp_"):
            return "temperature" if is_sensor(name.removeprefix("temp_")) else None
        if not (match := _PER_JOINT.match(name)):
            return _KIND_OF.get(name)
        if not 1 <= int(match[2]) <= self.robot.joint_count:
            return None
        is_revolute = self.robot.joints[int(match[2]) - 1]["type"] == "revolute"
        return _KINDS_OF_JOINTS.get(match[1], "angle" if is_revolute else "length")

    def of_one_effect(self, name: str) -> bool:
        """True for `station`, `nest`, `travel1…traveln` and `duty1…dutyn`."""
        return _OF_ONE_EFFECT.match(name) is not None and self.kind(name) is not None

    def joint_beyond_arm(self, name: str) -> bool:
        """True for `q7` and its like on a six-axis arm."""
        is_known = self.kind(name) is not None or _OF_ONE_EFFECT.match(name) is not None
        return _PER_JOINT.match(name) is not None and not is_known

    def of_passive(self, name: str) -> bool:
        """True for a column of a passive joint, which has no drive to report on."""
        match = _PER_JOINT.match(name)
        return match is not None and int(match[2]) in self.robot.passive

    def all(self) -> list[str]:
        """Every column name, for suggestions on misspelt ones."""
        per_joint = [f"{stem}{k}" for stem in ("q", "qr", "dir", "tau") for k in self.robot.motors]
        sensors = [f"temp_{sensor}" for sensor in self.robot.sensors]
        return [*per_joint, *POSITION, *QUATERNION, *sensors, *TEXT_COLUMNS, "payload", "time", "sigma"]
