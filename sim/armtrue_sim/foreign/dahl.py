"""Friction with presliding (Dahl, "A solid friction model", 1968, exponent 2): friction winds the gear up.

The friction f, from -1 to 1 of its full value, follows the path x: df/dx = s (1 - f s)^2 / x0, s the sign of motion.
After a reversal it changes sign along a hyperbola, with a long tail; the catalogue's hysteresis is exponential.
"""

from __future__ import annotations

from ..arm import Term
from ..effects.base import ARCSEC, DEGREE, EffectContext, EffectTruth, Sizes, effect, full_torque
from ..history import History

# Friction depends on the path to a pose, so directions follow from the order of the poses.
PLAN = {"directions": "order"}


def friction(joint: int, x0: float) -> History:
    """Dahl's state of a joint; x0 in rad (m): travel from zero to half of full friction."""

    def advance(f: float, motion: float, seconds: float) -> float:
        if motion == 0.0:
            return f
        side = 1.0 if motion > 0.0 else -1.0
        missing = 1.0 - side * f
        return side * (1.0 - missing / (1.0 + missing * abs(motion) / x0))

    return History(f"_dahl{joint}", joint, 0.0, advance)


@effect("dahl_friction", lambda context: [2])
def dahl_friction(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Full friction winds up 12 to 35 arcsec, and up to twice that at full load; `x0` 0.2 to 1.5 degrees."""
    terms, histories = [], []
    for k in joints:
        x0 = sizes.value("x0", sizes.rng.uniform(0.2, 1.5) * DEGREE * context.size(k), k)
        histories.append(friction(k, x0))
        value = sizes.value("value", -sizes.rng.uniform(12.0, 35.0) * ARCSEC * context.size(k), k)
        grows = sizes.rng.uniform(0.3, 1.0) / full_torque(context, k)
        text = f"_dahl{k}*(1 + {grows!r}*abs(load{k}))"
        terms.append(Term("dahl_friction", (k,), f"motor{k}", text, value, context.unit(k)))
    return EffectTruth(terms, histories=histories)


def causes(joint: int) -> frozenset[str]:
    """Right answers."""
    return frozenset({f"hysteresis {joint}", f"backlash {joint}"})


def variables(joint: int) -> frozenset[str]:
    """State variables that the error depends on."""
    return frozenset({f"dir{joint}", f"travel{joint}"})


def choices(arm: str) -> list[list[int]]:
    """Joints that it may act on."""
    return [[1], [2], [3]]
