"""Possible mistakes in how a file was read: signs, zeros, couplings, conventions, units, order of columns and rows.

Each hypothesis is a change of the reading; it is judged by how well the nominal arm then follows the points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armtrue.checking import lengths
from armtrue.checking.placement import Reading
from armtrue.io.columns import POSITION
from armtrue.io.robot import Robot
from armtrue.io.rotation import matrix_from_euler, rpy_from_matrix

_JOINTS_FOR_ALL_SIGNS = 7
KIND_OF_COUPLING = (
    "Positions do not show whether the coupling is mechanical: turn joint {driving} alone and watch the encoder of "
    "joint {joint}'s motor. If it stays constant, bars or gears couple ('kind: mechanical'); if it changes, the "
    "controller does ('kind: controller')."
)


@dataclass(frozen=True)
class Hypothesis:
    """A change of the reading: its finding's code, sentence and remedy, and the change itself.

    `changes`: number of single mistakes that it stands for. `about`: hypotheses that share an entry are never paired.
    `parts`: the single hypotheses of a pair; empty for a single one. `figures`: additional evidence.
    """

    code: str
    sentence: str
    remedy: str
    apply: Callable[[Reading], Reading]
    about: frozenset[str] = field(default_factory=frozenset)
    changes: int = 1
    parts: tuple[Hypothesis, ...] = ()
    figures: dict[str, Any] = field(default_factory=dict)

    def each(self) -> tuple[Hypothesis, ...]:
        """The single hypotheses in it."""
        return self.parts or (self,)


def pair(one: Hypothesis, other: Hypothesis) -> Hypothesis | None:
    """Both changes together; None if their `about` overlap."""
    if one.about & other.about:
        return None
    return Hypothesis(
        one.code,
        f"{one.sentence}, and {other.sentence}",
        f"{one.remedy} {other.remedy}",
        lambda reading: other.apply(one.apply(reading)),
        one.about | other.about,
        one.changes + other.changes,
        (*one.each(), *other.each()),
    )


def scale(factor: float, robot: Robot) -> Hypothesis:
    """Positions `factor` times as large as the arm `robot`."""
    return Hypothesis(
        "scale",
        lengths.sentence(factor, robot),
        lengths.remedy(factor, robot),
        lambda reading: Reading(lengths.scaled(reading.columns, factor), reading.spec),
        frozenset({"scale"}),
        figures={"scale": factor, "unit": lengths.unit_of_points(factor, robot)},
    )


def singles(robot: Robot) -> list[Hypothesis]:
    """Every single mistake, the likelier first."""
    return [
        *(_turned((k,), changes=1, robot=robot) for k in robot.motors),
        *_couplings(robot),
        *(zero(k, degrees, robot) for k in joints_with_a_zero(robot) for degrees in (90.0, -90.0, 180.0)),
        *_angles_of_joints(robot),
        *_conventions_of_the_table(robot),
        *_orders(robot),
    ]


def sign_patterns(robot: Robot) -> Iterator[Hypothesis]:
    """Three or more wrong signs at once; they count as two mistakes, as one different view of the arm explains all."""
    joints = robot.motors
    if robot.joint_count > _JOINTS_FOR_ALL_SIGNS:
        return
    for size in range(3, len(joints)):
        for pattern in itertools.combinations(joints, size):
            yield _turned(pattern, changes=2, robot=robot)


def _turned(pattern: tuple[int, ...], changes: int, robot: Robot) -> Hypothesis:
    names = [f"q{k}" for k in pattern]
    several = len(pattern) > 1
    return Hypothesis(
        "joint_sign",
        f"joint{'s' if several else ''} {', '.join(map(str, pattern))} turn{'' if several else 's'} "
        f"the other way than in {robot.kinematics_file}",
        f"Give {', '.join(names)} 'scale: -1' in a dataset.yaml, or reverse "
        f"{'these axes' if several else f'axis {pattern[0]}'} in {robot.kinematics_file}.",
        lambda reading: reading.with_columns(**{name: -reading.columns[name] for name in names}),
        frozenset(f"sign of {name}" for name in names),
        changes,
        figures={"joints": list(pattern)},
    )


def joints_with_a_zero(robot: Robot) -> list[int]:
    """Joints whose zero is tested: not the first and the last, whose zeros turn base and tool, which are fitted."""
    return [k for k in range(2, robot.joint_count) if robot.joints[k - 1]["type"] == "revolute"]


def zero(joint: int, degrees: float, robot: Robot) -> Hypothesis:
    """The zero of `joint` is `degrees` from that in `robot`."""
    turn = math.radians(degrees)
    name = f"q{joint}"
    passive = joint in robot.passive
    if robot.urdf is None:
        remedy = f"Add {turn:+.6f} to the offset of joint {joint} in robot.yaml."
    elif passive:
        remedy = f"Add {turn:+.6f} to the offset of joint {joint}'s <mimic> in {robot.urdf.name}."
    else:
        # A URDF has no offsets, and robot.yaml states none beside a URDF.
        remedy = (
            f"Give {name} its offset in a dataset.yaml, '{name}: {{column: {name}, offset: {turn:.6f}}}', added to an "
            "offset that is there already."
        )
    return Hypothesis(
        "joint_zero",
        f"joint {joint} has its zero {degrees:+.3g}° from that in {robot.kinematics_file}",
        remedy,
        lambda reading: (
            _with_offset(reading, joint, turn)
            if passive
            else reading.with_columns(**{name: reading.columns[name] + turn})
        ),
        frozenset({f"zero of {name}"}),
    )


def _with_offset(reading: Reading, joint: int, turn: float) -> Reading:
    kinematics = reading.spec["kinematics"]
    rows = [
        {**row, "offset": row.get("offset", 0.0) + turn} if number == joint else row
        for number, row in enumerate(kinematics["joints"], start=1)
    ]
    return reading.with_spec(kinematics={**kinematics, "joints": rows})


def _couplings(robot: Robot) -> Iterator[Hypothesis]:
    rows = {(row["joint"], row["driving"]): row for row in robot.spec.get("coupling", [])}
    # Couplings of kind controller are already removed from the reported angles.
    reported = {pair for pair, row in rows.items() if row.get("kind") == "controller"}
    for joint in range(2, robot.joint_count + 1):
        passive = joint in robot.passive
        # Bars can connect a passive joint with any joint before it.
        for driving in [k for k in robot.motors if k < joint] if passive else [joint - 1]:
            if driving in robot.passive or (joint, driving) in reported:
                continue
            others = any(pair[0] == joint and pair[1] != driving for pair in rows)
            given = rows[joint, driving]["ratio"] if (joint, driving) in rows else 0.0
            for right in (-1.0, 0.0, 1.0) if others or not passive else (-1.0, 1.0):
                if right != given:
                    yield _coupling(joint, driving, right, passive)


def _coupling(joint: int, driving: int, ratio: float, passive: bool) -> Hypothesis:
    if passive and ratio == 0.0:
        words = f"other joints than {driving}"
        remedy = f"Take the coupling of joint {joint} by {driving} out of robot.yaml."
    elif passive:
        words = f"{'' if ratio > 0 else '−'}q{driving} in addition to its other driving joints"
        remedy = (
            f"Give robot.yaml's coupling the row {{joint: {joint}, driving: {driving}, ratio: {ratio:+.1f}}}."
        )
    elif ratio == 0.0:
        words = "its own command only"
        remedy = f"Take the coupling of joint {joint} out of robot.yaml."
    else:
        words = f"q{joint} {'+' if ratio > 0 else '−'} q{driving}"
        remedy = (
            f"Give robot.yaml 'coupling: [{{joint: {joint}, driving: {driving}, ratio: {ratio:+.1f}}}]'. "
            + KIND_OF_COUPLING.format(joint=joint, driving=driving)
        )

    def couple(reading: Reading) -> Reading:
        rows = reading.spec.get("coupling", [])
        kept = [row for row in rows if (row["joint"], row["driving"]) != (joint, driving)]
        own = [{"joint": joint, "driving": driving, "ratio": ratio}] if ratio else []
        return reading.with_spec(coupling=[*kept, *own])

    return Hypothesis(
        "coupling",
        f"link angle {joint} follows {words}",
        remedy,
        couple,
        frozenset({f"coupling of q{joint}"}),
    )


def _angles_of_joints(robot: Robot) -> Iterator[Hypothesis]:
    revolute = [f"q{k}" for k, joint in enumerate(robot.joints, start=1) if joint["type"] == "revolute"]
    for code, factor, words, unit in (
        ("joints_in_degrees", math.pi / 180.0, "degrees, and were read as radians", "deg"),
        ("joints_in_radians", 180.0 / math.pi, "radians, and were read as degrees", "rad"),
    ):

        def convert(reading: Reading, factor: float = factor) -> Reading:
            return reading.with_columns(**{name: factor * reading.columns[name] for name in revolute})

        yield Hypothesis(
            code,
            f"the joints are in {words}",
            f"Give the joints 'unit: {unit}' in a dataset.yaml.",
            convert,
            frozenset({"unit of joints"}),
        )


def _conventions_of_the_table(robot: Robot) -> Iterator[Hypothesis]:
    kinematics = robot.spec["kinematics"]
    others = {
        "dh": ("mdh", "modified Denavit-Hartenberg (Craig's: a and alpha before the row's rotation)"),
        "mdh": ("dh", "standard Denavit-Hartenberg (a and alpha after the row's rotation)"),
    }
    if kinematics["convention"] in others:
        other, meant = others[kinematics["convention"]]
        yield Hypothesis(
            "dh_convention",
            f"the table in robot.yaml is {meant}",
            f"Give robot.yaml 'convention: {other}'.",
            lambda reading: reading.with_spec(kinematics={**reading.spec["kinematics"], "convention": other}),
            frozenset({"table"}),
        )
    elif any(np.count_nonzero(row.get("rpy", [0.0])) > 1 for row in kinematics["joints"]):
        yield Hypothesis(
            "fixed_or_intrinsic_angles",
            f"the rpy of the joints in {robot.kinematics_file} are about moving axes (intrinsic x, y, z)",
            "Write the rpy of each joint as angles about fixed axes x, y, z.",
            lambda reading: reading.with_spec(kinematics=_read_as_intrinsic(reading.spec["kinematics"])),
            frozenset({"table"}),
        )


def _read_as_intrinsic(kinematics: dict[str, Any]) -> dict[str, Any]:
    def turned(row: dict[str, Any]) -> dict[str, Any]:
        matrix = matrix_from_euler(np.array([row["rpy"]], dtype=np.float64), "xyz", True)[0]
        return {**row, "rpy": rpy_from_matrix(matrix)}

    joints = [turned(row) if "rpy" in row else row for row in kinematics["joints"]]
    return {**kinematics, "joints": joints}


def _orders(robot: Robot) -> Iterator[Hypothesis]:
    for one, other in itertools.combinations(robot.motors, 2):

        def swap(reading: Reading, one: str = f"q{one}", other: str = f"q{other}") -> Reading:
            return reading.with_columns(**{one: reading.columns[other], other: reading.columns[one]})

        yield Hypothesis(
            "joints_swapped",
            f"columns q{one} and q{other} are exchanged",
            f"Swap the columns q{one} and q{other}, or assign them correctly in a dataset.yaml.",
            swap,
            frozenset({"order"}),
            figures={"joints": [one, other]},
        )
    for lag, words in ((1, "after"), (-1, "before")):

        def shift(reading: Reading, lag: int = lag) -> Reading:
            # Rows at the ends have no partner and repeat their neighbour, so that all readings have the same length.
            count = len(reading.columns["x"])
            own = np.clip(np.arange(count), 1, count - 2)
            rows = {name: own + lag if name in POSITION else own for name in reading.columns}
            return Reading({name: reading.columns[name][at] for name, at in rows.items()}, reading.spec)

        yield Hypothesis(
            "rows_shifted",
            f"each position is in the row {words} that of its joints",
            "Pair joints and positions again from the logs, by their times.",
            shift,
            frozenset({"order"}),
        )
    yield Hypothesis(
        "left_handed_frame",
        "the measuring frame is left-handed (one of its axes is reversed)",
        "Give one of x, y, z 'scale: -1' in a dataset.yaml, or correct the instrument's frame.",
        lambda reading: reading.with_columns(z=-reading.columns["z"]),
        frozenset({"hand"}),
    )
