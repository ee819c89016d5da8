"""Angles of a tracker whose circles are graduated unevenly: three harmonics of azimuth and of elevation.

The catalogue's `tracker_angles` has only the first, which is an eccentric circle. The second and the third are an oval
circle and a wrong reading of one of three heads.
"""

from __future__ import annotations

from ..effects.base import ARCSEC, EffectContext, EffectTruth, Sizes, effect, no_joint
from ..tracker import CIRCLES, TrackerError


@effect("tracker_circles", no_joint)
def tracker_circles(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """4 to 12 arcsec once a turn, half and a third of that at twice and three times."""
    circles = {
        (harmonic, name): sizes.signed(4.0, 12.0) * ARCSEC / harmonic
        for harmonic in (1, 2, 3)
        for name in CIRCLES
    }
    return EffectTruth(tracker=TrackerError(circles=circles))


def causes(joint: int) -> frozenset[str]:
    """Right answers; `joint` is not used."""
    return frozenset({"tracker_angles"})


def variables(joint: int) -> frozenset[str]:
    """Variables that the error depends on: where the tool is seen, or joint 1, which moves it around."""
    return frozenset({"azimuth", "elevation", "distance", "x", "y", "z", "q1"})


def choices(arm: str) -> list[list[int]]:
    """No joints: the error is the instrument's."""
    return [[]]
