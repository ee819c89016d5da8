"""Link bending by beam theory (Euler and Bernoulli; Timoshenko, "Strength of Materials" I, chapter 5).

Link k is a cantilever of length L from joint k to joint k+1. It carries its own weight, evenly distributed, and at its
end the load of all later links: a force F and a moment M. With weight w per metre across it, each in its plane of
bending,

    slope      a = F L^2 / 2EI + M L / EI   + w L^3 / 6EI
    deflection d = F L^3 / 3EI + M L^2 / 2EI + w L^4 / 8EI

The catalogue's bending turns the link at its joint in proportion to the total moment there, so it differs in the ratio
of force to moment and in the shift of the end. The link bends in both planes, also about parallel axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm import Arm, State
from ..effects.base import EffectContext, EffectTruth, Sizes, effect
from ..mechanics.chain import Frames
from ..mechanics.statics import distal_load
from ..mechanics.transforms import Array
from ..presets import nominal_robot


@dataclass(frozen=True)
class Beam:
    """Link `link` (from 0) with bending stiffness EI, `stiffness` in N m^2."""

    link: int
    stiffness: float

    def scaled(self, factor: float) -> Beam:
        """`factor` times as soft."""
        return replace(self, stiffness=self.stiffness / factor)

    def coordinates(self, arm: Arm, state: State, frames: Frames) -> dict[int, Array]:
        """Slope and deflection of the link's end as a shift and a turn of the frame at its root."""
        k = self.link
        span = arm.chain.link_lengths[k]
        length = float(np.linalg.norm(span))
        along = span / length
        force, moment, weight = distal_load(
            arm.heavy, frames, state.column("payload", 0.0), arm.payload_point(frames), k
        )
        across = np.cross(along, force + np.zeros(3))
        own = np.cross(along, weight) / length
        bending = moment - np.outer(moment @ along, along)
        slope = (across * length**2 / 2.0 + bending * length + own * length**3 / 6.0) / self.stiffness
        # The end shifts in the direction in which the slope turns it: the slope's axis crossed with the link.
        turn = (across * length**3 / 3.0 + bending * length**2 / 2.0 + own * length**4 / 8.0) / self.stiffness
        shift = np.cross(turn, along)
        return {k: np.concatenate([shift - np.cross(slope, span), slope], axis=1)}


@effect("beam_bending", lambda context: [2])
def beam_bending(context: EffectContext, joints: list[int], sizes: Sizes) -> EffectTruth:
    """A link as a beam; a moment at its end bends it by 0.5 to 1.5 of the largest bending compliance of such arms."""
    beams = []
    for k in joints:
        length = float(np.linalg.norm(context.chain.link_lengths[k - 1]))
        bending = sizes.value("compliance", sizes.rng.uniform(0.5, 1.5) * context.preset.bending[1], k)
        beams.append(Beam(k - 1, length / bending))
    return EffectTruth(physics=list(beams))


def causes(joint: int) -> frozenset[str]:
    """Right answers: bending of the link or its neighbours, torsion of the joints at its ends, both together."""
    near = (joint - 1, joint, joint + 1)
    return frozenset(
        {f"bending_compliance {k}" for k in near}
        | {f"joint_compliance {k}" for k in (joint, joint + 1)}
        | {f"cross_compliance {joint},{joint + 1}"}
    )


def variables(joint: int) -> frozenset[str]:
    """State variables that the error depends on."""
    return frozenset({"payload"} | {f"{v}{k}" for v in ("tau", "gmx", "gmy") for k in (joint, joint + 1)})


def choices(arm: str) -> list[list[int]]:
    """Joints whose link is long: at least a fifth of a metre."""
    rows = nominal_robot(arm)["kinematics"]["joints"]
    return [[k] for k in range(1, len(rows)) if abs(rows[k]["a"]) + abs(rows[k]["d"]) > 0.2]
