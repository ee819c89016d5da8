"""Tooth errors as gear testers record them: a sum of twenty waves that no two or three orders explain.

Single-flank deviations of reducers contain the order of the output's turn with its multiples, that of the tooth mesh,
and sidebands of the mesh; amplitudes fall with the order and the phases are random (sizes: our judgement).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arm import Term
from ..effects.base import ARCSEC, EffectContext, Sizes, effect

WAVES = 20
# Pitch errors of the output gear fall off with the order; its teeth, a few dozen, stand out with their sidebands.
SLOPE = 0.8


@effect("tooth_waves", lambda context: [2])
def tooth_waves(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Twelve orders of the output's turn, a mesh of `teeth` (31 to 61) with sidebands; `size` 12 to 30 arcsec rms."""
    for k in joints:
        teeth = int(sizes.value("teeth", float(sizes.rng.integers(31, 62)), k))
        orders = np.array([*range(1, 13), *(teeth + side for side in (-3, -2, -1, 0, 1, 2, 3)), 2 * teeth])
        size = sizes.value("size", sizes.rng.uniform(12.0, 30.0) * ARCSEC * context.size(k), k)
        heights = np.where(orders < 13, orders**-SLOPE, 0.35 / (1.0 + np.abs(orders - teeth)))
        heights[-1] = 0.15
        heights *= sizes.rng.uniform(0.5, 1.5, WAVES)
        heights *= size * np.sqrt(2.0) / np.linalg.norm(heights)
        low, high = context.chain.limits[k - 1]
        turn = 2.0 * np.pi / (high - low) if context.chain.prismatic[k - 1] else 1.0
        for order, height in zip(orders, heights, strict=True):
            phase = float(sizes.rng.uniform(0.0, 2.0 * np.pi))
            text = f"sin({float(order * turn)!r}*q{k} + {phase!r})"
            yield Term("tooth_waves", (k,), f"motor{k}", text, float(height), context.unit(k))


def causes(joint: int) -> frozenset[str]:
    """Right answers."""
    return frozenset(f"{name} {joint}" for name in ("gear_harmonics", "gear_mesh", "transmission_pwl"))


def variables(joint: int) -> frozenset[str]:
    """State variables that the error depends on."""
    return frozenset({f"q{joint}", f"th{joint}"})


def choices(arm: str) -> list[list[int]]:
    """Joints that it may act on."""
    return [[1], [2], [3], [4]]
