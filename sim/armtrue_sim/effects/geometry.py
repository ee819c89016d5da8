"""Geometry: encoder zeros, scales, links, the four-bar linkage."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arm import Term
from ..errors import ScenarioError
from ..mechanics.fourbar import FourBar
from .base import (
    DEGREE,
    EffectContext,
    EffectTruth,
    Sizes,
    driven_joints,
    effect,
    every_joint,
    hats,
    no_joint,
)


@effect("base_frame", no_joint)
def base_frame(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Has no terms: the arm itself holds the real pose of the base, as the scenario sets it."""
    return EffectTruth()


@effect("tool_offset", no_joint)
def tool_offset(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Has no terms: the arm itself holds the real poses of the reflectors, as the scenario sets them."""
    return EffectTruth()


@effect("joint_offset", every_joint)
def joint_offset(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Encoder zeros: 0.01 to 0.15 degrees."""
    for k in joints:
        drawn = sizes.signed(0.01, 0.15) * DEGREE * context.size(k)
        yield Term("joint_offset", (k,), f"motor{k}", "1", sizes.value("value", drawn, k), context.unit(k))


@effect("joint_scale", driven_joints)
def joint_scale(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Gear ratio or scale wrong by 40 to 200 ppm."""
    for k in joints:
        drawn = sizes.signed(4e-5, 2e-4)
        yield Term("joint_scale", (k,), f"motor{k}", f"q{k}", sizes.value("value", drawn, k), "1")


@effect("link_geometry", every_joint)
def link_geometry(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Lengths 0.3 mm and angles 0.02 degrees (one sigma), up to 1.5 mm and 0.1 degrees."""
    for k in joints:
        draws = sizes.rng.standard_normal(5).clip(-5.0, 5.0)
        for c, draw in zip(("tx", "ty", "tz", "rx", "ry"), draws, strict=True):
            linear = c.startswith("t")
            value = sizes.value(c, draw * (3e-4 if linear else 0.02 * DEGREE), k)
            yield Term("link_geometry", (k,), f"link{k}.{c}", "1", value, "m" if linear else "rad")


@effect("parallelogram", lambda context: [2, 3])
def parallelogram(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Bars 0.05 to 0.2 mm wrong, crank pivot up to 0.1 mm off axis 2; closed exactly (mechanics.fourbar)."""
    if joints != [2, 3]:
        raise ScenarioError(f"parallelogram: joints {joints}, expected [2, 3]")
    linkage = context.robot.get("linkage")
    if not linkage or linkage.get("type") != "parallelogram" or list(linkage.get("joints", [])) != [2, 3]:
        raise ScenarioError(
            "parallelogram: the robot has no `linkage` of type parallelogram on joints [2, 3]"
        )
    errors = {
        name: sizes.value(name, sizes.signed(5e-5, 2e-4))
        for name in ("crank_error", "rod_error", "rocker_error", "arm_error")
    }
    pivots = {name: sizes.value(name, sizes.rng.uniform(-1e-4, 1e-4)) for name in ("pivot_x", "pivot_y")}
    return EffectTruth(
        linkage=FourBar(linkage["crank"], linkage["rod"], linkage["angle"], **errors, **pivots)
    )


@effect("axis_wobble", every_joint)
def axis_wobble(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Bearing runout: 4 to 15 arcsec of tilt and 3 to 10 um of shift once a turn, half of that twice a turn."""
    for k in joints:
        for c in ("rx", "ry", "tx", "ty"):
            linear = c[0] == "t"
            size = sizes.rng.uniform(3e-6, 1e-5) if linear else sizes.rng.uniform(4.0, 15.0) * DEGREE / 3600.0
            for n in (1, 2):
                phase = sizes.rng.uniform(0.0, 2.0 * np.pi)
                for wave, part in (("sin", np.cos(phase)), ("cos", np.sin(phase))):
                    value = sizes.value(f"{c}_{wave}{n}", size / n * part, k)
                    text = f"{wave}(th{k})" if n == 1 else f"{wave}({n}*th{k})"
                    unit = "m" if linear else "rad"
                    yield Term("axis_wobble", (k,), f"link{k}.{c}", text, value, unit)


@effect("axis_straightness", lambda context: [int(k) + 1 for k in np.flatnonzero(context.chain.prismatic)])
def axis_straightness(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """A rail bows by 20 to 60 um sideways and pitches, yaws and rolls by 10 to 30 arcsec over its travel.

    Sideways is tx and ty: the joint's own z runs along the rail, and tz would be its position error.
    """
    for k in joints:
        if not context.chain.prismatic[k - 1]:
            raise ScenarioError(f"axis_straightness: joint {k} turns, expected one that slides")
        low, high = context.chain.limits[k - 1]
        shapes = hats(k, np.linspace(low, high, 6))
        for c in ("tx", "ty", "rx", "ry", "rz"):
            size = (
                sizes.rng.uniform(2e-5, 6e-5)
                if c[0] == "t"
                else sizes.rng.uniform(10.0, 30.0) * DEGREE / 3600.0
            )
            unit = "m" if c[0] == "t" else "rad"
            heights = size * sizes.rng.standard_normal(len(shapes))
            for text, height in zip(shapes, heights, strict=True):
                yield Term("axis_straightness", (k,), f"link{k}.{c}", text, float(height), unit)
