"""Bars that keep a palletiser's flange level, closed exactly for wrong lengths and pivots.

Beside each long link runs a bar of the same length. A bar and its link are held apart by two short arms: one on the
part before the link (the base, or the triangle at its joint), one on the part behind it (the next triangle, or the
flange). With the link's angle a in the plane and the first arm's angle b, all about parallel axes,

    |L u(a) + r u(f) - p u(b)| = B

gives the second arm's angle f: equal to b for r = p and B = L. The angle by which the first row of bars turns its
triangle is the input of the second row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm import Arm, State
from ..effects.base import EffectContext, EffectTruth, Sizes, effect
from ..mechanics.chain import Frames
from ..mechanics.fourbar import closing_error
from ..mechanics.transforms import Array


@dataclass(frozen=True)
class Bars:
    """One row of bars: link of length `link`, short arms of length `arm` at angle `stands` to the level, metres, rad.

    bar_error: bar less link; arm_error: second short arm less first; stands_error: second arm's angle less the first's.
    """

    link: float
    arm: float
    stands: float
    bar_error: float = 0.0
    arm_error: float = 0.0
    stands_error: float = 0.0

    def scaled(self, factor: float) -> Bars:
        """The same bars with every error `factor` times as large."""
        errors = ("bar_error", "arm_error", "stands_error")
        return replace(self, **{name: factor * getattr(self, name) for name in errors})

    def tilt(self, attitude: Array, before: Array) -> Array:
        """Angle out of level (N,) of the part behind the link, if the part before it is out by `before` (N,)."""
        first = before + self.stands
        # From the pivot of the second short arm's axis to the bar's end on the first.
        x = self.arm * np.cos(first) - self.link * np.cos(attitude)
        y = self.arm * np.sin(first) - self.link * np.sin(attitude)
        turned = closing_error(x, y, self.arm + self.arm_error, self.link + self.bar_error, first)
        return turned + before - self.stands_error


@dataclass(frozen=True)
class LevellingBars:
    """Rows of bars along `links` (from 0), whose last keeps the passive link `level` (from 0) level."""

    rows: tuple[Bars, ...]
    links: tuple[int, ...]
    level: int

    def scaled(self, factor: float) -> LevellingBars:
        """The same with every error `factor` times as large."""
        return replace(self, rows=tuple(row.scaled(factor) for row in self.rows))

    def coordinates(self, arm: Arm, state: State, frames: Frames) -> dict[int, Array]:
        """Rotation of the level link about its joint by the errors of the bars."""
        count = len(state.q)
        attitude, tilt = np.zeros(count), np.zeros(count)
        for row, link in zip(self.rows, self.links, strict=True):
            attitude = attitude + state[f"th{link + 1}"]
            tilt = row.tilt(attitude, tilt)
        turn = np.zeros((count, 6))
        turn[:, 5] = tilt
        return {self.level: turn}


@effect("levelling_bars", lambda context: [int(k) + 1 for k in np.flatnonzero(context.chain.passive)][:1])
def levelling_bars(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Bars wrong by 0.1 to 0.4 mm; short arms of 0.35 m wrong by 0.1 to 0.3 mm and 0.05 to 0.2 mrad.

    At joint 3 the triangle's second short arm is perpendicular to the forearm in mid-range, as its first is to the arm.
    """
    (level,) = joints
    links = tuple(range(1, level - 1))
    lengths = [float(np.linalg.norm(context.chain.link_lengths[k])) for k in links]
    # Each short arm is perpendicular to its link when the link is in the middle of its range.
    stands = (0.0, -0.5 * np.pi)
    rows = tuple(
        Bars(
            length,
            0.35,
            angle,
            sizes.value(f"bar_{number}", sizes.signed(1e-4, 4e-4)),
            sizes.value(f"arm_{number}", sizes.signed(1e-4, 3e-4)),
            sizes.value(f"stands_{number}", sizes.signed(5e-5, 2e-4)),
        )
        for number, (length, angle) in enumerate(zip(lengths, stands, strict=True), start=1)
    )
    return EffectTruth(physics=[LevellingBars(rows, links, level - 1)])
