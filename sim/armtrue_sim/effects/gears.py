"""Gears: eccentricity, tooth mesh, local transmission errors, lost motion, friction, coupling of wrist joints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arm import Term
from ..errors import ScenarioError
from .base import (
    ARCSEC,
    DEGREE,
    EffectContext,
    Sizes,
    driven_joints,
    effect,
    full_torque,
    hats,
    joint_pairs,
)


def _wave(
    name: str,
    context: EffectContext,
    sizes: Sizes,
    joint: int,
    angle: str,
    key: str,
    size: float,
    driving: tuple[int, ...] = (),
) -> list[Term]:
    """sin and cos of `angle` on a motor, amplitude `size` rad at a random phase; `key` names the two given values."""
    phase = sizes.rng.uniform(0.0, 2.0 * np.pi)
    amplitude = size * context.size(joint)
    parts = (("sin", amplitude * np.cos(phase)), ("cos", amplitude * np.sin(phase)))
    return [
        Term(
            name,
            (joint, *driving),
            f"motor{joint}",
            f"{part}({angle})",
            sizes.value(f"{part}{key}", drawn, joint),
            context.unit(joint),
        )
        for part, drawn in parts
    ]


@effect("gear_harmonics", driven_joints)
def gear_harmonics(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Eccentricity 10 to 60 arcsec once a turn, a fifth to a half of that twice a turn."""
    for k in joints:
        once = sizes.rng.uniform(10.0, 60.0) * ARCSEC
        twice = sizes.rng.uniform(0.2, 0.5) * once
        yield from _wave("gear_harmonics", context, sizes, k, f"q{k}", "1", once)
        yield from _wave("gear_harmonics", context, sizes, k, f"2*q{k}", "2", twice)


def mesh_orders(context: EffectContext) -> list[int]:
    """Mesh errors per motor turn of this arm's gears: one, or two where the wave generator is elliptic."""
    return [2] if context.preset.strain_wave else [1]


