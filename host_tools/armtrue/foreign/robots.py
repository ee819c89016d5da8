"""robot.yaml from a URDF, or from a table of Denavit-Hartenberg rows."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armtrue.errors import InputError
from armtrue.foreign.sheets import Sheet, read_sheet, split_unit, to_float
from armtrue.io.columns import UNITS
from armtrue.io.delimited import is_number
from armtrue.io.urdf import parse_urdf
from armtrue.units import plural

WHERE_ARMS_ARE = (
    "robot descriptions stand in ur_description (UR), kuka_experimental and kuka_robot_descriptions (KUKA), abb_robot "
    "descriptions (ABB), fanuc_driver (FANUC), franka_description (Franka), staubli_experimental (Stäubli); "
    "xacro files become a URDF by 'xacro FILE'"
)
_TIPS = ("tool0", "flange", "tcp", "ee", "hand", "link_t", "link8")
_COLUMNS = {
    "a": re.compile(r"^(?:a|r|a_i|link_?length)$", re.IGNORECASE),
    "alpha": re.compile(r"^(?:alpha|al|α|twist|alpha_i)$", re.IGNORECASE),
    "d": re.compile(r"^(?:d|d_i|link_?offset)$", re.IGNORECASE),
    "offset": re.compile(r"^(?:theta|θ|offset|theta_?0|theta_?offset|joint_?offset|th)$", re.IGNORECASE),
    "gear_ratio": re.compile(r"^(?:gear|gear_?ratio|ratio|n)$", re.IGNORECASE),
    # Khalil and Dombre's sigma is 1 for a joint that slides.
    "type": re.compile(r"^(?:type|joint_?type|kind|sigma|σ)$", re.IGNORECASE),
}
_TYPES = {"revolute": ("r", "0"), "prismatic": ("p", "t", "l", "s", "1")}
_NEEDED = ("a", "alpha", "d")
_LONGEST_M = 10.0


@dataclass(frozen=True)
class UrdfArm:
    """The chain chosen in a URDF, as `kinematics` of robot.yaml, with the names of its joints.

    `prismatic`: numbers of the prismatic joints. `words`: base and tip, for the user. `motors`: numbers of the joints
    that mimic no other.
    """

    kinematics: dict[str, Any]
    names: list[str]
    prismatic: set[str]
    words: str
    motors: list[int]


def urdf_arm(urdf: Path, out: Path, joint_counts: list[int]) -> UrdfArm:
    """Return the chain of `urdf` with the first of `joint_counts` that a chain has; without counts, the longest."""
    robot = parse_urdf(urdf)
    parents = {joint.child: joint for joint in robot.joints}
    links = [link.name for link in robot.links]
    chains: dict[str, list[Any]] = {}
    for link in links:
        chain: list[Any] = []
        at = link
        while at in parents and len(chain) <= len(links):
            chain.append(parents[at])
            at = parents[at].parent
        chains[link] = chain[::-1]

    def moving(link: str) -> tuple[int, int]:
        """Number of joints that mimic no other, and of all: measurements may lack the joints that mimic another."""
        joints = [joint for joint in chains[link] if joint.type != "fixed"]
        return sum(joint.mimic is None for joint in joints), len(joints)

    found = set().union(*map(moving, links))
    counts = joint_counts or [max(found, default=0)]
    wanted = next((count for count in counts if count in found and count), 0)
    if not wanted:
        raise InputError(
            f"{urdf}: found no chain of {' or '.join(map(str, counts))} moving joints, expected one for each joint of "
            "the measurements"
        )
    fitting = [link for link in links if wanted in moving(link)]

    def rank(link: str) -> tuple[bool, int, int]:
        known = next((k for k, name in enumerate(_TIPS) if name in link.lower()), len(_TIPS))
        return moving(link)[0] != wanted, known, len(chains[link])

    tip = min(fitting, key=rank)
    base = chains[tip][0].parent
    joints = [joint for joint in chains[tip] if joint.type != "fixed"]
    prismatic = {str(k) for k, joint in enumerate(joints, start=1) if joint.type == "prismatic"}
    kinematics = {"urdf": os.path.relpath(urdf.resolve(), out.resolve()), "base": base, "tip": tip}
    words = f"{urdf.name}: {plural(len(joints), 'joint')} from {base} to {tip}"
    motors = [k for k, joint in enumerate(joints, start=1) if joint.mimic is None]
    if len(motors) < len(joints):
        mimics = [joint.name for joint in joints if joint.mimic is not None]
        words += f", of which {', '.join(mimics)} mimic others and have no motor"
    return UrdfArm(kinematics, [joint.name for joint in joints], prismatic, words, motors)


def is_dh_table(table: Path) -> bool:
    """True where a file is a table of Denavit-Hartenberg rows, and no measurements."""
    try:
        columns = _dh_columns(read_sheet(table))
    except InputError:
        return False
    return all(own in columns for own in _NEEDED)


def _dh_columns(sheet: Sheet) -> dict[str, str]:
    columns: dict[str, str] = {}
    for name in sheet.header:
        word = split_unit(name)[0].strip()
        own = next((own for own, words in _COLUMNS.items() if words.match(word)), None)
        if own is not None:
            columns.setdefault(own, name)
    return columns


def dh_rows(table: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Rows {a, alpha, d, offset, …} in SI units from a table of them, and what was guessed. Errors: InputError."""
    sheet = read_sheet(table)
    columns = _dh_columns(sheet)
    if missing := [own for own in _NEEDED if own not in columns]:
        raise InputError(
            f"{table} header: found no column '{missing[0]}', expected a, alpha, d and theta or offset"
        )
    types = _types(sheet, columns.pop("type", None), table)
    values = {own: _numbers(sheet, name, table) for own, name in columns.items()}
    longest = max(map(abs, values["a"] + values["d"]))
    widest = max(map(abs, values["alpha"] + values.get("offset", [])))
    length = sheet.units.get(columns["a"]) or ("mm" if longest > _LONGEST_M else "m")
    angle = sheet.units.get(columns["alpha"]) or ("deg" if widest > 2.0 * math.pi else "rad")
    usual = {"a": length, "d": length, "alpha": angle, "offset": angle}
    scale = {
        own: _factor(sheet.units.get(columns[own]) or unit, "length" if own in "ad" else "angle", table)
        for own, unit in usual.items()
        if own in columns
    }
    in_si = {own: [v * scale.get(own, 1.0) for v in values[own]] for own in values}
    rows: list[dict[str, Any]] = [{own: in_si[own][k] for own in in_si} for k in range(len(sheet.rows))]
    for row, kind in zip(rows, types, strict=True):
        if kind == "prismatic":
            row |= {"type": kind, "theta": row.pop("offset", 0.0)}
    return rows, [f"{table.name}: lengths in {length}, angles in {angle}"]


