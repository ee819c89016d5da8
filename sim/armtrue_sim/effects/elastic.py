"""What gravity does: torsion of axes, bending, a tilting foundation, the spring that carries axis 2."""

from __future__ import annotations

import numpy as np

from ..arm import Term
from ..errors import ScenarioError
from ..statics import gravity_loads
from .base import EffectContext, EffectTruth, Sizes, compliant_joints, effect, every_joint, no_joint


def drawn_torsion(context: EffectContext, sizes: Sizes, joint: int) -> float:
    """Torsion of an axis of this arm, rad/Nm (m/N where prismatic), joint from 1."""
    return float(sizes.rng.uniform(*context.preset.torsion[joint - 1]))


@effect("joint_compliance", compliant_joints)
def joint_compliance(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """A one-dimensional spring an axis; it yields to the load (docs/model.md, Sign)."""
    terms = []
    for k in joints:
        value = sizes.value("value", drawn_torsion(context, sizes, k), k)
        unit = "m/N" if context.chain.prismatic[k - 1] else "rad/Nm"
        terms.append(Term("joint_compliance", (k,), f"motor{k}", f"tau{k}", value, unit))
    return EffectTruth(terms)


@effect("stiffness_nonlinear", compliant_joints)
def stiffness_nonlinear(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Hardening: at the arm's full gravity torque the spring yields 20 to 50 % less than its slope at zero promises."""
    terms = []
    for k in joints:
        torsion = drawn_torsion(context, sizes, k)
        full = full_torque(context, k)
        square = -sizes.rng.uniform(0.2, 0.4) * torsion / full
        cube = -sizes.rng.uniform(0.0, 0.1) * torsion / full**2
        coordinate = f"motor{k}"
        value = sizes.value("square", square, k)
        terms.append(Term("stiffness_nonlinear", (k,), coordinate, f"tau{k}*abs(tau{k})", value, "rad/Nm^2"))
        value = sizes.value("cube", cube, k)
        terms.append(Term("stiffness_nonlinear", (k,), coordinate, f"tau{k}^3", value, "rad/Nm^3"))
    return EffectTruth(terms)


def full_torque(context: EffectContext, joint: int) -> float:
    """Gravity torque (Nm) on a motor (joint from 1), the worst of many poses with the largest payload; at least 1."""
    chain = context.chain
    q = np.random.default_rng(0).uniform(chain.limits[:, 0], chain.limits[:, 1], (256, chain.n))
    frames = chain.frames(chain.link_variables(q))
    load = np.full(len(q), max(context.preset.payloads))
    torque = gravity_loads(chain, frames, load, frames.flange_origin).motor_torque[:, joint - 1]
    return max(float(np.abs(torque).max()), 1.0)


@effect("bending_compliance", every_joint)
def bending_compliance(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """Links and bearings yield off their axis: moment x on rx, y on ry, each with its own stiffness."""
    terms = []
    for k in joints:
        # What carries less is built less stiff: bending grows towards the wrist roughly as torsion does.
        grow = float(np.sqrt(np.mean(context.preset.torsion[k - 1]) / np.mean(context.preset.torsion[0])))
        for axis in ("x", "y"):
            value = sizes.value(f"c{axis}", sizes.rng.uniform(*context.preset.bending) * grow, k)
            terms.append(
                Term("bending_compliance", (k,), f"link{k}.r{axis}", f"gm{axis}{k}", value, "rad/Nm")
            )
    return EffectTruth(terms)


@effect("base_compliance", no_joint)
def base_compliance(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """The foundation tilts under the arm's overhang."""
    terms = []
    for axis in ("x", "y"):
        value = sizes.value(f"c{axis}", sizes.rng.uniform(*context.preset.base_tilt))
        terms.append(Term("base_compliance", (), f"base.r{axis}", f"bm{axis}", value, "rad/Nm"))
    return EffectTruth(terms)


@effect("gravity_balancer", lambda context: [2])
def gravity_balancer(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
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
    return EffectTruth([Term("gravity_balancer", (2,), "motor2", torque, compliance, "rad/Nm")])
