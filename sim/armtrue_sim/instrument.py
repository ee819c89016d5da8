"""Random errors of the instrument and the drives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arm import Arm
from .errors import ScenarioError
from .mechanics.transforms import Array

# Stops at each pose from which the standard computes the repeatability.
ISO_9283_STOPS = 30


@dataclass(frozen=True)
class Instrument:
    """Noise as one sigma per axis, a + b x distance in metres, separately radial and angular (transverse).

    `position`: where the instrument stands in the measuring frame. `orientation`: rad, for full poses.
    """

    radial: tuple[float, float] = (8e-6, 0.0)
    angular: tuple[float, float] = (8e-6, 0.0)
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: float = 0.0

    @classmethod
    def from_dict(cls, given: Mapping[str, Any], where: str) -> Instrument:
        """From `{sigma: s}` or `{radial: [a, b], angular: [a, b], position: [x, y, z]}`, either with `orientation`."""
        known = {"sigma", "radial", "angular", "position", "orientation"}
        unknown = sorted(set(given) - known)
        if unknown:
            raise ScenarioError(f"{where}: unknown key '{unknown[0]}', expected {', '.join(sorted(known))}")
        try:
            sigma = (float(given.get("sigma", 8e-6)), 0.0)
            parts: dict[str, tuple[float, float]] = {}
            for name in ("radial", "angular"):
                a, b = given.get(name, sigma)
                parts[name] = (float(a), float(b))
            x, y, z = (float(v) for v in given.get("position", (0.0, 0.0, 0.0)))
            instrument = cls(
                parts["radial"], parts["angular"], (x, y, z), float(given.get("orientation", 0.0))
            )
        except (TypeError, ValueError):
            raise ScenarioError(
                f"{where}: {dict(given)}, expected sigma: s or radial: [a, b] and angular: [a, b] in metres"
            ) from None
        if min(*instrument.radial, *instrument.angular, instrument.orientation) < 0.0:
            raise ScenarioError(f"{where}: a standard deviation is negative, expected zero or more")
        return instrument

    def sigmas(self, points: Array) -> tuple[Array, Array]:
        """(radial, transverse) standard deviations (N,) at points (N, 3)."""
        distance = np.linalg.norm(points - np.array(self.position), axis=1)
        return (
            self.radial[0] + self.radial[1] * distance,
            self.angular[0] + self.angular[1] * distance,
        )

    def sigma_per_axis(self, points: Array) -> Array:
        """One standard deviation per axis (N,), root mean square over directions, as in a `sigma` column."""
        radial, transverse = self.sigmas(points)
        return np.sqrt((radial**2 + 2.0 * transverse**2) / 3.0)

    def noise(self, points: Array, rng: np.random.Generator) -> Array:
        """Random errors of the instrument at points (N, 3), metres."""
        sight = points - np.array(self.position)
        distance = np.linalg.norm(sight, axis=1, keepdims=True)
        sight = np.divide(
            sight, distance, out=np.tile([1.0, 0.0, 0.0], (len(points), 1)), where=distance > 0.0
        )
        radial, transverse = self.sigmas(points)
        white = rng.standard_normal(points.shape)
        along = np.sum(white * sight, axis=1, keepdims=True) * sight
        return transverse[:, None] * (white - along) + radial[:, None] * along


def drive_sigma_for_tool_repeatability(arm: Arm, q: Array, mean_distance: float) -> float:
    """Drive repeatability (rad, one sigma, equal on all axes) for a given mean distance from the cluster centre.

    `mean_distance` (m) is ISO 9283's l-bar, over at most 400 of the poses q (N, n), with thirty stops per pose as in
    the standard. The seed is fixed, so that the result depends on the arm and not on the scenario.
    """
    rng = np.random.default_rng(9283)
    some = q[:: max(len(q) // 400, 1)]
    probe = 1e-6
    stops = np.repeat(some, ISO_9283_STOPS, axis=0)
    tool = arm.true_position(stops, motor_error=probe * rng.standard_normal(stops.shape)).reshape(
        len(some), ISO_9283_STOPS, 3
    )
    spread = np.linalg.norm(tool - tool.mean(axis=1, keepdims=True), axis=2).mean()
    return float(probe * mean_distance / spread)