def _factor(unit: str, kind: str, table: Path) -> float:
    """What one of `unit` is in SI. Errors: InputError for a unit that is none of `kind`, length or angle."""
    known = {name: factor for name, (of, factor, _) in UNITS.items() if of == kind}
    if unit not in known:
        raise InputError(f"{table} header: found the unit '{unit}', expected one of {', '.join(known)}")
    return known[unit]


def _types(sheet: Sheet, name: str | None, table: Path) -> list[str]:
    """revolute or prismatic, by the first letter of each cell; revolute without a column. Errors: InputError."""
    if name is None:
        return ["revolute"] * len(sheet.rows)
    types = []
    for cell, row in zip(sheet.cells(name), sheet.numbers, strict=True):
        found = [kind for kind, begins in _TYPES.items() if cell.strip().lower().startswith(begins)]
        if not found:
            raise InputError(
                f"{table} row {row} column {name}: found '{cell}', expected revolute or prismatic"
            )
        types.append(found[0])
    return types


def _numbers(sheet: Sheet, name: str, table: Path) -> list[float]:
    cells = sheet.cells(name)
    for cell, row in zip(cells, sheet.numbers, strict=True):
        if not is_number(cell or "0", sheet.decimal):
            raise InputError(f"{table} row {row} column {name}: found '{cell}', expected a number")
    return [to_float(cell or "0", sheet.decimal) for cell in cells]