@effect("gear_mesh", driven_joints)
def gear_mesh(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """10 to 40 arcsec once per motor turn; strain-wave gears 20 to 60 arcsec twice per motor turn.

    For a prismatic joint: the same orders per turn of its screw or pinion, one lead of travel each. `ratio` or `lead`
    replaces robot.yaml's value, for arms whose file has a wrong one or none.
    """
    wave_gear = context.preset.strain_wave
    orders = sizes.option("orders", mesh_orders(context))
    for k in joints:
        if context.chain.prismatic[k - 1]:
            lead = sizes.value("lead", context.chain.lead[k - 1], k)
            if lead <= 0.0:
                raise ScenarioError(f"gear_mesh: joint {k} slides and has no lead")
            once = 2.0 * np.pi / lead
        else:
            once = sizes.value("ratio", context.chain.gear_ratio[k - 1], k)
        for order in orders:
            size = sizes.rng.uniform(20.0, 60.0) if wave_gear else sizes.rng.uniform(10.0, 40.0)
            angle = f"{float(order * once)!r}*q{k}"
            yield from _wave("gear_mesh", context, sizes, k, angle, f"_{order}", size * ARCSEC)


@effect("transmission_pwl", driven_joints)
def transmission_pwl(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Any other joint error, 15 to 40 arcsec.

    `shape`: waves (8 to 24 cycles a turn, as a UR10 shows), table (random nodes) or bump (one spot). `table` takes
    `spacing` in degrees (default 15; a tenth of the travel where prismatic).
    """
    shape = sizes.option("shape", "waves")
    spacing = sizes.value("spacing", 15.0)
    for k in joints:
        size = sizes.value("size", sizes.rng.uniform(15.0, 40.0) * ARCSEC, k)
        low, high = context.chain.limits[k - 1]
        prismatic = bool(context.chain.prismatic[k - 1])
        if shape == "waves":
            turn = 2.0 * np.pi / (4.0 * (high - low)) if prismatic else 1.0
            for cycles in sizes.rng.choice(np.arange(8, 25), 2, replace=False):
                angle = f"{float(cycles * turn)!r}*q{k}"
                yield from _wave(
                    "transmission_pwl", context, sizes, k, angle, f"_{cycles}", size / np.sqrt(2.0)
                )
        elif shape == "table":
            step = (high - low) / 10.0 if prismatic else spacing * DEGREE
            nodes = np.linspace(low, high, max(round((high - low) / step), 2) + 1)
            heights = sizes.rng.standard_normal(len(nodes)) * size * context.size(k)
            for text, height in zip(hats(k, nodes), heights, strict=True):
                yield Term("transmission_pwl", (k,), f"motor{k}", text, float(height), context.unit(k))
        elif shape == "bump":
            centre = sizes.value("centre", low + (high - low) * sizes.rng.uniform(0.3, 0.7), k)
            half = sizes.value("half_width", (high - low) * sizes.rng.uniform(0.06, 0.12), k)
            height = size * context.size(k) * 2.0
            text = f"hat(q{k}, {centre - half!r}, {centre!r}, {centre + half!r})"
            yield Term("transmission_pwl", (k,), f"motor{k}", text, height, context.unit(k))
        else:
            raise ScenarioError(f"transmission_pwl: shape is {shape!r}, expected waves, table or bump")


@effect("backlash", driven_joints)
def backlash(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Half the lost motion (16 to 60 arcsec in all) by direction of approach; `load`: the part that gravity closes."""
    for k in joints:
        half = sizes.rng.uniform(8.0, 30.0) * ARCSEC * context.size(k)
        # The drive stops at its target after it has pushed the link: the link lags on the side from which it came.
        value = sizes.value("value", -half, k)
        yield Term("backlash", (k,), f"motor{k}", f"dir{k}", value, context.unit(k))
        load = sizes.value("load", 0.0, k)
        if load:
            yield Term("backlash", (k,), f"motor{k}", f"sign(load{k})", load, context.unit(k))


@effect("hysteresis", driven_joints)
def hysteresis(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Friction winds the gear up by 6 to 20 arcsec against the motion, and by 0.5 to 1 of that again at full load.

    After a reversal the wind-up changes sign over `theta0`, 0.5 to 3 degrees of travel.
    """
    for k in joints:
        size = sizes.rng.uniform(6.0, 20.0) * ARCSEC * context.size(k)
        loaded = size * sizes.rng.uniform(0.5, 1.0) / full_torque(context, k)
        theta0 = sizes.value("theta0", sizes.rng.uniform(0.5, 3.0) * DEGREE * context.size(k), k)
        for key, drawn, text in (
            ("travel", -size, f"dir{k}*(1 - 2*exp(-travel{k}/{theta0!r}))"),
            ("load", -loaded, f"dir{k}*abs(load{k})"),
        ):
            unit = context.unit(k) if key == "travel" else f"{context.unit(k)}/Nm"
            yield Term("hysteresis", (k,), f"motor{k}", text, sizes.value(key, drawn, k), unit)


@effect("joint_coupling", lambda context: [joint for pair in context.preset.wrist_pairs for joint in pair])
def joint_coupling(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Wrist gears that turn each other: 10 to 40 arcsec per radian. joints: [driven, driving], pair after pair."""
    for driven, driving in joint_pairs("joint_coupling", joints):
        value = sizes.value("value", sizes.signed(10.0, 40.0) * ARCSEC)
        yield Term("joint_coupling", (driven, driving), f"motor{driven}", f"q{driving}", value, "1")


def _seen_by(context: EffectContext, driven: int, driving: int) -> str:
    """The driving joint's angle; for the bars of a passive joint, the angle of their link relative to their base."""
    turns = context.chain.coupling[driven - 1]
    before = [k for k in range(1, driving) if context.chain.passive[driven - 1] and turns[k - 1] != 0.0]
    names = [f"q{k}" for k in (*before, driving)]
    return names[0] if len(names) == 1 else f"({' + '.join(names)})"


@effect(
    "coupling_harmonics", lambda context: [joint for pair in context.preset.wrist_pairs for joint in pair]
)
def coupling_harmonics(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Hollow wrists: eccentric gears of one joint turn another, 10 to 40 arcsec once a turn and less twice a turn."""
    for driven, driving in joint_pairs("coupling_harmonics", joints):
        once = sizes.rng.uniform(10.0, 40.0) * ARCSEC
        twice = sizes.rng.uniform(0.2, 0.5) * once
        for n, size in ((1, once), (2, twice)):
            turned = _seen_by(context, driven, driving)
            angle = turned if n == 1 else f"{n}*{turned}"
            yield from _wave("coupling_harmonics", context, sizes, driven, angle, str(n), size, (driving,))
