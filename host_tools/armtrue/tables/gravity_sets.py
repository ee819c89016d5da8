"""Mass sets: the arm's masses, and fitted mass moments, from which the device computes gravity torques."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from armtrue.arrays import Array
from armtrue.tables.chain import Chain
from armtrue.tables.fixedpoint import fraction_for
from armtrue.tables.layout import State

_REGRESSOR = re.compile(r"^u(x|y)?_(\d+)_(\d+)_([mxyz])$")
_PAYLOAD_REGRESSOR = re.compile(r"^up(x|y)?_(\d+)$")
_MOMENT = re.compile(r"^(tau|gmx|gmy)(\d+)$")

# A gravity variable whose range is below this share of the largest value that its masses can produce counts as zero:
# the device's sums cannot distinguish it from zero. Where physics makes it zero (the moment about a vertical axis),
# rounding in double precision leaves some 1e-16 of that value.
_LAST_PLACE = 2.0**-30

# Bits of the device's 32 that a set's largest moment or torque fills.
_LARGEST_BITS = 30


@dataclass(frozen=True)
class Reading:
    """A quantity computed from a mass set: a kind of gravity state variable, of one joint (0-based)."""

    kind: State
    joint: int


@dataclass
class MassSet:
    """Masses (n,) [kg] and first moments (n, 3) [kg m], or fitted multiples of them."""

    masses: Array
    moments: Array
    carries_payload: bool = False
    fraction: int = 0


def reading_of(letter: str | None, joint: int) -> Reading:
    """The reading of a regressor `u`, `ux` or `uy` of joint `joint` (1-based, 0: base)."""
    if joint == 0:
        return Reading(State.BASE_MOMENT_X if letter == "x" else State.BASE_MOMENT_Y, 0)
    kind = {None: State.TORQUE, "x": State.MOMENT_X, "y": State.MOMENT_Y}[letter]
    return Reading(kind, joint - 1)


@dataclass
class GravitySets:
    """The mass sets of one table. `payload_max_kg` bounds the payload for the choice of exponents."""

    chain: Chain
    payload_point: Array  # in the last link's frame, m
    payload_max_kg: float
    sets: list[MassSet] = field(default_factory=list)
    _arm_set: int | None = None
    _unit_sets: dict[tuple[object, ...], int] = field(default_factory=dict)

    def reading(self, name: str) -> tuple[int, Reading] | None:
        """Set and reading of the gravity variable `name`; None if it is none or its masses are unknown."""
        match = _MOMENT.match(name)
        if match or name in ("bmx", "bmy"):
            if self.chain.masses is None:
                return None
            if match is None:
                return self._arm(), reading_of(name[-1], 0)
            letter = {"tau": None, "gmx": "x", "gmy": "y"}[match[1]]
            return self._arm(), reading_of(letter, int(match[2]))
        match = _PAYLOAD_REGRESSOR.match(name)
        if match:
            return self._unit(self.chain.joint_count - 1, "p"), reading_of(match[1], int(match[2]))
        match = _REGRESSOR.match(name)
        if match:
            return self._unit(int(match[3]) - 1, match[4]), reading_of(match[1], int(match[2]))
        return None

    def combined(self, coefficients: dict[str, float]) -> dict[Reading, int]:
        """One mass set per reading for Σ coefficient · regressor, so that the device computes the whole sum at once."""
        made: dict[Reading, MassSet] = {}
        for name, coefficient in coefficients.items():
            match = _REGRESSOR.match(name)
            assert match is not None
            where = reading_of(match[1], int(match[2]))
            mass_set = made.setdefault(where, self._empty())
            self._add(mass_set, int(match[3]) - 1, match[4], coefficient)
        result = {}
        for where, mass_set in made.items():
            self.sets.append(mass_set)
            result[where] = len(self.sets) - 1
        return result

    def choose_fractions(self) -> None:
        """Set every set's fraction bits from the largest moment and torque that it can make."""
        for mass_set in self.sets:
            mass_set.fraction = max(
                0,
                fraction_for(
                    self._largest(mass_set),
                    bits=_LARGEST_BITS,
                    most=30 if mass_set.carries_payload else 60,
                ),
            )

    def is_zero(self, name: str, largest: float) -> bool:
        """True if the gravity variable `name`, at most `largest` in the workspace, is zero except for rounding."""
        match = _PAYLOAD_REGRESSOR.match(name) or _REGRESSOR.match(name)
        if match is None:
            mass_set = self._arm_masses()
        elif _REGRESSOR.match(name):
            mass_set = self._unit_masses(int(match[3]) - 1, match[4])
        else:
            mass_set = self._unit_masses(self.chain.joint_count - 1, "p")
        return largest < _LAST_PLACE * self._largest(mass_set)

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

    @staticmethod
    def is_gravity(name: str) -> bool:
        """True for every gravity variable."""
        return name in ("bmx", "bmy") or any(p.match(name) for p in (_MOMENT, _REGRESSOR, _PAYLOAD_REGRESSOR))

    @staticmethod
    def is_regressor(name: str) -> bool:
        """True for `u_K_J_C`, `ux_K_J_C`, `uy_K_J_C`."""
        return _REGRESSOR.match(name) is not None

    def _empty(self) -> MassSet:
        n = self.chain.joint_count
        return MassSet(np.zeros(n), np.zeros((n, 3)))

    def _add(self, mass_set: MassSet, link: int, component: str, amount: float) -> None:
        if component == "m":
            mass_set.masses[link] += amount
        elif component == "p":
            mass_set.masses[link] += amount
            mass_set.moments[link] += amount * self.payload_point
        else:
            mass_set.moments[link, "xyz".index(component)] += amount

    def _arm_masses(self) -> MassSet:
        assert self.chain.masses is not None
        assert self.chain.coms is not None
        moments = self.chain.masses[:, None] * self.chain.coms
        return MassSet(self.chain.masses.copy(), moments, carries_payload=True)

    def _arm(self) -> int:
        if self._arm_set is None:
            self.sets.append(self._arm_masses())
            self._arm_set = len(self.sets) - 1
        return self._arm_set

    def _unit_masses(self, link: int, component: str) -> MassSet:
        mass_set = self._empty()
        self._add(mass_set, link, component, 1.0)
        return mass_set

    def _unit(self, link: int, component: str) -> int:
        key = (link, component)
        if key not in self._unit_sets:
            self.sets.append(self._unit_masses(link, component))
            self._unit_sets[key] = len(self.sets) - 1
        return self._unit_sets[key]
