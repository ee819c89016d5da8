"""Mass sets: the arm's masses, and fitted mass moments, from which the device computes gravity torques."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from armtrue.arrays import Array
from armtrue.tables.chain import Chain
from armtrue.tables.fixedpoint import fraction_for
from armtrue.tables.layout import State

_OF_ARM = re.compile(r"^(?:tau|gm([xy]))(\d+)$|^bm([xy])$")
_OF_UNIT = re.compile(r"^u(?:([xy]?)_(\d+)_(\d+)_([mxyz])|p([xy]?)_(\d+))$")
# The unit mass of the payload regressors `up_K`: 1 kg on the last link, at the payload's point.
PAYLOAD = (-1, "p")

# A gravity variable whose range is below this share of the largest value that its masses can produce counts as zero:
# the device's sums cannot distinguish it from zero. Where physics makes it zero (the moment about a vertical axis),
# rounding in double precision leaves some 1e-16 of that value.
_LAST_PLACE = 2.0**-30


@dataclass(frozen=True)
class Reading:
    """A quantity computed from a mass set: a kind of gravity state variable, of one joint (0-based)."""

    kind: State
    joint: int


@dataclass(frozen=True)
class GravityVariable:
    """A gravity variable of docs/model.md.

    `unit`: link (from 0) and component of the unit mass or mass moment that it belongs to; None: the arm's own masses.
    """

    reading: Reading
    unit: tuple[int, str] | None

    @property
    def is_regressor(self) -> bool:
        """True for `u_K_J_C`, `ux_K_J_C`, `uy_K_J_C`."""
        return self.unit not in (None, PAYLOAD)


def gravity_variable(name: str) -> GravityVariable | None:
    """The gravity variable `name`; None for any other name."""
    if match := _OF_ARM.match(name):
        return GravityVariable(_reading(match[1] or match[3] or "", int(match[2] or 0)), None)
    if match := _OF_UNIT.match(name):
        unit = (int(match[3]) - 1, match[4]) if match[4] else PAYLOAD
        return GravityVariable(_reading(match[1] or match[5] or "", int(match[2] or match[6])), unit)
    return None


def _reading(letter: str, joint: int) -> Reading:
    """`joint` counts from 1; 0 is the base."""
    if joint == 0:
        return Reading(State.BASE_MOMENT_X if letter == "x" else State.BASE_MOMENT_Y, 0)
    return Reading({"": State.TORQUE, "x": State.MOMENT_X, "y": State.MOMENT_Y}[letter], joint - 1)


@dataclass
class MassSet:
    """Masses (n,) [kg] and first moments (n, 3) [kg m], or fitted multiples of them."""

    masses: Array
    moments: Array
    carries_payload: bool = False
    fraction: int = 0

    @classmethod
    def empty(cls, joint_count: int) -> MassSet:
        """No masses."""
        return cls(np.zeros(joint_count), np.zeros((joint_count, 3)))


@dataclass
class GravitySets:
    """The mass sets of one table. `payload_max_kg` bounds the payload for the choice of exponents."""

    chain: Chain
    payload_point: Array  # in the last link's frame, m
    payload_max_kg: float
    sets: list[MassSet] = field(default_factory=list)
    _numbers: dict[tuple[int, str] | None, int] = field(default_factory=dict)

    def reading(self, name: str) -> tuple[int, Reading] | None:
        """Set and reading of the gravity variable `name`; None if it is none or its masses are unknown."""
        variable = gravity_variable(name)
        if variable is None or (variable.unit is None and self.chain.masses is None):
            return None
        if variable.unit not in self._numbers:
            self._numbers[variable.unit] = len(self.sets)
            self.sets.append(masses_of(variable.unit, self.chain, self.payload_point))
        return self._numbers[variable.unit], variable.reading

    def combined(self, coefficients: dict[str, float]) -> dict[Reading, int]:
        """One mass set per reading for Σ coefficient · regressor, so that the device computes the whole sum at once."""
        made: dict[Reading, int] = {}
        for name, coefficient in coefficients.items():
            variable = gravity_variable(name)
            assert variable is not None
            assert variable.unit is not None
            if variable.reading not in made:
                made[variable.reading] = len(self.sets)
                self.sets.append(MassSet.empty(self.chain.joint_count))
            _add(self.sets[made[variable.reading]], variable.unit, coefficient, self.payload_point)
        return made

    def choose_fractions(self) -> None:
        """Set every set's fraction bits from the largest moment and torque that it can make."""
        for mass_set in self.sets:
            most = 30 if mass_set.carries_payload else 60
            mass_set.fraction = max(0, fraction_for(self._largest(mass_set), most=most))

    def is_zero(self, name: str, largest: float) -> bool:
        """True if the gravity variable `name`, at most `largest` in the workspace, is zero except for rounding."""
        variable = gravity_variable(name)
        assert variable is not None
        masses = masses_of(variable.unit, self.chain, self.payload_point)
        return largest < _LAST_PLACE * self._largest(masses)

    def _largest(self, mass_set: MassSet) -> float:
        """Upper bound of the moments and torques of `mass_set`: its masses at the arm's reach, under gravity."""
        n = self.chain.joint_count
        # Distance of frame k's origin from the base is bounded by the lengths before it.
        lengths = np.array([np.linalg.norm(fixed[:3, 3]) for fixed in self.chain.fixed])
        reach = np.cumsum(lengths) + np.where(
            self.chain.prismatic, np.abs(self.chain.limits).max(axis=1), 0.0
        )
        weight = max(float(np.linalg.norm(self.chain.gravity)), 1.0)
        masses = np.abs(mass_set.masses)
        moments = np.linalg.norm(mass_set.moments, axis=1)
        if mass_set.carries_payload:
            masses = masses + np.eye(n)[-1] * self.payload_max_kg
            moments = moments + np.eye(n)[-1] * self.payload_max_kg * np.linalg.norm(self.payload_point)
        return max(weight * float(masses @ reach + moments.sum()), float(masses.sum()))


def _add(mass_set: MassSet, unit: tuple[int, str], amount: float, payload_point: Array) -> None:
    link, component = unit
    if component in ("m", "p"):
        mass_set.masses[link] += amount
    if component == "p":
        mass_set.moments[link] += amount * payload_point
    elif component != "m":
        mass_set.moments[link, "xyz".index(component)] += amount


def masses_of(unit: tuple[int, str] | None, chain: Chain, payload_point: Array) -> MassSet:
    """The masses of a gravity variable's `unit`, without a payload."""
    if unit is None:
        assert chain.masses is not None
        assert chain.coms is not None
        return MassSet(chain.masses.copy(), chain.masses[:, None] * chain.coms, carries_payload=True)
    mass_set = MassSet.empty(chain.joint_count)
    _add(mass_set, unit, 1.0, payload_point)
    return mass_set
