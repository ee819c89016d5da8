"""Effects outside the catalogue: a diagnosis must name their variables and not attribute them to other effects."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..effects.base import ARCSEC
from ..mechanics.chain import Chain
from ..presets import PRESETS, nominal_robot


def foreign_effects(arm: str, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Scenario entries (effect custom) for an arm of PRESETS, one of each shape, with joints and sizes drawn.

    Sizes are those of real joint errors, 20 to 60 arcsec at the variables' full range.
    """
    n = Chain.from_robot(nominal_robot(arm)).n
    wrist, late = (n - 2, n - 1) if n > 4 else (2, n)
    heaviest = max(PRESETS[arm].payloads)

    def entry(name: str, coordinate: str, expression: str, joints: list[int], full: float) -> dict[str, Any]:
        """`full`: largest absolute value of the expression."""
        value = float(rng.choice([-1.0, 1.0]) * rng.uniform(20.0, 60.0) * ARCSEC / full)
        return {
            "effect": "custom",
            "name": name,
            "coordinate": coordinate,
            "expression": expression,
            "joints": joints,
            "value": value,
        }

    step = (
        float(np.round(rng.uniform(-0.5, 0.1), 3))
        if arm != "cobot"
        else float(np.round(rng.uniform(-1.8, -1.2), 3))
    )
    return [
        entry("joint_product", "motor2", "sin(q1)*cos(q3)", [1, 3], 1.0),
        entry("cable_drag", "motor3", f"q{wrist}*q{late}", [wrist, late], 4.0),
        entry("cable_slack", "motor2", f"max(q{wrist}*q{late}, 0)", [wrist, late], 4.0),
        entry("payload_cubed", "motor1", f"(payload/{heaviest})^3", [], 1.0),
        entry("joint_step", "motor1", f"sign(q2 - {step!r})", [2], 1.0),
        entry("heat_times_joint", "motor2", "tanh(dT*q1/10)", [1], 1.0),
        entry("direction_product", "motor3", "dir1*dir2", [1, 2], 1.0),
        entry("air_conditioning", "motor1", "sin(2*pi*time/1700)", [], 1.0),
    ]
