"""Every gear warms by its own duty, its housing later: the zero follows the gear, the link's length the housing.

No sensor measures either, each joint has its own time constants, and the arm cools in the session's rests: neither one
time constant nor one warm-up of the whole arm fits.
"""

from __future__ import annotations

from ..arm import Term
from ..effects.base import ARCSEC, EffectContext, EffectTruth, Sizes, effect, every_joint
from ..effects.thermal import FULL_SPEED, link_growth
from ..history import warmth

PLAN = {"rests": {"count": 2, "seconds": 3000.0}}


@effect("duty_heat", every_joint)
def duty_heat(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Zeros move by 5 to 15 arcsec, links grow by 60 to 150 ppm; time constants 300 to 1500 s and 1500 to 6000 s."""
    terms, histories = [], []
    for k in joints:
        full = FULL_SPEED * context.size(k)
        histories.append(
            warmth(k, sizes.value("gear_tau", sizes.rng.uniform(300.0, 1500.0), k), full, "_gear")
        )
        housing = sizes.value("housing_tau", sizes.rng.uniform(1500.0, 6000.0), k)
        histories.append(warmth(k, housing, full, "_housing"))
        value = sizes.value("value", sizes.signed(5.0, 15.0) * ARCSEC * context.size(k), k)
        terms.append(Term("duty_heat", (k,), f"motor{k}", f"_gear{k}", value, context.unit(k)))
        growth = sizes.value("growth", sizes.rng.uniform(6e-5, 1.5e-4), k)
        terms += link_growth("duty_heat", context, k, f"_housing{k}", growth)
    return EffectTruth(terms, histories=histories)


def causes(joint: int) -> frozenset[str]:
    """Right answers; `joint` is not used: every joint warms."""
    return frozenset({"warm_up", *(f"self_heating {k}" for k in range(1, 9))})


def variables(joint: int) -> frozenset[str]:
    """State variables that the error depends on."""
    return frozenset({"time", *(f"duty{k}" for k in range(1, 9))})


def choices(arm: str) -> list[list[int]]:
    """All joints at once."""
    return [[]]
