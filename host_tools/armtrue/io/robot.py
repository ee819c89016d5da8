"""robot.yaml: the nominal arm, checked strictly and brought to one normalised form (docs/files.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.errors import InputError, did_you_mean
from armtrue.io.columns import contract_name, is_sensor
from armtrue.io.files import named_in
from armtrue.io.urdf import LARGEST_LIMIT_RAD, UrdfChain, read_urdf_chain
from armtrue.io.yamlfile import Section, load_yaml
from armtrue.units import plural

STANDARD_GRAVITY = [0.0, 0.0, -9.81]
LARGEST_LEAD_M = 2.0  # a pinion of 0.6 m; larger values are in millimetres
# Larger values are in millimetres [m].
_LONGEST_TOOL_M, _LONGEST_RAIL_M, _FURTHEST_BASE_M = 10.0, 100.0, 1000.0


@dataclass(frozen=True)
class Robot:
    """The nominal arm, as robot.yaml and the URDF that it may name describe it.

    `spec`: the content of robot.yaml with defaults filled in, in SI units, JSON-able; a URDF is replaced by the joints
    of its chain. `urdf`: the file that they come from. `gravity_stated`: False if robot.yaml leaves gravity at its
    default.
    """

    spec: dict[str, Any]
    path: Path | None = field(default=None, compare=False)
    urdf: Path | None = field(default=None, compare=False)
    gravity_stated: bool = field(default=True, compare=False)

    def __repr__(self) -> str:
        return f"Robot {self.spec.get('name', '')}: {plural(self.joint_count, 'joint')}"

    @property
    def joints(self) -> list[dict[str, Any]]:
        """The rows of the kinematics, base to tip."""
        return list(self.spec["kinematics"]["joints"])

    @property
    def joint_count(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def passive(self) -> list[int]:
        """Numbers, from 1, of the joints without a motor: bars turn them by the angles that `coupling` gives."""
        return _passive(self.joints)

    @property
    def motors(self) -> list[int]:
        """Numbers, from 1, of the joints that have a motor."""
        return [number for number in range(1, self.joint_count + 1) if number not in self.passive]

    @property
    def mechanical_coupling(self) -> NDArray[np.float64]:
        """C (n, n): link angles are C · the drives' angles, offsets aside."""
        return self._coupled("mechanical")

    @property
    def kinematics_file(self) -> str:
        """The name of the file with the kinematics: robot.yaml, or the URDF that it names."""
        return "robot.yaml" if self.urdf is None else self.urdf.name

    @property
    def sensors(self) -> list[str]:
        """Names of the temperature sensors."""
        return list(self.spec.get("temperature", {}).get("sensors", []))

    @property
    def drives_from_reported(self) -> NDArray[np.float64]:
        """M (n, n): the drives' angles are M · the reported ones; identity but for couplings of `kind: controller`."""
        return self._coupled("controller")

    def _coupled(self, kind: str) -> NDArray[np.float64]:
        matrix = np.eye(self.joint_count)
        for row in self.spec.get("coupling", []):
            if row.get("kind", "mechanical") == kind:
                matrix[row["joint"] - 1, row["driving"] - 1] += row["ratio"]
        return matrix

    @property
    def reach_m(self) -> float:
        """Upper bound of the distance from base to tool point: the sum of all lengths, in metres."""
        kinematics = self.spec["kinematics"]
        longest_tool = max(
            [self.spec.get("tool", {}), *self.spec.get("tools", {}).values()],
            key=lambda tool: math.hypot(*tool.get("xyz", [0.0])),
        )
        frames = [*kinematics["joints"], kinematics.get("end", {}), longest_tool]
        total = 0.0
        for frame in frames:
            total += math.hypot(frame.get("a", 0.0), frame.get("d", 0.0)) + math.hypot(
                *frame.get("xyz", [0.0])
            )
            if frame.get("type") == "prismatic":
                total += max(map(abs, frame.get("limits", [1.0])))
        return total

    def json(self) -> str:
        """`spec` as JSON text, as `armtrue._core` takes it."""
        return json.dumps(self.spec)


