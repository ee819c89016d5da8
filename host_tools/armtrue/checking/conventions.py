"""Wrong conventions: the change in how the file is read under which the nominal arm follows the measurements.

Signs, zeros, couplings, degrees, tables, orders and scale compete, singly and in pairs. Each is judged by the residual
after base and tool are found without starting values; each further change must reduce it to a third or less.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from armtrue.checking import hypotheses, lengths
from armtrue.checking.alignment import NOMINAL_ERROR_PER_REACH, Columns, align, thinned
from armtrue.checking.hypotheses import Hypothesis
from armtrue.checking.moved.geometry import Geometry
from armtrue.checking.placement import Reading, lower_bounds
from armtrue.checking.report import Finding
from armtrue.io.robot import Robot

# A further change is accepted if it leaves at most this share of the residual.
_CONVINCING = 1 / 3
# Real arms differ from nominal ones by this much [m per metre of reach]: a smaller residual is no stronger evidence.
_AS_GOOD_AS_NOMINAL = 0.0005
_ROWS = 60
_ROWS_OF_GEOMETRY = 300
# Hypotheses that leave at most this multiple of the smallest residual explain the data as well.
_AS_WELL = 1.5
_MOST_AS_WELL = 3
# Number of hypotheses with the lowest bounds that are aligned in full; each takes 20 ms.
_MOST_ALIGNED = 16
_SCALE_PASSES = 2
# Smaller errors of a zero are left to the calibration.
_LEAST_ZERO_DEGREES = 2.0
_ZERO_STEP_DEGREES = 15.0
_LARGEST_SCALE_WITHIN = 1.25


@dataclass(frozen=True)
class _Judged:
    """A hypothesis (None: no change), its RMS residual, the least residual that counts and the points' spread [m]."""

    hypothesis: Hypothesis | None
    rms_m: float
    floor_m: float
    spread_m: float

    @property
    def changes(self) -> int:
        return 0 if self.hypothesis is None else self.hypothesis.changes

    @property
    def score(self) -> float:
        """The residual relative to the points' spread, divided by `_CONVINCING` once for each change.

        Relative, since any arm reaches points that another unit shrinks almost to one point.
        """
        return max(self.rms_m, self.floor_m) / self.spread_m / _CONVINCING**self.changes


def find(
    columns: Columns, robot: Robot, more: Callable[[Reading], Iterable[Hypothesis]] = lambda _: ()
) -> list[Finding]:
    """One error for each wrong convention, or a single one if the positions follow the joints under no hypothesis.

    `more` gives further hypotheses if the unchanged file leaves more than nominal geometry may. A change is accepted
    only if it leaves no more than that. If fitted geometry explains the points instead, a warning says so.
    """
    reading = Reading(columns, robot.spec)
    search = _Search(reading, robot)
    start = search.aligned(None)[0]
    if start.rms_m <= start.floor_m / _CONVINCING:
        return []
    far_off = start.rms_m > search.widest_m
    best, as_well = search.best(more(reading) if far_off else ())
    if best.hypothesis is not None and best.rms_m <= search.widest_m:
        return _findings(best, as_well, start.rms_m)
    if not far_off:
        return []
    if (geometry := _by_geometry(reading)) is not None:
        return [_far_from_nominal(geometry, robot)]
    if best.hypothesis is not None and _by_geometry(best.hypothesis.apply(reading)) is not None:
        return _findings(best, as_well, start.rms_m)
    return [_no_convention(start.rms_m, best, robot)]


