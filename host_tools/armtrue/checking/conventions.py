"""Wrong conventions: what single change of sign, zero, coupling or order makes the measurements follow the joints.

Each hypothesis is a change of the columns, judged by what distance stays after base and tool are found from nothing
with nominal kinematics. A right convention leaves millimetres, a wrong one a good part of the arm's reach.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from armtrue.checking.alignment import NOMINAL_ERROR_PER_REACH, Columns, align, thinned
from armtrue.checking.report import Finding
from armtrue.io.robot import Robot

# A hypothesis is believed when it leaves at most this share of the residual.
_CONVINCING = 1 / 3
_ROWS_FOR_HYPOTHESES = 50
# Hypotheses that leave at most so many times what the best leaves explain the data as well.
_AS_WELL = 1.5
_MOST_CHANGES = 3
_JOINTS_FOR_ALL_SIGNS = 7


@dataclass(frozen=True)
class Hypothesis:
    """A change that would explain the data: its finding's code, sentence and remedy, and the change itself."""

    code: str
    sentence: str
    remedy: str
    apply: Callable[[Columns], Columns]


def find(columns: Columns, robot: Robot) -> list[Finding]:
    """One error for each convention that is wrong, or one where positions follow the joints under none tried."""
    rms = _rms(columns, robot)
    acceptable = NOMINAL_ERROR_PER_REACH * robot.reach_m
    if rms <= acceptable:
        return []
    start = rms
    found: list[list[_Judged]] = []
    while rms > acceptable and len(found) < _MOST_CHANGES:
        judged = _judged(_hypotheses(robot, allow_order=not found), columns, robot)
        if judged[0].rms_m > _CONVINCING * rms:
            judged = _judged(_sign_patterns(robot), columns, robot)
        if judged[0].rms_m > _CONVINCING * rms:
            break
        found.append(judged)
        columns = judged[0].hypothesis.apply(columns)
        rms = judged[0].rms_m
    if not found:
        return [_no_convention(start)]
    return [_finding(judged, start, rms, alone=len(found) == 1) for judged in found]


@dataclass(frozen=True)
class _Judged:
    hypothesis: Hypothesis
    rms_m: float


def _finding(judged: list[_Judged], start: float, rms: float, alone: bool) -> Finding:
    change = judged[0].hypothesis
    best = min(one.rms_m for one in judged)
    as_well = [other.hypothesis.sentence for other in judged[1:] if other.rms_m <= _AS_WELL * best]
    words = f" (or {'; or '.join(as_well)})" if as_well else ""
    return Finding(
        change.code,
        "error",
        f"{change.sentence}{words}: with nominal kinematics {start * 1000:.1f} mm RMS stay as the files stand, "
        f"{rms * 1000:.2f} mm {'so' if alone else 'with all that is found here'}",
        {"rms_m": start, "rms_m_if_changed": rms, "as_well": as_well},
        change.remedy,
    )


def _no_convention(rms: float) -> Finding:
    return Finding(
        "positions_do_not_follow",
        "error",
        f"the positions do not follow the joints: whatever base and tool, {rms * 1000:.0f} mm RMS stay, and no single "
        "sign, zero, coupling or order of columns explains it",
        {"rms_m": rms},
        "Compare robot.yaml with the arm's data sheet, and the pairing of joints and positions with the log.",
    )


def _rms(columns: Columns, robot: Robot) -> float:
    return align(thinned(columns, _ROWS_FOR_HYPOTHESES), robot).rms_m


def _judged(hypotheses: Iterator[Hypothesis], columns: Columns, robot: Robot) -> list[_Judged]:
    """All hypotheses, the best first; those about as good as the best stand first in their own order."""
    judged = [_Judged(hypothesis, _rms(hypothesis.apply(columns), robot)) for hypothesis in hypotheses]
    best = min(one.rms_m for one in judged)
    return sorted(judged, key=lambda one: max(one.rms_m, _AS_WELL * best))


def _hypotheses(robot: Robot, allow_order: bool) -> Iterator[Hypothesis]:
    yield from _signs(robot)
    yield from _zeros(robot)
    yield from _couplings(robot)
    if allow_order:
        yield from _orders(robot)


def _revolute(robot: Robot) -> list[int]:
    return [k for k, joint in enumerate(robot.joints, start=1) if joint["type"] == "revolute"]


def _with(name: str, change: Callable[[Columns], object]) -> Callable[[Columns], Columns]:
    """The columns with column `name` replaced by what `change` makes of them."""
    return lambda columns: {**columns, name: np.asarray(change(columns), dtype=np.float64)}


