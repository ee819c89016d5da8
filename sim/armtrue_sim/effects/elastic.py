"""Effects of gravity: torsion of axes, bending, tilt of the foundation, the balancer of axis 2."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arm import Term
from ..errors import ScenarioError
from ..mechanics.statics import BodyError
from .base import (
    EffectContext,
    EffectTruth,
    Sizes,
    compliant_joints,
    effect,
    every_joint,
    full_torque,
    joint_pairs,
    no_joint,
)


def drawn_torsion(context: EffectContext, sizes: Sizes, joint: int) -> float:
    """A random torsional compliance for an axis of this arm, rad/Nm (m/N where prismatic), joint from 1."""
    return float(sizes.rng.uniform(*context.preset.torsion[joint - 1]))


@effect("joint_compliance", compliant_joints)
def joint_compliance(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """A one-dimensional spring per axis; it yields to the load (docs/model.md, Sign)."""
    for k in joints:
        value = sizes.value("value", drawn_torsion(context, sizes, k), k)
        unit = "m/N" if context.chain.prismatic[k - 1] else "rad/Nm"
        yield Term("joint_compliance", (k,), f"motor{k}", f"tau{k}", value, unit)


@effect("stiffness_nonlinear", compliant_joints)
def stiffness_nonlinear(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Hardening: at full gravity torque the spring yields 20 to 50 % less than with its compliance at zero torque.

    `soft`: additional yielding of a gear around zero torque, in rad, as tanh(load / `soft_torque`); none if not given.
    """
    for k in joints:
        torsion = drawn_torsion(context, sizes, k)
        full = full_torque(context, k)
        square = -sizes.rng.uniform(0.2, 0.4) * torsion / full
        cube = -sizes.rng.uniform(0.0, 0.1) * torsion / full**2
        coordinate = f"motor{k}"
        value = sizes.value("square", square, k)
        yield Term("stiffness_nonlinear", (k,), coordinate, f"load{k}*abs(load{k})", value, "rad/Nm^2")
        value = sizes.value("cube", cube, k)
        yield Term("stiffness_nonlinear", (k,), coordinate, f"load{k}^3", value, "rad/Nm^3")
        soft = sizes.value("soft", 0.0, k)
        turn = sizes.value("soft_torque", 0.05 * full, k)
        if soft:
            yield Term("stiffness_nonlinear", (k,), coordinate, f"tanh(load{k}/{turn!r})", soft, "rad")


