"""Measuring over CAN: the arm goes to poses, the tracker looks, a table of what was recorded comes out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from armtrue_loop.controller import Controller
from armtrue_loop.operator import Operator
from armtrue_loop.plans import Array, Plan
from armtrue_loop.wiring import JOINTS


@dataclass
class Session:
    """Columns of what was recorded, as in the contract."""

    columns: dict[str, list[float]] = field(default_factory=dict)

    def add(self, row: Mapping[str, float]) -> None:
        """Append one measurement."""
        for name, value in row.items():
            self.columns.setdefault(name, []).append(value)

    def csv(self) -> str:
        """The contract's CSV."""
        names = list(self.columns)
        rows = zip(*self.columns.values(), strict=True)
        return "\n".join([",".join(names), *(",".join(f"{v:.10g}" for v in row) for row in rows)]) + "\n"

    def positions(self) -> Array:
        """Measured positions (N, 3), metres."""
        return np.array([self.columns[axis] for axis in "xyz"]).T


def _directions(last: Array, joints: Array, before: Array) -> Array:
    """The direction in which each joint last moved, by the commands."""
    moved = np.sign(joints - before)
    return np.where(moved == 0.0, last, moved)


def measure(
    controller: Controller,
    operator: Operator,
    plan: Plan,
    purpose: str,
    move_cycles: int,
    settle_cycles: int,
    progress: Callable[[int, int], None],
) -> Session:
    """Go through a plan. Commands are recorded, not what the compensator made of them."""
    session = Session()
    direction = np.zeros(JOINTS)
    payload = None
    for number, joints in enumerate(plan.joints):
        if plan.payloads[number] != payload:
            payload = float(plan.payloads[number])
            operator.ask(mount=payload)
            controller.set_payload(payload)
        state = operator.ask(wait=plan.pause_s)
        before = controller.joints
        controller.move(joints, move_cycles, settle_cycles)
        direction = _directions(direction, controller.joints, before)
        seen = operator.ask(measure=purpose)
        row = {f"q{k + 1}": float(q) for k, q in enumerate(controller.joints)}
        row |= seen | {"payload": payload, "repeat": float(plan.repeat[number])} | state
        row |= {f"dir{k + 1}": float(d) for k, d in enumerate(direction)}
        session.add(row)
        progress(number + 1, len(plan.joints))
    return session
