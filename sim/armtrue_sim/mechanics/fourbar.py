"""The parallelogram of an ABB-like arm as a real four-bar linkage, closed exactly for imperfect bars and pivots.

Pivots: O axis 2, O' the crank's pivot (O + offset), A the crank's tip, E axis 3, B where the rod drives link 3.
Bars: crank O'A, rod AB, rocker EB, lower arm OE. In the plane of axes 2 and 3, with x and y of the frame after F_2,

    A = offset + crank u(theta2 + beta),  E = arm u(theta2),  |A - B| = rod,  B = E + rocker u(psi).

Axis 3's motor turns the crank (absolutely), so beta = angle + q3 - q2, and link angle 3 is psi - theta2 - angle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .transforms import Array


def closing_error(x: Array, y: Array, arm: float, bar: float, nominal: Array) -> Array:
    """Angle (N,) of an arm minus `nominal`; its pivot is the origin and its end is `bar` away from (x, y).

    Of the two solutions, the one next to the parallelogram is returned; the other is the crossed linkage. Raises
    ValueError if the bars cannot close.
    """
    distance = np.hypot(x, y)
    cosine = (arm**2 + distance**2 - bar**2) / (2.0 * arm * distance)
    if np.any(np.abs(cosine) > 1.0):
        raise ValueError("the four-bar linkage does not close at a commanded pose")
    toward, spread = np.arctan2(y, x), np.arccos(cosine)
    candidates = np.stack([toward - spread, toward + spread])
    error = np.remainder(candidates - nominal + np.pi, 2.0 * np.pi) - np.pi
    return np.take_along_axis(error, np.abs(error).argmin(axis=0)[None], axis=0)[0]


@dataclass(frozen=True)
class FourBar:
    """Nominal bar lengths, their errors, pivot offset, metres; `angle`: beta if link angle 3 is zero (contract.md)."""

    crank: float
    rod: float
    angle: float
    crank_error: float = 0.0
    rod_error: float = 0.0
    rocker_error: float = 0.0
    arm_error: float = 0.0
    pivot_x: float = 0.0
    pivot_y: float = 0.0

    def scaled(self, factor: float) -> FourBar:
        """The same linkage with every error `factor` times as large."""
        errors = ("crank_error", "rod_error", "rocker_error", "arm_error", "pivot_x", "pivot_y")
        return replace(self, **{name: factor * getattr(self, name) for name in errors})

    def rocker_angle(self, theta2: Array, beta: Array) -> Array:
        """Angle of the rocker against the lower arm (N,), equal to beta for a perfect linkage.

        theta2 (N,): angle of the lower arm; beta (N,): of the crank against it. B is the intersection of the circle of
        radius `rod` about A with that of radius `rocker` about E. Raises ValueError if the bars cannot close.
        """
        crank, rocker = self.crank + self.crank_error, self.crank + self.rocker_error
        rod, arm = self.rod + self.rod_error, self.rod + self.arm_error
        # In a frame that turns with the lower arm: x along it, origin on axis 2.
        c, s = np.cos(theta2), np.sin(theta2)
        to_tip_x = c * self.pivot_x + s * self.pivot_y + crank * np.cos(beta) - arm
        to_tip_y = -s * self.pivot_x + c * self.pivot_y + crank * np.sin(beta)
        return beta + closing_error(to_tip_x, to_tip_y, rocker, rod, beta)

    def first_order(self) -> dict[str, float]:
        """Coefficients (rad) of the linearised error's four basis functions; th2: link angle 2, beta as commanded."""
        return {
            "1/sin(beta)": (self.arm_error - self.rod_error) / self.crank,
            "cos(beta)/sin(beta)": (self.rocker_error - self.crank_error) / self.crank,
            "cos(th2)/sin(beta)": -self.pivot_x / self.crank,
            "sin(th2)/sin(beta)": -self.pivot_y / self.crank,
        }
