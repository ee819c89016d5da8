"""True errors from physics, in forms that no effect of the catalogue has.

A diagnosis is right if it names the cause (`causes`: any of these words, see tests/hidden_effects) or reports
unexplained structure in one of the error's variables. It is wrong if it is sure of anything else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from . import beam, dahl, duty_heat, levelling, teeth, tracker_circles
from .formulas import foreign_effects


@dataclass(frozen=True)
class ForeignTruth:
    """Right answers: causes and variables by the joint it acts on (from 1). choices: joints of an arm preset."""

    causes: Callable[[int], frozenset[str]]
    variables: Callable[[int], frozenset[str]]
    choices: Callable[[str], list[list[int]]]
    plan: Mapping[str, Any]


TRUTHS: dict[str, ForeignTruth] = {
    "dahl_friction": ForeignTruth(dahl.causes, dahl.variables, dahl.choices, dahl.PLAN),
    "beam_bending": ForeignTruth(beam.causes, beam.variables, beam.choices, {}),
    "tooth_waves": ForeignTruth(teeth.causes, teeth.variables, teeth.choices, {}),
    "duty_heat": ForeignTruth(duty_heat.causes, duty_heat.variables, duty_heat.choices, duty_heat.PLAN),
    "tracker_circles": ForeignTruth(
        tracker_circles.causes, tracker_circles.variables, tracker_circles.choices, {}
    ),
}

# Without `levelling`: it needs an arm with a passive joint, but campaigns draw arms and truths independently.
__all__ = ["TRUTHS", "ForeignTruth", "foreign_effects", "levelling"]