def load_robot(path: str | Path) -> Robot:
    """Read and check the robot file at `path`.

    Errors: InputError naming file and key path, what was found and what was expected.
    """
    path = Path(path)
    top = load_yaml(path)
    kinematics = top.section("kinematics")
    urdf = None
    if kinematics.has("urdf"):
        urdf = named_in(path, kinematics.text("urdf", expected="the name of a URDF file"))
    return Robot(_specification(top, path), path, urdf, top.has("gravity"))


def check_robot(spec: dict[str, Any], path: Path, where: str) -> None:
    """Check the normalised `spec` of a robot under the key `where` of the file `path`. Errors: InputError."""
    _specification(Section(spec, str(path), where), path)


def _specification(top: Section, path: Path) -> dict[str, Any]:
    spec: dict[str, Any] = {"name": top.text("name", default=path.stem)}
    if top.has("serial"):
        spec["serial"] = top.text("serial")
    spec["kinematics"], urdf_links, mimics = _kinematics(top.section("kinematics"), path)
    joint_count = len(spec["kinematics"]["joints"])
    if top.has("links"):
        if urdf_links:
            raise InputError(
                f"{top.place('links')}: found masses here and in the URDF, expected them in one place"
            )
        spec["links"] = _links(top, joint_count)
    elif urdf_links:
        spec["links"] = urdf_links
    gravity_form = "a list [x, y, z] in m/s²"
    spec["gravity"] = top.numbers("gravity", 3, gravity_form, default=STANDARD_GRAVITY)
    if not 0.0 < math.hypot(*spec["gravity"]) < 100.0:
        raise top.fail("gravity", gravity_form + " longer than 0 and shorter than 100")
    for key, furthest_m in (("tool", _LONGEST_TOOL_M), ("base", _FURTHEST_BASE_M)):
        if top.has(key):
            spec[key] = pose(top.section(key), furthest_m)
    if top.has("tools"):
        if top.has("tool"):
            raise InputError(f"{top.place('tools')}: found beside 'tool', expected one of the two")
        tools = top.section("tools")
        spec["tools"] = {target: pose(tools.section(target), _LONGEST_TOOL_M) for target in tools}
    if top.has("payload"):
        payload = top.section("payload")
        com_form = "a list [x, y, z] in metres, in the last link's frame"
        spec["payload"] = {"com": payload.numbers("com", 3, com_form)}
        _refuse_millimetres(payload, "com", spec["payload"]["com"], com_form, _LONGEST_TOOL_M)
    if top.has("temperature"):
        spec["temperature"] = _temperature(top.section("temperature"))
    passive = _passive(spec["kinematics"]["joints"])
    spec["coupling"] = _with_mimics(mimics, _coupling(top, joint_count, passive), passive, top)
    for joint in passive:
        if not any(row["joint"] == joint for row in spec["coupling"]):
            raise InputError(
                f"{top.place('coupling')}: found no row for joint {joint}, which is passive, expected what turns it: "
                f"{{joint: {joint}, driving: …, ratio: …}}"
            )
    if top.has("linkage"):
        spec["linkage"] = _linkage(top.section("linkage"), joint_count)
    top.finish()
    return spec


def _passive(joints: list[dict[str, Any]]) -> list[int]:
    return [number for number, joint in enumerate(joints, start=1) if joint.get("passive")]


def pose(section: Section, furthest_m: float = _FURTHEST_BASE_M) -> dict[str, list[float]]:
    """Read `{xyz, rpy}`: metres and radians about fixed axes x, y, z; rpy may be left out and is then zero.

    No coordinate may be beyond ± `furthest_m`.
    """
    form = "a list [x, y, z] in metres"
    result = {
        "xyz": section.numbers("xyz", 3, form),
        "rpy": section.numbers("rpy", 3, "a list [roll, pitch, yaw] in radians", default=[0.0, 0.0, 0.0]),
    }
    if any(abs(angle) > 2 * math.pi for angle in result["rpy"]):
        raise section.fail("rpy", "angles in radians, none beyond 2π (these look like degrees)")
    _refuse_millimetres(section, "xyz", result["xyz"], form, furthest_m)
    section.finish()
    return result