class _Search:
    """The competition between all hypotheses about one reading."""

    def __init__(self, reading: Reading, robot: Robot) -> None:
        self._reading = reading
        self._robot = robot
        self.widest_m = NOMINAL_ERROR_PER_REACH * robot.reach_m
        self._floor_m = _AS_GOOD_AS_NOMINAL * robot.reach_m
        self._spread_m = lengths.spread(reading.columns)

    def best(self, more: Iterable[Hypothesis]) -> tuple[_Judged, list[str]]:
        """The first hypothesis whose score is within `_AS_WELL` of the lowest (None: no change), and its rivals.

        `more`: hypotheses that compete in addition to those about conventions.
        """
        judged = [one for hypothesis in (None, *more) for one in self.aligned(hypothesis)]
        singles = hypotheses.singles(self._robot)
        # For each joint, the offset of its zero, at any angle, with the smallest lower bound on the residual.
        offsets = {joint: self._best_zero(joint) for joint in hypotheses.joints_with_a_zero(self._robot)}
        odd_zeros = [
            hypotheses.zero(joint, degrees, self._robot)
            for joint, degrees in offsets.items()
            if abs(degrees) >= _LEAST_ZERO_DEGREES
        ]
        judged += self._judge([*singles, *odd_zeros], min(one.score for one in judged))
        lowest = min(one.score for one in judged)
        if lowest > self._lowest_score(changes=2):
            pairs = (hypotheses.pair(*both) for both in itertools.combinations(singles, 2))
            several = [*filter(None, pairs), *hypotheses.sign_patterns(self._robot)]
            judged += self._judge(several, lowest)
        judged += self._with_one_more(min(judged, key=lambda one: one.score), singles)
        lowest = min(one.score for one in judged)
        best = next(one for one in judged if one.score <= _AS_WELL * lowest)
        return best, self._rivals(best, judged)

    def _rivals(self, best: _Judged, judged: list[_Judged]) -> list[str]:
        """Sentences of other hypotheses with as many changes whose residual is about as small."""
        limit = _AS_WELL * max(best.rms_m, self._floor_m)
        others = [
            one for one in judged if one is not best and one.changes == best.changes and one.rms_m <= limit
        ]
        return [one.hypothesis.sentence for one in others if one.hypothesis is not None][:_MOST_AS_WELL]

    def _best_zero(self, joint: int) -> float:
        degrees, step = 0.0, _ZERO_STEP_DEGREES
        around = np.arange(-12, 12)
        while step > _ZERO_STEP_DEGREES / 1000.0:
            tried = [degrees + step * int(count) for count in around]
            zeros = [hypotheses.zero(joint, angle, self._robot) for angle in tried]
            degrees = tried[int(np.argmin(lower_bounds([*map(self._sample, zeros)])))]
            step, around = step / 4.0, np.arange(-4, 5)
        return degrees

    def _lowest_score(self, changes: int) -> float:
        """The lowest score that `changes` changes can have."""
        return self._floor_m / self._spread_m / _CONVINCING**changes

    def _with_one_more(self, best: _Judged, singles: list[Hypothesis]) -> list[_Judged]:
        """Three mistakes at once: the best hypothesis so far, combined with each single one."""
        if best.hypothesis is None or best.changes < 2 or best.score <= self._lowest_score(changes=3):
            return []
        more = (hypotheses.pair(best.hypothesis, one) for one in singles)
        return self._judge([*filter(None, more)], best.score)

    def _judge(self, candidates: Sequence[Hypothesis], to_beat: float) -> list[_Judged]:
        """Those of `candidates` whose bound may beat `to_beat`, aligned in full, in their given order."""
        sampled = [self._sample(candidate) for candidate in candidates]
        charged = [
            max(bound, self._floor_m / self._spread_m) / _CONVINCING**candidate.changes
            for bound, candidate in zip(lower_bounds(sampled), candidates, strict=True)
        ]
        found: dict[int, list[_Judged]] = {}
        for at in sorted(range(len(candidates)), key=charged.__getitem__)[:_MOST_ALIGNED]:
            if charged[at] > _AS_WELL * to_beat:
                break
            found[at] = self.aligned(candidates[at])
            to_beat = min([to_beat, *(one.score for one in found[at])])
        return [one for at in sorted(found) for one in found[at]]

    def _sample(self, hypothesis: Hypothesis | None) -> Reading:
        reading = self._reading if hypothesis is None else hypothesis.apply(self._reading)
        return Reading(thinned(reading.columns, _ROWS), reading.spec)

    def aligned(self, hypothesis: Hypothesis | None) -> list[_Judged]:
        """`hypothesis` alone, and combined with the scale that the alignment finds if both explain the points.

        Alone, its residual is infinite if that scale is beyond `_LARGEST_SCALE_WITHIN`.
        """
        sample = self._sample(hypothesis)
        first = align(sample.columns, sample.robot)
        # The alignment itself corrects another unit, so its residual does not belong to this hypothesis alone.
        within = 1.0 / _LARGEST_SCALE_WITHIN < first.scale < _LARGEST_SCALE_WITHIN
        rms = first.rms_m if within else math.inf
        judged = [_Judged(hypothesis, rms, self._floor_m, self._spread_m)]
        if not abs(first.scale - 1.0) > lengths.TOLERANCE:
            return judged
        scale, latest = 1.0, first
        for _ in range(_SCALE_PASSES):
            scale *= latest.scale
            if not (math.isfinite(scale) and scale > 0.0):
                return judged
            latest = align(lengths.scaled(sample.columns, scale), sample.robot)
        scaled = hypotheses.scale(scale, self._robot)
        both = scaled if hypothesis is None else hypotheses.pair(hypothesis, scaled)
        # Wrong conventions give arbitrary scales: a scale counts only if it explains the points.
        if both is None or latest.rms_m > self.widest_m:
            return judged
        return [*judged, _Judged(both, latest.rms_m, self._floor_m, self._spread_m / scale)]


