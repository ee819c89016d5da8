"""Heat: expansion of links, drift of zeros, deformation of the stand, a warm-up that no thermometer shows."""

from __future__ import annotations

from collections.abc import Iterator

from ..arm import Term
from ..errors import ScenarioError
from ..history import warmth
from .base import ARCSEC, EffectContext, EffectTruth, Sizes, driven_joints, effect, every_joint, no_joint

STEEL, ALUMINIUM = 11.7e-6, 23.6e-6


def link_lengths(context: EffectContext, joint: int) -> Iterator[tuple[str, float]]:
    """(coordinate, metres) of the lengths that expand with joint `joint` (from 1).

    That is the link after it, up to the next joint or the flange, in its own frame; with joint 1 also the column before
    it, in the base frame. Over all joints every length of robot.yaml comes once (decision 0020).
    """
    chain = context.chain
    parts = [("base", chain.fixed[0].translation)] if joint == 1 else []
    parts.append((f"link{joint}", chain.link_lengths[joint - 1]))
    for frame, lengths in parts:
        for axis, length in zip(("tx", "ty", "tz"), lengths, strict=True):
            if abs(length) > 1e-9:
                yield f"{frame}.{axis}", float(length)


def link_growth(name: str, context: EffectContext, joint: int, warmth: str, growth: float) -> list[Term]:
    """Terms of effect `name`: the link after `joint` (from 1) expands by `growth` times the variable `warmth`."""
    return [
        Term(name, (joint,), coordinate, f"{length!r}*{warmth}", growth, "1")
        for coordinate, length in link_lengths(context, joint)
        if coordinate.startswith("link")
    ]


@effect("thermal_expansion", every_joint)
def thermal_expansion(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """One coefficient of expansion for the named links, between steel and aluminium."""
    temperature = context.sensor_variable(sizes.option("sensor", None))
    alpha = sizes.value("value", sizes.rng.uniform(STEEL, ALUMINIUM))
    for k in joints:
        for coordinate, length in link_lengths(context, k):
            yield Term(
                "thermal_expansion", tuple(joints), coordinate, f"{length!r}*{temperature}", alpha, "1/K"
            )


@effect("thermal_joint_drift", every_joint)
def thermal_joint_drift(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Zeros that move by 0.5 to 2 arcsec a kelvin."""
    temperature = context.sensor_variable(sizes.option("sensor", None))
    for k in joints:
        value = sizes.value("value", sizes.signed(2.5e-6, 1e-5) * context.size(k), k)
        unit = f"{context.unit(k)}/K"
        yield Term("thermal_joint_drift", (k,), f"motor{k}", temperature, value, unit)


@effect("thermal_base", no_joint)
def thermal_base(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """A stand of a metre grows 5 to 12 um/K and leans 1 to 4 urad/K because one side is warmer."""
    temperature = context.sensor_variable(sizes.option("sensor", None))
    drawn = {
        "tx": sizes.signed(1e-6, 5e-6),
        "ty": sizes.signed(1e-6, 5e-6),
        "tz": sizes.rng.uniform(5e-6, 1.2e-5),
        "rx": sizes.signed(1e-6, 4e-6),
        "ry": sizes.signed(1e-6, 4e-6),
        "rz": sizes.signed(5e-7, 2e-6),
    }
    for c, v in drawn.items():
        unit = "m/K" if c[0] == "t" else "rad/K"
        yield Term("thermal_base", (), f"base.{c}", temperature, sizes.value(c, v), unit)


@effect("warm_up", no_joint)
def warm_up(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """120 to 340 ppm of every length and up to 15 arcsec on every zero, with one time constant `tau` in seconds."""
    tau = sizes.value("tau", sizes.rng.uniform(1200.0, 3600.0))
    warmth = f"1 - exp(-time/{tau!r})"
    growth = sizes.value("growth", sizes.rng.uniform(1.2e-4, 3.4e-4))
    every = every_joint(context)
    for k in every:
        for coordinate, length in link_lengths(context, k):
            yield Term("warm_up", (), coordinate, f"{length!r}*({warmth})", growth, "1")
    for k in every:
        value = sizes.value(f"motor{k}", sizes.signed(1.5e-5, 7e-5) * context.size(k))
        yield Term("warm_up", (), f"motor{k}", warmth, value, context.unit(k))


@effect("thermal_gradient", lambda context: [2])
def thermal_gradient(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """One side of a link is warmer: it bends by 15 to 50 urad/K between two `sensors` (default the last two)."""
    names = context.robot.get("temperature", {}).get("sensors", [])
    pair = sizes.option("sensors", names[-2:])
    if not isinstance(pair, list) or len(pair) != 2:
        raise ScenarioError(f"thermal_gradient: sensors is {pair!r}, expected two of {names}")
    between = " - ".join(context.sensor_variable(str(name)) for name in pair)
    for k in joints:
        for c in ("rx", "ry"):
            value = sizes.value(c, sizes.signed(1.5e-5, 5e-5), k)
            yield Term("thermal_gradient", (k,), f"link{k}.{c}", between, value, "rad/K")


# Full duty: the mean speed of a joint between two random poses that are `interval` apart, rad/s.
FULL_SPEED = 0.04


@effect("self_heating", driven_joints)
def self_heating(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """A gear warms by its own duty: zero 6 to 20 arcsec, its link 30 to 100 ppm, `tau` 600 to 3000 s."""
    terms, histories = [], []
    for k in joints:
        tau = sizes.value("tau", sizes.rng.uniform(600.0, 3000.0), k)
        histories.append(warmth(k, tau, FULL_SPEED * context.size(k)))
        value = sizes.value("value", sizes.signed(6.0, 20.0) * ARCSEC * context.size(k), k)
        terms.append(Term("self_heating", (k,), f"motor{k}", f"_warm{k}", value, context.unit(k)))
        growth = sizes.value("growth", sizes.rng.uniform(3e-5, 1e-4), k)
        terms += link_growth("self_heating", context, k, f"_warm{k}", growth)
    return EffectTruth(terms, histories=histories)
