"""Truths whose form no effect of the catalogue has: what physics does, not what a model writes.

A diagnosis is right about one where it names the cause (`causes`: any of these words, see tests/hidden_effects) or
calls it unexplained by one of the variables that it depends on; it is wrong where it is sure of anything else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from . import beam, dahl, duty_heat, levelling, teeth, tracker_circles
from .formulas import foreign_effects


@dataclass(frozen=True)
class ForeignTruth:
    """What to answer: causes and variables by the joint that it acts on (from 1); choices: joints of an arm preset."""

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

# `levelling` is no member: arms without a passive joint cannot have it, and campaigns draw arms and truths apart.
__all__ = ["TRUTHS", "ForeignTruth", "foreign_effects", "levelling"]
