"""States that depend on the path to a pose and not on the pose: carried from row to row, in the order of the rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .mechanics.transforms import Array

# state before, motion of the joint (rad or m), seconds that it took -> state after
Advance = Callable[[float, float, float], float]


@dataclass(frozen=True)
class History:
    """A hidden state of one joint (from 1). `column` begins with _: expressions read it, no file has it."""

    column: str
    joint: int
    start: float
    advance: Advance

    def along(self, q: Array, time: Array) -> Array:
        """State (N,) at each row of a session that begins at the joint's zero, `q` (N, n) in the order of `time`."""
        value, before, clock = self.start, 0.0, 0.0
        states = np.empty(len(q))
        for i, (angle, now) in enumerate(zip(q[:, self.joint - 1], time, strict=True)):
            value = self.advance(value, float(angle - before), float(now - clock))
            states[i], before, clock = value, angle, now
        return states

    def beside(self, session: tuple[Array, Array], q: Array, time: Array) -> Array:
        """State (M,) at poses q that the arm reaches directly from the session's last row before their `time`."""
        rows, clock = session
        states = self.along(rows, clock)
        k = self.joint - 1
        result = np.empty(len(q))
        for i, now in enumerate(time):
            last = max(int(np.searchsorted(clock, now, side="right")) - 1, 0)
            result[i] = self.advance(states[last], float(q[i, k] - rows[last, k]), float(now - clock[last]))
        return result


def one_way_travel(joint: int) -> History:
    """Signed travel since the joint's last reversal: its sign is the direction of approach."""

    def advance(travel: float, motion: float, seconds: float) -> float:
        return travel + motion if travel * motion >= 0.0 else motion

    return History(f"_way{joint}", joint, 0.0, advance)


def warmth(joint: int, tau: float, full_speed: float, column: str = "_warm") -> History:
    """Low-passed duty: 1 after a long motion at `full_speed` (rad/s, m/s), 0 after a long rest."""

    def advance(warm: float, motion: float, seconds: float) -> float:
        keep = float(np.exp(-seconds / tau))
        duty = abs(motion) / (full_speed * seconds) if seconds > 0.0 else 0.0
        return keep * warm + (1.0 - keep) * duty

    return History(f"{column}{joint}", joint, 0.0, advance)