def _signs(robot: Robot) -> Iterator[Hypothesis]:
    for k in range(1, robot.joint_count + 1):
        name = f"q{k}"
        yield Hypothesis(
            "joint_sign",
            f"joint {k} turns the other way than in robot.yaml",
            f"Give {name} 'scale: -1' in a dataset.yaml, or turn axis {k} round in robot.yaml.",
            _with(name, lambda columns, name=name: -columns[name]),  # type: ignore[misc]
        )


def _sign_patterns(robot: Robot) -> Iterator[Hypothesis]:
    """Several signs at once, which one by one need not lessen the residual."""
    joints = range(1, robot.joint_count + 1)
    if robot.joint_count > _JOINTS_FOR_ALL_SIGNS:
        pairs = itertools.combinations(joints, 2)
        patterns = (set(pair) for pair in pairs)
    else:
        patterns = (
            set(chosen)
            for size in range(2, robot.joint_count)
            for chosen in itertools.combinations(joints, size)
        )
    for pattern in patterns:
        names = [f"q{k}" for k in sorted(pattern)]
        words = ", ".join(str(k) for k in sorted(pattern))

        def turn(columns: Columns, names: list[str] = names) -> Columns:
            return {**columns, **{name: -columns[name] for name in names}}

        yield Hypothesis(
            "joint_sign",
            f"joints {words} turn the other way than in robot.yaml",
            f"Give {', '.join(names)} 'scale: -1' in a dataset.yaml, or turn these axes round in robot.yaml.",
            turn,
        )


def _zeros(robot: Robot) -> Iterator[Hypothesis]:
    # The first joint's zero is the base's turn, the last one's the tool's: both are found from the data anyway.
    for k in _revolute(robot):
        if k in (1, robot.joint_count):
            continue
        for degrees in (-90, 90, 180):
            name, turn = f"q{k}", math.radians(degrees)
            yield Hypothesis(
                "joint_zero",
                f"joint {k} has its zero {degrees:+d}° from that in robot.yaml",
                f"Add {turn:+.6f} to the offset of joint {k} in robot.yaml.",
                _with(name, lambda columns, name=name, turn=turn: columns[name] + turn),  # type: ignore[misc]
            )


def _couplings(robot: Robot) -> Iterator[Hypothesis]:
    given = {(row["joint"], row["driving"]): row["ratio"] for row in robot.spec.get("coupling", [])}
    for joint in range(2, robot.joint_count + 1):
        driving = joint - 1
        ratio = given.get((joint, driving), 0.0)
        for right in (-1.0, 0.0, 1.0):
            if right == ratio:
                continue
            words = (
                "its own command alone"
                if right == 0.0
                else f"q{joint} {'+' if right > 0 else '−'} q{driving}"
            )
            remedy = (
                f"Take the coupling of joint {joint} out of robot.yaml."
                if right == 0.0
                else f"Give robot.yaml 'coupling: [{{joint: {joint}, driving: {driving}, ratio: {right:+.1f}}}]'."
            )

            def couple(
                columns: Columns, joint: int = joint, driving: int = driving, more: float = right - ratio
            ) -> object:
                return columns[f"q{joint}"] + more * columns[f"q{driving}"]

            yield Hypothesis(
                "coupling", f"link angle {joint} follows {words}", remedy, _with(f"q{joint}", couple)
            )


def _orders(robot: Robot) -> Iterator[Hypothesis]:
    for one, other in itertools.combinations(range(1, robot.joint_count + 1), 2):

        def swap(columns: Columns, one: str = f"q{one}", other: str = f"q{other}") -> Columns:
            return {**columns, one: columns[other], other: columns[one]}

        yield Hypothesis(
            "joints_swapped",
            f"columns q{one} and q{other} stand in each other's place",
            f"Swap the columns q{one} and q{other}, or name them rightly in a dataset.yaml.",
            swap,
        )
    for lag, words in ((1, "after"), (-1, "before")):

        def shift(columns: Columns, lag: int = lag) -> Columns:
            inner = slice(1, -1)
            return {
                name: np.roll(values, -lag)[inner] if name in ("x", "y", "z") else values[inner]
                for name, values in columns.items()
            }

        yield Hypothesis(
            "rows_shifted",
            f"each position stands in the row {words} the joints it belongs to",
            "Pair joints and positions again from the logs, by their times.",
            shift,
        )
    yield Hypothesis(
        "left_handed_frame",
        "the measuring frame is left-handed (one of its axes is the wrong way round)",
        "Give one of x, y, z 'scale: -1' in a dataset.yaml, or correct the instrument's frame.",
        _with("z", lambda columns: -columns["z"]),
    )
