"""A URDF's chain from base link to tip link, in the convention "chain" of robot.yaml (docs/model.md).

Parsing is `urdf_parser_py`'s, the ROS project's own reader: small, and kept with every ROS release. The larger readers
(`yourdfpy`, `urchin`) bring meshes, scene graphs and some thirty packages that a chain does not need.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from urdf_parser_py import urdf as urdf_parser
from urdf_parser_py.xml_reflection import core as xml_reflection

from armtrue.arrays import Array
from armtrue.errors import InputError, did_you_mean
from armtrue.io.files import read_text
from armtrue.io.rotation import matrix_from_rotation_vector, matrix_from_rpy, rpy_from_matrix

# Six turns either way: larger limits of a revolute joint are not in radians.
LARGEST_LIMIT_RAD = 12 * math.pi
# Kinematics, links and mimics, as read_urdf_chain describes them.
UrdfChain = tuple[dict[str, Any], list[dict[str, Any]], list[dict[str, Any]]]
_JOINT_TYPES = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}


def read_urdf_chain(path: Path, base: str, tip: str) -> UrdfChain:
    """Return `(kinematics, links, mimics)` of the chain from link `base` to link `tip`.

    `kinematics` has convention "chain"; `links` one `{mass, com}` a joint in its frame, empty if the URDF gives no
    mass; `mimics` the couplings of joints that mimic another, as `{joint, driving, ratio}`, numbers from 1: they are
    passive, and their `<mimic offset>` is in their row's `offset`. The mass of a link includes bodies attached to it by
    fixed joints, and side branches at their zero position.

    Errors: InputError when the file is no URDF, a link is unknown, tip does not descend from base, or a joint of the
    chain is of another type (floating, planar), or mimics one that is not in the chain.
    """
    tree = _Tree(path)
    joints: list[dict[str, Any]] = []
    bodies: list[tuple[float, Array]] = []
    # Pose of the current link in the frame of the last moving joint.
    frame_from_link = np.eye(4)
    for joint in tree.path(base, tip):
        frame_from_joint = frame_from_link @ _matrix(joint.origin)
        if joint.type == "fixed":
            frame_from_link = frame_from_joint
            continue
        axis_from_z = _turn_z_onto(tree.axis(joint))
        before = frame_from_joint @ axis_from_z
        joints.append(tree.row(joint, before))
        frame_from_link = axis_from_z.T
        bodies.append(tree.mass_moment(joint.child, frame_from_link, stop=tree.chain_joints))
    if not joints:
        raise InputError(f"{path}: found no moving joint between '{base}' and '{tip}', expected at least one")
    names = [row["name"] for row in joints]
    mimics = [tree.mimic(row["name"], names, row) for row in joints if row.get("passive")]
    kinematics = {"convention": "chain", "joints": joints, "end": _pose(frame_from_link)}
    if not any(mass > 0.0 for mass, _ in bodies):
        return kinematics, [], mimics
    links = [
        {"mass": mass, "com": list(map(float, moment / mass)) if mass else [0.0] * 3}
        for mass, moment in bodies
    ]
    return kinematics, links, mimics


def parse_urdf(path: Path) -> Any:
    """Return the URDF at `path` as its parser's `Robot`, checked for finite numbers, unique names and existing links.

    Tags that the parser does not know (of xacro, of simulators) are ignored, as nothing in them is used.

    Errors: InputError naming the file and the joint or link.
    """
    text = read_text(path)
    complaints: list[str] = []
    xml_reflection.on_error = complaints.append
    try:
        root = ElementTree.fromstring(text)
        for place, found, expected in _wrong_figures(root):
            raise InputError(f"{path}: {place}: found '{found}', expected {expected}")
        robot = urdf_parser.URDF.from_xml_string(text.encode())
    except InputError:
        raise
    except Exception as error:  # the parser raises whatever its XML and number readers raise
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: found no URDF that can be read ({reason})") from None
    _refuse_broken_names(path, robot)
    return robot


# Numbers that are read, by element: path within it, attribute, count.
_FIGURES = {
    "joint": (
        ("origin", "xyz", 3),
        ("origin", "rpy", 3),
        ("axis", "xyz", 3),
        ("limit", "lower", 1),
        ("limit", "upper", 1),
        ("mimic", "multiplier", 1),
        ("mimic", "offset", 1),
    ),
    "link": (("inertial/origin", "xyz", 3), ("inertial/origin", "rpy", 3), ("inertial/mass", "value", 1)),
}


def _wrong_figures(root: ElementTree.Element) -> Iterator[tuple[str, str, str]]:
    """Place, text and expectation of each attribute in `_FIGURES` that does not hold its count of finite numbers."""
    for kind, figures in _FIGURES.items():
        for element in root.findall(kind):
            for inside, attribute, count in figures:
                if inside == "limit" and element.get("type") == "continuous":
                    continue
                for holder in element.findall(inside):
                    text = holder.get(attribute)
                    if text is not None and not _are_numbers(text, count):
                        number = "one finite number" if count == 1 else "three finite numbers"
                        hint = " (xacro files become a URDF by 'xacro FILE')" if "${" in text else ""
                        place = f"{kind} '{element.get('name')}' {inside.replace('/', ' ')} {attribute}"
                        yield place, text, number + hint


def _are_numbers(text: str, count: int) -> bool:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return False
    return len(values) == count and all(map(math.isfinite, values))


def _refuse_broken_names(path: Path, robot: Any) -> None:
    """Raise InputError for a repeated name, a link that does not exist, or a link with two parents."""
    for kind, elements in (("link", robot.links), ("joint", robot.joints)):
        seen: set[str] = set()
        for element in elements:
            if element.name in seen:
                raise InputError(
                    f"{path}: {kind} '{element.name}': found a second time, expected a name of its own"
                )
            seen.add(element.name)
    links = {link.name for link in robot.links}
    parents: dict[str, str] = {}
    for joint in robot.joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                hint = did_you_mean(str(link), links)
                raise InputError(
                    f"{path}: joint '{joint.name}' {role}: found '{link}', expected a link of the file{hint}"
                )
        if joint.child in parents:
            raise InputError(
                f"{path}: joint '{joint.name}' child: found '{joint.child}', which is the child of joint "
                f"'{parents[joint.child]}' already, expected one joint above each link"
            )
        parents[joint.child] = joint.name


class _Tree:
    """The parsed URDF with look-ups by link; every error names the file."""

    def __init__(self, path: Path) -> None:
        self.path_of_file = path
        self.robot = parse_urdf(path)
        self.links = {link.name: link for link in self.robot.links}
        self.joint_into = {joint.child: joint for joint in self.robot.joints}
        self.joints_from: dict[str, list[Any]] = {}
        for joint in self.robot.joints:
            self.joints_from.setdefault(joint.parent, []).append(joint)
        self.chain_joints: set[str] = set()

    def path(self, base: str, tip: str) -> list[Any]:
        """The joints from `base` to `tip`, base first."""
        for role, link in (("base", base), ("tip", tip)):
            if link not in self.links:
                hint = did_you_mean(link, self.links)
                raise InputError(f"{self.path_of_file}: found no link '{link}' to be the {role}{hint}")
        walk: list[Any] = []
        link = tip
        while link != base:
            joint = self.joint_into.get(link)
            if joint is None or len(walk) > len(self.robot.joints):
                raise InputError(
                    f"{self.path_of_file}: found no chain of joints from '{base}' to '{tip}', expected one"
                )
            walk.append(joint)
            link = joint.parent
        self.chain_joints = {joint.name for joint in walk if joint.type != "fixed"}
        return walk[::-1]

    def axis(self, joint: Any) -> Array:
        """The joint's unit axis in its own frame; URDF's default is x."""
        axis = np.array(joint.axis if joint.axis is not None else [1.0, 0.0, 0.0], dtype=np.float64)
        length = float(np.linalg.norm(axis)) if axis.shape == (3,) else 0.0
        if not np.isfinite(length) or length < 1e-9:
            raise InputError(
                f"{self.path_of_file}: joint '{joint.name}' axis: found {joint.axis}, expected three numbers"
            )
        return axis / length

    def row(self, joint: Any, before: Array) -> dict[str, Any]:
        """One row of convention "chain"; `before` is F_k."""
        if joint.type not in _JOINT_TYPES:
            raise InputError(
                f"{self.path_of_file}: joint '{joint.name}': found type '{joint.type}', "
                "expected revolute, continuous, prismatic or fixed"
            )
        kind = _JOINT_TYPES[joint.type]
        row: dict[str, Any] = {"name": joint.name, "type": kind, **_pose(before), "offset": 0.0}
        if joint.type != "continuous" and joint.limit is not None:
            limits = [float(joint.limit.lower or 0.0), float(joint.limit.upper or 0.0)]
            if kind == "revolute" and max(map(abs, limits)) > LARGEST_LIMIT_RAD:
                raise InputError(
                    f"{self.path_of_file}: joint '{joint.name}' limit: found lower {limits[0]:g}, upper {limits[1]:g}, "
                    "expected radians (these look like degrees)"
                )
            if limits[0] < limits[1]:
                row["limits"] = limits
        if joint.mimic is not None:
            row["passive"] = True
        return row

    def mimic(self, name: str, names: list[str], row: dict[str, Any]) -> dict[str, Any]:
        """The coupling of the joint `name` of the chain `names`, which mimics another, perhaps by way of more mimics.

        The mimic offset is added to the `offset` of its `row` and subtracted from its limits.
        """
        joints = {joint.name: joint for joint in self.robot.joints}
        ratio, offset, at = 1.0, 0.0, joints[name]
        seen = {name}
        while at.mimic is not None:
            multiplier = 1.0 if at.mimic.multiplier is None else float(at.mimic.multiplier)
            offset += ratio * float(at.mimic.offset or 0.0)
            ratio *= multiplier
            if at.mimic.joint in seen or at.mimic.joint not in joints:
                raise InputError(
                    f"{self.path_of_file}: joint '{at.name}' mimic: found '{at.mimic.joint}', expected another "
                    "joint of the file, which does not mimic this one"
                )
            at = joints[at.mimic.joint]
            seen.add(at.name)
        if at.name not in names:
            raise InputError(
                f"{self.path_of_file}: joint '{name}' mimic: found '{at.name}', expected a joint of the chain from "
                "base to tip that moves"
            )
        row["offset"] += offset
        if "limits" in row:
            row["limits"] = [limit - offset for limit in row["limits"]]
        return {"joint": names.index(name) + 1, "driving": names.index(at.name) + 1, "ratio": ratio}

    def mass_moment(self, link: str, frame_from_link: Array, stop: set[str]) -> tuple[float, Array]:
        """Mass, and mass times centre, of `link` and all that is attached to it, except beyond the joints in `stop`."""
        mass = 0.0
        moment: Array = np.zeros(3)
        inertial = self.links[link].inertial if link in self.links else None
        if inertial is not None and inertial.mass:
            own = float(inertial.mass)
            if not np.isfinite(own) or own < 0.0:
                raise InputError(
                    f"{self.path_of_file}: link '{link}': found mass {own}, expected kilograms, not negative"
                )
            centre = frame_from_link @ np.append(_matrix(inertial.origin)[:3, 3], 1.0)
            mass, moment = own, own * centre[:3]
        for joint in self.joints_from.get(link, []):
            if joint.name not in stop:
                more, further = self.mass_moment(
                    joint.child, frame_from_link @ _matrix(joint.origin), stop | {joint.name}
                )
                mass, moment = mass + more, moment + further
        return mass, moment


def _matrix(origin: Any) -> Array:
    matrix = np.eye(4)
    if origin is not None:
        matrix[:3, 3] = origin.xyz if origin.xyz is not None else 0.0
        matrix[:3, :3] = matrix_from_rpy(origin.rpy if origin.rpy is not None else [0.0, 0.0, 0.0])
    return matrix


def _pose(matrix: Array) -> dict[str, list[float]]:
    return {"xyz": [float(value) for value in matrix[:3, 3]], "rpy": rpy_from_matrix(matrix)}


def _turn_z_onto(axis: Array) -> Array:
    """The shortest turn that carries z onto the unit vector `axis`, as a 4 × 4 matrix."""
    matrix = np.eye(4)
    lever = np.cross([0.0, 0.0, 1.0], axis)
    sine = float(np.linalg.norm(lever))
    direction = lever / sine if sine > 1e-12 else np.array([1.0, 0.0, 0.0])
    matrix[:3, :3] = matrix_from_rotation_vector(direction * np.arctan2(sine, axis[2]))
    return matrix