def _findings(best: _Judged, as_well: list[str], start_m: float) -> list[Finding]:
    assert best.hypothesis is not None
    parts = best.hypothesis.each()
    before = f"{start_m * 1000:.1f} mm RMS remain" if np.isfinite(start_m) else "no base and tool fit"
    so = "with this correction" if len(parts) == 1 else "with all corrections found here"
    figures = f"with nominal kinematics and the files as they are {before}, {best.rms_m * 1000:.2f} mm {so}"
    rms_m = start_m if np.isfinite(start_m) else None
    evidence = {"rms_m": rms_m, "rms_m_if_changed": best.rms_m, "as_well": as_well}
    words = f" (or {'; or '.join(as_well)})" if as_well else ""
    findings = []
    for part in parts:
        message = f"{part.sentence}{words}: {figures}"
        findings.append(Finding(part.code, "error", message, {**part.figures, **evidence}, part.remedy))
    return findings


def _by_geometry(reading: Reading) -> Geometry | None:
    """Geometry alone fitted to a reading; None if it does not explain the points within the errors that arms have."""
    try:
        geometry = Geometry(thinned(reading.columns, _ROWS_OF_GEOMETRY), reading.robot)
    except (ValueError, np.linalg.LinAlgError):
        return None
    return geometry if geometry.explains else None


def _far_from_nominal(geometry: Geometry, robot: Robot) -> Finding:
    nominal, fitted = geometry.nominal_rms_m, geometry.rms_m
    return Finding(
        "far_from_nominal",
        "warning",
        f"the arm is far from its nominal geometry: {nominal * 1000:.1f} mm RMS remain with it, "
        f"{nominal / robot.reach_m:.1%} of the reach of {robot.reach_m:.2f} m, and {fitted * 1000:.2f} mm after zeros "
        f"and links are fitted (turned by up to {math.degrees(geometry.largest_turn):.1f}°, shifted by up to "
        f"{geometry.largest_shift_m * 1000:.1f} mm)",
        {
            "rms_m": nominal,
            "rms_m_if_fitted": fitted,
            "largest_turn_rad": geometry.largest_turn,
            "largest_shift_m": geometry.largest_shift_m,
        },
        f"Nothing to do if the arm is known to differ that much; else compare {robot.kinematics_file} with its data "
        "sheet. A fit with joint_offset and link_geometry finds the differences.",
    )


def _no_convention(rms: float, best: _Judged, robot: Robot) -> Finding:
    stay = f"{rms * 1000:.0f} mm RMS remain" if math.isfinite(rms) else "none makes the two agree"
    nearest, figures = "", {}
    if best.hypothesis is not None and math.isfinite(best.rms_m):
        nearest = f" (best of the corrections tried, with {best.rms_m * 1000:.0f} mm RMS: {best.hypothesis.sentence})"
        figures = {"nearest": best.hypothesis.code, "rms_m_of_nearest": best.rms_m}
    return Finding(
        "positions_do_not_follow",
        "error",
        f"the positions do not follow the joints: with the best base and tool {stay}, and no change of a sign, zero, "
        "coupling, order of columns or scale, and no pair of these, explains it; nor do zeros and links that differ "
        f"as much as those of real arms{nearest}",
        {"rms_m": rms if math.isfinite(rms) else None, **figures},
        f"Compare {robot.kinematics_file} with the arm's data sheet, and the pairing of joints and positions with the "
        "log.",
    )
