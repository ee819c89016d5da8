"""Checks which drive each axis has, and its sign and scale, from the frames of a bus.

Nothing is commanded. While the controller moves the arm, targets and actual positions are compared at the delay that
fits best: the target that an actual position follows identifies its axis, and the slope gives sign and scale.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import can
import numpy as np

from armtrue.arrays import Array
from armtrue.device.cycle_frames import (
    ACTUAL_POSITION,
    RECEIVE,
    TARGET_POSITION,
    VALUE_BYTES,
    FrameSets,
    axes_of,
    axes_without_drives,
    mapping_of,
    number_of,
)
from armtrue.device.sdo import SdoClient

# Least travel of an axis [increments] for any finding: far above the position noise of a drive at rest.
LEAST_TRAVEL = 1000
# Cycles by which an actual position may lag behind its target (following error, bus, filters).
_LONGEST_DELAY = 60
# An actual position follows a target that explains this share of its variance. More is not required, because adapters
# that deliver in batches and slow machines shift frames by cycles.
_FOLLOWS = 0.9
# A second target explains a motion as well if it leaves at most _AS_GOOD times the variance that the best target
# leaves, plus _AS_GOOD_SHARE of the total.
_AS_GOOD = 4.0
_AS_GOOD_SHARE = 0.002
# Tolerated difference of a slope from 1.
SCALE_TOLERANCE = 0.02
_MEMORY = 20  # length of the smoothing filter in delays: older targets have no weight


@dataclass(frozen=True)
class Match:
    """How one actual position follows one target."""

    explained: float
    slope: float
    delay: int  # cycles
    # The slope on the target after smoothing as by a position loop that lags by `delay`, which attenuates fast motion.
    smoothed_slope: float = 0.0


@dataclass(frozen=True)
class Axis:
    """Observed motion of one axis."""

    commanded: float  # travel of its target, increments
    moved: float | None  # travel of its actual position; None: never received
    follows: tuple[int, ...]  # axes, from 1, whose targets its actual position follows
    slope: float | None  # of the actual position over its own target
    delay: int | None  # cycles


@dataclass(frozen=True)
class Report:
    """Result of comparing recorded targets and actual positions."""

    axes: list[Axis]
    findings: list[str]  # one sentence each
    unknown: list[str]  # what this motion does not determine, one sentence each

    @property
    def is_right(self) -> bool:
        """Whether order, sign and scale of all axes are determined and correct."""
        return not self.findings and not self.unknown

    def document(self) -> dict[str, object]:
        """The figures for --json."""
        return {
            "right": self.is_right,
            "axes": [dict(vars(axis)) for axis in self.axes],
            "findings": self.findings,
            "unknown": self.unknown,
        }


def match(target: Array, actual: Array) -> Match:
    """The best linear dependence of an actual position on an earlier target, over all delays."""
    best = Match(0.0, 0.0, 0)
    for delay in range(min(_LONGEST_DELAY, len(target) // 4) + 1):
        commanded, found = target[: len(target) - delay], actual[delay:]
        commanded, found = commanded - commanded.mean(), found - found.mean()
        power, spread = float(commanded @ commanded), float(found @ found)
        if power == 0.0 or spread == 0.0:
            continue
        common = float(commanded @ found)
        explained = common * common / (power * spread)
        if explained > best.explained + 1e-9:
            best = Match(explained, common / power, delay)
    if best.delay == 0:
        return replace(best, smoothed_slope=best.slope)
    kept = best.delay / (best.delay + 1.0)
    weights = (1.0 - kept) * kept ** np.arange(_MEMORY * best.delay)
    smoothed = np.convolve(target - target[0], weights)[: len(target)]
    found = actual - actual.mean()
    centred = smoothed - smoothed.mean()
    power, common = float(centred @ centred), float(centred @ found)
    fits = power > 0.0 and common != 0.0
    return replace(best, smoothed_slope=float(found @ found) / common if fits else best.slope)


def examine(targets: Array, actuals: Array, absent: frozenset[int] = frozenset()) -> Report:
    """Compare recorded targets with actual positions (cycles × axes; NaN columns: never received).

    `absent`: axes, from 0, that have no drive; nothing is expected of them.
    """
    joints = targets.shape[1]
    commanded = np.ptp(targets, axis=0) if len(targets) else np.zeros(joints)
    heard = [bool(len(actuals)) and not np.isnan(actuals[:, k]).any() for k in range(joints)]
    moved = [float(np.ptp(actuals[:, k])) if heard[k] else None for k in range(joints)]
    matches = {
        (j, k): match(targets[:, k], actuals[:, j])
        for j in range(joints)
        for k in range(joints)
        if heard[j] and (moved[j] or 0.0) > 0.0 and commanded[k] >= LEAST_TRAVEL
    }
    axes = []
    for j in range(joints):
        follows = _followed({k: matches[j, k].explained for k in range(joints) if (j, k) in matches})
        own = matches[j, j] if j + 1 in follows else None
        slope, delay = (None, None) if own is None else (own.slope, own.delay)
        axes.append(Axis(float(commanded[j]), moved[j], follows, slope, delay))
    return Report(axes, _findings(axes, matches, absent), _unknown(axes))


def _followed(explained: dict[int, float]) -> tuple[int, ...]:
    """The axes, from 1, whose targets explain a motion: the best one, and those that explain it as well."""
    left = 1.0 - max(explained.values(), default=0.0)
    if left > 1.0 - _FOLLOWS:
        return ()
    return tuple(k + 1 for k, share in explained.items() if 1.0 - share <= _AS_GOOD * left + _AS_GOOD_SHARE)


def _of_its_own(match: Match) -> list[str]:
    """Errors in sign and scale of a drive that follows a target with `match`.

    A varying delay of the frames flattens the slope, and a lagging position loop attenuates the motion: the scale lies
    between the slope and the inverse slope of the target, raw or smoothed as by such a loop, on the actual position.
    """
    words = []
    if match.slope < 0.0:
        words.append("backwards")
    least, most = abs(match.slope), max(abs(match.slope) / match.explained, abs(match.smoothed_slope))
    if least > 1.0 + SCALE_TOLERANCE or most < 1.0 - SCALE_TOLERANCE:
        words.append(f"{abs(match.slope):.3g} times as far as commanded")
    return words


def _findings(axes: list[Axis], matches: dict[tuple[int, int], Match], absent: frozenset[int]) -> list[str]:
    found = []
    told: set[int] = set()
    for j, axis in enumerate(axes):
        number = j + 1
        if j in absent:
            continue
        if axis.moved is None:
            found.append(
                f"axis {number}: no actual position was heard: map 0x{ACTUAL_POSITION + 0x800 * j:04X} in a valid "
                "RPDO of the compensator, and see that the drive sends it"
            )
        elif number in axis.follows:
            words = _of_its_own(matches[j, j])
            if words:
                found.append(f"axis {number}: the drive moves {' and '.join(words)}")
        elif len(axis.follows) == 1 and j not in told:
            other = axis.follows[0] - 1
            extra = "".join(f", {words}" for words in _of_its_own(matches[j, other]))
            if axes[other].follows == (number,):
                told.add(other)
                found.append(f"axes {number} and {other + 1}: their drives are exchanged{extra}")
            else:
                found.append(f"axis {number}: its drive follows the target of axis {other + 1}{extra}")
        elif not axis.follows and axis.commanded >= LEAST_TRAVEL:
            found.append(
                f"axis {number}: commanded to move {axis.commanded:.0f} increments, and its drive does not follow"
            )
        elif not axis.follows and (axis.moved or 0.0) >= LEAST_TRAVEL:
            found.append(f"axis {number}: moves {axis.moved:.0f} increments and was not commanded to")
    return found


def _unknown(axes: list[Axis]) -> list[str]:
    found = []
    alike = sorted({axis.follows for axis in axes if len(axis.follows) > 1})
    for group in alike:
        names = ", ".join(map(str, group[:-1])) + f" and {group[-1]}"
        found.append(f"axes {names} were commanded alike and cannot be told apart: move one after the other")
    for j, axis in enumerate(axes):
        if axis.moved is not None and axis.commanded < LEAST_TRAVEL and not axis.follows:
            found.append(
                f"axis {j + 1}: was commanded to move {axis.commanded:.0f} increments, "
                f"at least {LEAST_TRAVEL} are needed"
            )
    return found


class Listener:
    """Takes targets and actual positions from the frames of a bus; reads only the mapping of these from the device."""

    def __init__(self, client: SdoClient, joints: int) -> None:
        window_s = 1e-6 * number_of(client, 0x2000, 4)
        self._joints = joints
        self._sync = number_of(client, 0x1005, 0) & 0x7FF
        mapped = mapping_of(client, *RECEIVE, TARGET_POSITION)
        self.absent = axes_without_drives(client, joints, mapped)
        self._targets = FrameSets(mapped, joints, window_s, self.absent)
        self.maps_targets = axes_of(mapped) >= set(range(joints)) - self.absent
        self._actuals = mapping_of(client, *RECEIVE, ACTUAL_POSITION)
        self._latest = np.full(joints, np.nan)
        self._rows: list[tuple[list[int], Array]] = []

    def take(self, message: can.Message) -> None:
        """Process a frame; frames come in the order of the bus."""
        if message.is_error_frame or message.is_remote_frame:
            return
        key = (message.arbitration_id, message.is_extended_id)
        if key == (self._sync, False):
            self._targets.divide()
        elif self._targets.belongs(message):
            targets = self._targets.take(message)
            if targets is not None:
                self._rows.append((targets, self._latest.copy()))
        for place, axis in self._actuals.get(key, []):
            value = bytes(message.data)[place : place + VALUE_BYTES]
            if axis < self._joints and len(value) == VALUE_BYTES:
                self._latest[axis] = int.from_bytes(value, "little", signed=True)

    def recorded(self) -> tuple[Array, Array]:
        """Targets and actual positions (cycles × axes), from when all axes that send positions had sent one."""
        comes = ~np.isnan(self._latest)
        rows = [row for row in self._rows if not np.isnan(row[1][comes]).any()]
        if not rows:
            return np.zeros((0, self._joints)), np.zeros((0, self._joints))
        return np.array([row[0] for row in rows], float), np.array([row[1] for row in rows])