@effect("bending_compliance", every_joint)
def bending_compliance(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Bending of links and bearings: moment x turns rx, moment y turns ry, each with its own compliance."""
    for k in joints:
        # Links that carry less are less stiff: bending grows towards the wrist as the square root of torsion.
        grow = float(np.sqrt(np.mean(context.preset.torsion[k - 1]) / np.mean(context.preset.torsion[0])))
        for axis in ("x", "y"):
            value = sizes.value(f"c{axis}", sizes.rng.uniform(*context.preset.bending) * grow, k)
            yield Term("bending_compliance", (k,), f"link{k}.r{axis}", f"gm{axis}{k}", value, "rad/Nm")


@effect("base_compliance", no_joint)
def base_compliance(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """The foundation tilts under the arm's overhang."""
    for axis in ("x", "y"):
        value = sizes.value(f"c{axis}", sizes.rng.uniform(*context.preset.base_tilt))
        yield Term("base_compliance", (), f"base.r{axis}", f"bm{axis}", value, "rad/Nm")


@effect("gravity_balancer", lambda context: [2])
def gravity_balancer(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """A tension spring from a fixed anchor to link 2 that pulls it upright; its torque twists axis 2's gear.

    Anchor at `anchor` metres from the axis in the direction where the link stands at q2 = `upright`; hook at `hook`
    metres on the link. Length L = sqrt(anchor^2 + hook^2 - 2 anchor hook cos(psi)), psi = q2 - upright; force
    stiffness x (L - free_length); torque about axis 2 by virtual work: -force dL/dpsi.
    """
    if joints != [2]:
        raise ScenarioError(f"gravity_balancer: joints {joints}, expected [2]")
    rng = sizes.rng
    anchor = sizes.value("anchor", rng.uniform(0.12, 0.18))
    hook = sizes.value("hook", rng.uniform(0.45, 0.6))
    upright = sizes.value("upright", rng.uniform(-0.15, 0.15))
    free_length = sizes.value("free_length", rng.uniform(0.65, 0.85) * (hook - anchor))
    stiffness = sizes.value(
        "stiffness", rng.uniform(0.3, 0.5) * full_torque(context, 2) / (anchor * hook * 0.5)
    )
    compliance = sizes.value("compliance", drawn_torsion(context, sizes, 2))
    length = f"sqrt({anchor**2 + hook**2!r} - {2.0 * anchor * hook!r}*cos(q2 - {upright!r}))"
    torque = f"-{stiffness * anchor * hook!r}*sin(q2 - {upright!r})*(1 - {free_length!r}/{length})"
    yield Term("gravity_balancer", (2,), "motor2", torque, compliance, "rad/Nm")


@effect("balancer_state", lambda context: [2])
def balancer_state(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """A gas balancer's pressure follows its temperature (0.6 to 1.2 times 1/293 per kelvin); seal friction is 2 to 6 %.

    Both are fractions of the torque of the scenario's `gravity_balancer`; they twist axis 2's gear.
    """
    if joints != [2]:
        raise ScenarioError(f"balancer_state: joints {joints}, expected [2]")
    temperature = context.sensor_variable(sizes.option("sensor", None))
    torsion = sizes.value("compliance", drawn_torsion(context, sizes, 2))
    pressure = sizes.value("pressure", sizes.rng.uniform(0.6, 1.2) / 293.0)
    friction = sizes.value("friction", -sizes.rng.uniform(0.02, 0.06))
    yield Term("balancer_state", (2,), "motor2", f"balancer2*{temperature}", pressure * torsion, "rad/Nm/K")
    # Friction opposes the motion, whatever the sign of the spring's torque.
    yield Term("balancer_state", (2,), "motor2", "abs(balancer2)*dir2", friction * torsion, "rad/Nm")


@effect("cross_compliance", lambda context: context.parallel_pairs()[0])
def cross_compliance(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """A link between parallel axes bends: each axis's torque turns the other, by 0.2 to 0.5 of the smaller torsion."""
    for deflected, loaded in joint_pairs("cross_compliance", joints):
        pair = (deflected, loaded)
        drawn = sizes.rng.uniform(0.2, 0.5) * min(drawn_torsion(context, sizes, k) for k in pair)
        value = sizes.value("value", drawn)
        # Symmetric by the reciprocal theorem of Maxwell and Betti.
        for k, other in (pair, pair[::-1]):
            yield Term("cross_compliance", pair, f"motor{k}", f"tau{other}", value, "rad/Nm")


@effect("mass_parameters", no_joint)
def mass_parameters(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Every link's mass is wrong by +-`mass` (0.2) of itself; every centre and the payload's by `centre` (15 mm)."""
    mass, centre = sizes.value("mass", 0.2), sizes.value("centre", 0.015)
    links = context.chain.links
    signs = sizes.rng.choice([-1.0, 1.0], len(links))
    ways = sizes.rng.standard_normal((len(links) + 1, 3))
    shifts = centre * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return EffectTruth(
        body=BodyError(
            {k: float(mass * signs[k] * link.mass) for k, link in enumerate(links)},
            {k: shifts[k] for k in range(len(links))},
            payload_centre=shifts[-1],
        )
    )


@effect("gravity_direction", no_joint)
def gravity_direction(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """The base is `tilt` (3 mrad) out of level in a random direction; its pose in the measuring frame is unaffected."""
    tilt, way = sizes.value("tilt", 3e-3), sizes.rng.uniform(-np.pi, np.pi)
    return EffectTruth(body=BodyError(tilt=tilt * np.array([np.cos(way), np.sin(way), 0.0])))
