"""A random error field over the first joints without a formula: the error for the last level of a ladder."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from ..arm import Term
from ..errors import ScenarioError
from .base import EffectContext, Sizes, effect, hats, no_joint


@effect("residual_grid", no_joint)
def residual_grid(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Everything beyond joint 1 shifts by a multilinear field over joints 1 to 3, in frame 1; nodes 20 to 60 um.

    `nodes`: how many over joints 1, 2, 3 (default 4 each), evenly over the limits; `size`: one sigma of a node, metres.
    """
    axes = min(3, context.chain.n)
    counts = sizes.option("nodes", [4] * axes)
    if (
        not isinstance(counts, list)
        or len(counts) != axes
        or not all(isinstance(c, int) and c > 1 for c in counts)
    ):
        raise ScenarioError(
            f"residual_grid: nodes is {counts!r}, expected {axes} whole numbers of at least 2"
        )
    size = sizes.value("size", sizes.rng.uniform(2e-5, 6e-5))
    along = [
        hats(k, np.linspace(*context.chain.limits[k - 1], count)) for k, count in enumerate(counts, start=1)
    ]
    heights = size * sizes.rng.standard_normal((*counts, 3))
    for index, corner in zip(product(*map(range, counts)), product(*along), strict=True):
        for axis, height in zip("xyz", heights[index], strict=True):
            yield Term("residual_grid", (), f"link1.t{axis}", "*".join(corner), float(height), "m")
