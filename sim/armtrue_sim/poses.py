"""Random poses that a real arm could take."""

from __future__ import annotations

from typing import Any

import numpy as np

from .mechanics.chain import Chain
from .mechanics.transforms import Array

# Smallest angle of a parallelogram's crank and lower arm from a straight line: the arm's own stops are there.
LINKAGE_MARGIN = np.radians(35.0)


def admissible(robot: dict[str, Any], chain: Chain, q: Array, floor: float | None = None) -> Array:
    """True (N,) where q (N, n) keeps limits and linkage stops, and the flange above `floor` m in the base frame."""
    inside: Array = np.all((q >= chain.limits[:, 0]) & (q <= chain.limits[:, 1]), axis=1)
    linkage = robot.get("linkage")
    if linkage:
        beta = linkage["angle"] + q[:, 2] - q[:, 1]
        inside &= (beta > LINKAGE_MARGIN) & (beta < np.pi - LINKAGE_MARGIN)
    for k in np.flatnonzero(chain.passive):
        low, high = robot["kinematics"]["joints"][k].get("limits", [-np.inf, np.inf])
        turned = q @ chain.coupling[k]
        inside &= (turned >= low) & (turned <= high)
    if floor is not None:
        inside &= chain.frames(chain.link_variables(q)).flange_origin[:, 2] > floor
    return inside


def random_poses(
    robot: dict[str, Any],
    chain: Chain,
    count: int,
    rng: np.random.Generator,
    floor: float | None = None,
    joint_range: Array | None = None,
) -> Array:
    """`count` joint vectors (count, n), uniform over the admissible joint space, to the 10 decimals of a data file.

    joint_range (n, 2) narrows the limits. Raises ValueError where nearly no pose is admissible.
    """
    low, high = (chain.limits if joint_range is None else joint_range).T
    found: list[Array] = []
    total = 0
    while total < count:
        # Rounding must not carry a pose over its limit.
        q = np.round(
            rng.uniform(low + 1e-10, np.maximum(high - 1e-10, low + 1e-10), (2 * count + 16, chain.n)), 10
        )
        q[:, chain.passive] = 0.0
        q = q[admissible(robot, chain, q, floor)]
        found.append(q)
        total += len(q)
        if len(found) > 200:
            raise ValueError(
                f"hardly any pose of '{robot.get('name')}' is within limits, stops and the floor {floor}"
            )
    return np.concatenate(found)[:count] if found else np.empty((0, chain.n))
