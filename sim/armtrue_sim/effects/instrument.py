"""The instrument's own errors: they belong to the measurement, are fitted and never exported."""

from __future__ import annotations

from ..mechanics.transforms import Pose
from ..tracker import CIRCLES, TrackerError
from .base import ARCSEC, EffectContext, EffectTruth, Sizes, effect, no_joint

SETUPS = 3  # most set-ups or nests of a scenario; numbers that no row has are not used


@effect("tracker_scale", no_joint)
def tracker_scale(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """A weather station that is 30 to 80 hPa or kelvin off: 20 to 60 ppm of distance."""
    return EffectTruth(tracker=TrackerError(scale=sizes.value("value", sizes.signed(2e-5, 6e-5))))


@effect("tracker_angles", no_joint)
def tracker_angles(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Circles that are eccentric to their axes: 3 to 10 arcsec once a turn of azimuth and of elevation."""
    drawn = {name: sizes.value(name, sizes.signed(3.0, 10.0) * ARCSEC) for name in CIRCLES}
    return EffectTruth(tracker=TrackerError(circles={(1, name): value for name, value in drawn.items()}))


@effect("station", no_joint)
def station(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Errors of 30 to 100 um and 10 to 40 urad by which set-ups after the first, tied to it by nests, are off."""
    stations = {}
    for number in range(2, SETUPS + 1):
        shifts = [sizes.signed(3e-5, 1e-4) for _ in range(3)] + [sizes.signed(1e-5, 4e-5) for _ in range(3)]
        stations[number] = Pose.from_vector(shifts)
    return EffectTruth(tracker=TrackerError(stations=stations))


@effect("nest", no_joint)
def nest(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """A reflector that was taken out sits 15 to 40 um elsewhere when it is put back."""
    nests = {}
    for number in range(2, SETUPS + 1):
        way = sizes.rng.standard_normal(3)
        nests[number] = sizes.rng.uniform(1.5e-5, 4e-5) * way / float((way @ way) ** 0.5)
    return EffectTruth(tracker=TrackerError(nests=nests))