def _refuse_millimetres(
    section: Section, key: str, lengths_m: list[float], form: str, furthest_m: float
) -> None:
    if max(map(abs, lengths_m)) > furthest_m:
        raise section.fail(key, f"{form}, none beyond {furthest_m:g} (these look like millimetres)")


def _kinematics(section: Section, path: Path) -> UrdfChain:
    """Kinematics; links and mimics (`{joint, driving, ratio}`) of a URDF."""
    if section.has("urdf"):
        for key in ("joints", "convention"):
            if section.has(key):
                raise InputError(
                    f"{section.place(key)}: found beside 'urdf', expected either a table of joints or a URDF"
                )
        return _urdf_kinematics(section, path)
    if not section.has("joints"):
        raise section.fail("joints", "a table of joints, or 'urdf' with the name of a file")
    convention = section.choice("convention", ["mdh", "dh", "chain"])
    rows = section.sections("joints", "a list of joints, base to tip")
    if not rows:
        raise section.fail("joints", "at least one joint")
    read_frame = _chain_frame if convention == "chain" else _dh_frame
    kinematics: dict[str, Any] = {
        "convention": convention,
        "joints": [_joint(row, number, read_frame) for number, row in enumerate(rows, start=1)],
    }
    if convention == "chain":
        identity = {"xyz": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
        kinematics["end"] = pose(section.section("end")) if section.has("end") else identity
    names = [joint["name"] for joint in kinematics["joints"]]
    for row, name in zip(rows, names, strict=True):
        if names.index(name) < rows.index(row):
            raise InputError(f"{row.place('name')}: found '{name}' a second time, expected a name of its own")
    return kinematics, [], []


def _dh_frame(row: Section) -> dict[str, Any]:
    frame = {
        "a": row.number("a", expected="a length in metres"),
        "alpha": row.number("alpha", expected="an angle in radians"),
        "d": row.number("d", expected="a length in metres"),
    }
    if abs(frame["alpha"]) > 2 * math.pi:
        raise row.fail("alpha", "an angle in radians, not beyond 2π (this looks like degrees)")
    for key in ("a", "d"):
        if abs(frame[key]) > 50.0:
            raise row.fail(key, "a length in metres, not beyond 50 (this looks like millimetres)")
    return frame


def _chain_frame(row: Section) -> dict[str, Any]:
    return {
        "xyz": row.numbers("xyz", 3, "a list [x, y, z] in metres"),
        "rpy": row.numbers("rpy", 3, "a list [roll, pitch, yaw] in radians", default=[0.0, 0.0, 0.0]),
    }


def _joint(row: Section, number: int, read_frame: Callable[[Section], dict[str, Any]]) -> dict[str, Any]:
    joint: dict[str, Any] = {"name": row.text("name", default=f"joint{number}")}
    joint["type"] = row.choice("type", ["revolute", "prismatic"], default="revolute")
    joint |= read_frame(row)
    revolute = joint["type"] == "revolute"
    joint["offset"] = row.number(
        "offset", default=0.0, expected="an angle in radians" if revolute else "a length in metres"
    )
    if not revolute and read_frame is _dh_frame and row.has("theta"):
        joint["theta"] = row.number("theta", expected="an angle in radians")
    turned = "offset" if revolute else "theta"
    if abs(joint.get(turned, 0.0)) > 2 * math.pi:
        raise row.fail(turned, "an angle in radians, not beyond 2π (this looks like degrees)")
    if row.flag("passive", default=False):
        joint["passive"] = True
        for key in ("lead", "gear_ratio"):
            if row.has(key):
                raise row.fail(key, f"no {key}, as the joint is passive: it has no motor")
    if row.has("lead"):
        joint["lead"] = _lead(row, "lead", revolute)
        if row.has("gear_ratio"):
            raise row.fail("gear_ratio", "lead alone, where both are given")
    if row.has("gear_ratio"):
        ratio = (
            "a ratio other than 0, motor turns per joint turn"
            if revolute
            else "the motor's radians per metre, not 0, or lead in its place"
        )
        joint["gear_ratio"] = row.number("gear_ratio", expected=ratio)
        if joint["gear_ratio"] == 0.0:
            raise row.fail("gear_ratio", ratio)
    if row.has("limits"):
        joint["limits"] = _limits(row, revolute)
    return joint


def _lead(row: Section, key: str, revolute: bool) -> float:
    """Travel [m] of a prismatic joint per turn of its screw or pinion."""
    if revolute:
        raise row.fail(key, "no lead of a joint that turns, but gear_ratio")
    lead = row.number(key, expected="a length in metres per turn of the screw or pinion")
    if not 0.0 < lead <= LARGEST_LEAD_M:
        hint = " (this looks like millimetres)" if lead > LARGEST_LEAD_M else ""
        expected = f"metres per turn of the screw or pinion, above 0 and up to {LARGEST_LEAD_M:g}"
        raise row.fail(key, expected + hint)
    return lead


def _limits(row: Section, revolute: bool) -> list[float]:
    unit = "radians" if revolute else "metres"
    expected = f"a list [lo, hi] in {unit} with lo below hi"
    limits = row.numbers("limits", 2, expected)
    if not limits[0] < limits[1]:
        raise row.fail("limits", expected)
    if revolute and max(map(abs, limits)) > LARGEST_LIMIT_RAD:
        raise row.fail("limits", "a list [lo, hi] in radians (these look like degrees)")
    if not revolute:
        _refuse_millimetres(row, "limits", limits, "a list [lo, hi] in metres", _LONGEST_RAIL_M)
    return limits


def _urdf_kinematics(section: Section, path: Path) -> UrdfChain:
    urdf_path = named_in(path, section.text("urdf", expected="the name of a URDF file"))
    base = section.text("base", expected="the name of the link at the base")
    tip = section.text("tip", expected="the name of the link at the tip")
    kinematics, links, mimics = read_urdf_chain(urdf_path, base, tip)
    if section.has("passive"):
        for number in section.joints("passive", len(kinematics["joints"])):
            kinematics["joints"][number - 1]["passive"] = True
    if section.has("gear_ratios"):
        driven = [joint for joint in kinematics["joints"] if not joint.get("passive")]
        expected = f"a list of {len(driven)} ratios, one a joint with a motor, none 0"
        ratios = section.numbers("gear_ratios", len(driven), expected)
        for joint, ratio in zip(driven, ratios, strict=True):
            if ratio == 0.0:
                raise section.fail("gear_ratios", expected)
            joint["gear_ratio"] = ratio
    if section.has("leads"):
        leads, named = section.section("leads"), {joint["name"]: joint for joint in kinematics["joints"]}
        for name in leads:
            if name not in named:
                raise leads.fail(name, "the name of a joint of the chain" + did_you_mean(name, named))
            named[name]["lead"] = _lead(leads, name, named[name]["type"] == "revolute")
            named[name].pop("gear_ratio", None)
    return kinematics, links, mimics


def _links(top: Section, joint_count: int) -> list[dict[str, Any]]:
    sections = top.sections("links", "a list of links, one a joint")
    if len(sections) != joint_count:
        raise InputError(
            f"{top.place('links')}: found {plural(len(sections), 'link')}, expected {joint_count}, one a joint"
        )
    com = "a list [x, y, z] in metres, in the link's own frame"
    return [
        {
            "mass": section.number("mass", minimum=0.0, expected="a mass in kilograms, not negative"),
            "com": section.numbers("com", 3, com, default=[0.0, 0.0, 0.0]),
        }
        for section in sections
    ]


def _temperature(section: Section) -> dict[str, Any]:
    reference = section.number("reference", minimum=-273.15, expected="a temperature in °C")
    sensors = section.texts("sensors", "a list of sensor names")
    for number, name in enumerate(sensors, start=1):
        if not is_sensor(name):
            raise InputError(
                f"{section.place('sensors')}[{number}]: found '{name}', expected letters, digits and underscores, "
                f"such as '{contract_name('temp_' + name).removeprefix('temp_') or 'arm'}'"
            )
        if name in sensors[: number - 1]:
            raise InputError(
                f"{section.place('sensors')}: found '{name}' a second time, expected names of their own"
            )
    return {"reference": reference, "sensors": sensors}


def _coupling(top: Section, joint_count: int, passive: list[int]) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    if not top.has("coupling"):
        return rows
    for section in top.sections("coupling", "a list of {joint, driving, ratio, kind}"):
        row: dict[str, Any] = {
            "joint": section.joint("joint", joint_count),
            "driving": section.joint("driving", joint_count),
            "ratio": section.number(
                "ratio", expected="a ratio: the joint's angle per angle of the driving one"
            ),
        }
        # `controller`: only the reported angle is coupled, so that no torque passes to the driving motor.
        if section.choice("kind", ["mechanical", "controller"], default="mechanical") == "controller":
            row["kind"] = "controller"
            if row["joint"] in passive:
                raise section.fail("kind", f"'mechanical', as joint {row['joint']} is passive: bars turn it")
        if row["driving"] in passive:
            raise section.fail("driving", "a joint with a motor (this one is passive)")
        if row["joint"] == row["driving"]:
            raise section.fail("driving", "a joint other than the driven one")
        if any((row["joint"], row["driving"]) == (other["joint"], other["driving"]) for other in rows):
            raise InputError(
                f"{section.place()}: found joint {row['joint']} driven by {row['driving']} a second time, expected once"
            )
        rows.append(row)
    return rows


def _with_mimics(
    mimics: list[dict[str, Any]], rows: list[dict[str, Any]], passive: list[int], top: Section
) -> list[dict[str, Any]]:
    """The coupling `rows` of robot.yaml, together with those of the URDF's joints that mimic another.

    A URDF's multiplier relates two link angles; `coupling` relates a joint to motors, each of which may turn several
    links.
    """
    stated = {(row["joint"], row["driving"]) for row in rows}
    result: dict[tuple[int, int], dict[str, Any]] = {}
    for mimic in mimics:
        joint, driving = mimic["joint"], mimic["driving"]
        if (joint, driving) in stated:
            raise InputError(
                f"{top.place('coupling')}: found joint {joint} driven by {driving}, "
                "which the URDF says by 'mimic', expected it once"
            )
        ratios = {} if driving in passive else {driving: 1.0}
        for row in rows:
            if row["joint"] == driving and row.get("kind") != "controller":
                ratios[row["driving"]] = ratios.get(row["driving"], 0.0) + row["ratio"]
        for motor, ratio in ratios.items():
            result[joint, motor] = {"joint": joint, "driving": motor, "ratio": mimic["ratio"] * ratio}
    for row in rows:
        place = row["joint"], row["driving"]
        if place in result:
            result[place]["ratio"] += row["ratio"]
        else:
            result[place] = row
    return list(result.values())


def _linkage(section: Section, joint_count: int) -> dict[str, Any]:
    return {
        "type": section.choice("type", ["parallelogram"]),
        "joints": section.joints("joints", joint_count, count=2),
        "angle": section.number("angle", expected="an angle in radians: β where link angle 3 is zero"),
        **{
            bar: section.number(bar, above=0.0, expected="a length in metres above 0")
            for bar in ("crank", "rod")
            if section.has(bar)
        },
    }
