"""Causes that look alike, and the measurement that separates them: `python -m armtrue_sim.alike` prints the table.

For a cause of realistic size the table gives the displacement that remains after a fit of base, tool, zeros and links;
after a fit of its double too, in an ordinary session; and the latter in the deciding session. It also gives the odds of
the cause against its double from 60 such poses: the likelihood ratio, from the remaining displacement over the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .arm import Arm, Columns, Term
from .build import build_arm
from .mechanics.transforms import Array
from .poses import random_poses
from .scenario import Scenario
from .sensitivity import geometry_terms, orthonormal_range, rms, sensitivity, unexplained, unit_term

POSES, SIGMA = 60, 8e-6
Session = Callable[[Arm, np.random.Generator], tuple[Array, dict[str, Array]]]


SHARE = 0.3  # of every joint's travel, about its middle: a cell does not leave an arm more room


def ordinary(arm: Arm, rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    """Session in a part of the travel, with one payload, one approach direction and one warming morning."""
    low, high = arm.chain.limits.T
    middle, half = (low + high) / 2.0, SHARE * (high - low) / 2.0
    q = random_poses(
        arm.robot, arm.chain, POSES, rng, joint_range=np.stack([middle - half, middle + half], axis=1)
    )
    time = 25.0 * np.arange(POSES)
    columns = {
        "payload": np.full(POSES, 8.0),
        "time": time,
        "temp_arm": 20.0 + 12.0 * (1.0 - np.exp(-time / 900.0)),
    }
    return q, columns | {f"dir{k}": np.ones(POSES) for k in range(1, arm.chain.n + 1)}


def with_three_payloads(arm: Arm, rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    """The ordinary session with a payload that changes from pose to pose."""
    q, columns = ordinary(arm, rng)
    return q, columns | {"payload": np.tile([0.0, 8.0, 16.0], POSES // 3)}


def from_both_sides(arm: Arm, rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    """Thirty poses of the ordinary session, each approached from both sides."""
    q, columns = ordinary(arm, rng)
    sides = np.tile([1.0, -1.0], POSES // 2)
    return np.repeat(q[: POSES // 2], 2, axis=0), columns | {
        f"dir{k}": sides for k in range(1, arm.chain.n + 1)
    }


def with_a_rest(arm: Arm, rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    """Warm-up, rest until the arm is cold, the same warm-up again: time goes on while the temperature repeats."""
    q, columns = ordinary(arm, rng)
    half = POSES // 2
    warmth = np.tile(columns["temp_arm"][:half], 2)
    return q, columns | {
        "temp_arm": warmth,
        "time": columns["time"] + np.where(np.arange(POSES) < half, 0.0, 1e4),
    }


def turned_about_axis_one(arm: Arm, rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    """Thirty ordinary poses, and thirty with joint 1 turned through its travel, the arm retracted to extended."""
    q, columns = ordinary(arm, rng)
    low, high = 0.95 * arm.chain.limits[0]
    q[POSES // 2 :, 0] = np.linspace(low, high, POSES // 2)
    return q, columns


@dataclass(frozen=True)
class Double:
    """A cause, the effect that it is mistaken for, and the session that decides. Entries are those of a scenario."""

    cause: Mapping[str, Any]
    taken_for: Mapping[str, Any]
    session: Session
    measurement: str
    believed: list[Any] = field(default_factory=list)


DOUBLES = (
    Double(
        {"effect": "joint_compliance", "joints": [2]},
        {"effect": "gear_harmonics", "joints": [2]},
        with_three_payloads,
        "three payloads in turn",
    ),
    Double(
        {"effect": "stiffness_nonlinear", "joints": [2]},
        {"effect": "gear_harmonics", "joints": [2]},
        with_three_payloads,
        "three payloads in turn",
        [{"effect": "joint_compliance", "joints": [2]}],
    ),
    Double(
        {"effect": "bending_compliance", "joints": [1]},
        {"effect": "base_compliance"},
        turned_about_axis_one,
        "joint 1 turned, retracted and extended",
    ),
    Double(
        {"effect": "bending_compliance", "joints": [2]},
        {"effect": "joint_compliance", "joints": [2]},
        with_three_payloads,
        "three payloads in turn",
    ),
    Double(
        {"effect": "thermal_expansion"},
        {"effect": "warm_up", "tau": 900.0},
        with_a_rest,
        "rest, cool and return",
    ),
    Double(
        {"effect": "thermal_joint_drift", "joints": [2]},
        {"effect": "warm_up", "tau": 900.0},
        with_a_rest,
        "rest, cool and return",
    ),
    Double(
        {"effect": "backlash", "joints": [2]},
        {"effect": "joint_offset", "joints": [2]},
        from_both_sides,
        "both approaches",
    ),
)


def terms_of(entries: list[Mapping[str, Any]], arm: str, seed: int) -> list[Term]:
    """True terms of scenario entries on an arm."""
    return build_arm(Scenario(arm=arm, seed=seed, believed=[], hidden=[dict(e) for e in entries])).terms


def left(double: Double, session: Session, arm_name: str, seed: int) -> tuple[float, float]:
    """RMS (m) of the cause that remains after a fit of the geometry, and after one with its double too."""
    rng = np.random.default_rng([seed, 15])
    believed = terms_of(list(double.believed), arm_name, seed)
    cause, taken_for = (terms_of([e], arm_name, seed) for e in (double.cause, double.taken_for))
    bare = build_arm(Scenario(arm=arm_name, seed=seed, believed=[]))
    q, columns = session(bare, rng)
    moved = _moved(bare, believed + cause, q, columns) - _moved(bare, believed, q, columns)
    known = sensitivity(bare, q, columns, geometry_terms(bare) + _units(believed))
    both = np.hstack([known, sensitivity(bare, q, columns, _units(taken_for))])
    alone, beside = (unexplained(moved, orthonormal_range(basis)) for basis in (known, both))
    return rms(alone), rms(beside)


def _units(terms: list[Term]) -> list[Term]:
    return [unit_term(t.coordinate, t.expression) for t in terms]


def _moved(arm: Arm, terms: list[Term], q: Array, columns: Columns) -> Array:
    return arm.with_terms(terms).true_position(q, columns)


def odds(rest: float) -> str:
    """Odds of the cause against its double from POSES poses, if `rest` (m, RMS) remains of the cause, as text."""
    power = POSES * rest**2 / (2.0 * SIGMA**2) / float(np.log(10.0))
    return "even" if power < 0.5 else f"10^{power:.0f}" if power < 99.5 else "beyond 10^99"


def name(entry: Mapping[str, Any]) -> str:
    """`effect joints`."""
    return " ".join([entry["effect"], *(str(k) for k in entry.get("joints", []))])


def table(arm: str = "kr30", seeds: int = 5) -> str:
    """Markdown; medians over the seeds."""
    lines = [
        "| cause | taken for | geometry leaves [µm] | and the double [µm] | odds | what decides | left [µm] | odds |",
        f"|{'---|' * 8}",
    ]
    for double in DOUBLES:
        before, after = (
            np.median([left(double, session, arm, seed) for seed in range(seeds)], axis=0)
            for session in (ordinary, double.session)
        )
        lines.append(
            f"| {name(double.cause)} | {name(double.taken_for)} | {1e6 * before[0]:.1f} | {1e6 * before[1]:.1f} "
            f"| {odds(before[1])} | {double.measurement} | {1e6 * after[1]:.1f} | {odds(after[1])} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(table(), end="")
