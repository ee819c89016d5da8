"""Steps between two rows: from some row on, the measuring frame or the reflector's place is another."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.checking.alignment import Columns, evenly
from armtrue.checking.moved.geometry import Geometry, moved_by, seen_part
from armtrue.checking.moved.structure import span_of_all_else
from armtrue.checking.report import Finding
from armtrue.io.columns import commanded_joints
from armtrue.io.dataset import Dataset
from armtrue.io.robot import Robot

# Most rows that are used; more only take time.
_ROWS = 600
# Each side of a step needs this many rows, and a twelfth of all.
_FEWEST_ROWS = 8
_SHARE_OF_ROWS = 12
_FEWEST_IN_ALL = 40
# Least F statistic of a step; correlation of neighbouring rows reduces the statistic. Without any step it can be far
# larger than by chance alone, as a real arm warms up and wears while it is measured.
_FAR_MORE_THAN_CHANCE = 100.0
_MOST_STEPS = 3
_LEAST_SEEN = 1e-5


@dataclass(frozen=True)
class _Step:
    """A step of `kind` ("base", or "tool" and its number) before row `at` in order of time.

    `explained`: share of the squared residual that it explains. `beyond_chance`: the F statistic.
    """

    kind: str
    at: int
    explained: float
    beyond_chance: float


def find(data: Dataset, measured: Columns, robot: Robot) -> list[Finding]:
    """One warning for each time that tracker, base or reflector was moved. `measured`: the rows of `data`, SI."""
    chosen = evenly(data.count, _ROWS)
    if len(chosen) < _FEWEST_IN_ALL:
        return []
    few = data.take(chosen)
    columns = {name: values[chosen] for name, values in measured.items()}
    columns |= {name: few.columns[name] for name in ("nest",) if name in few.columns}
    try:
        geometry = Geometry(columns, robot)
    except ValueError:
        return []
    order = np.argsort(few.clock, kind="stable")
    moved = [_finding(few, geometry, step, order) for step in _steps(few, geometry, order)]
    return [*moved, *_set_ups(geometry)]


def _steps(data: Dataset, geometry: Geometry, order: NDArray[np.int64]) -> list[_Step]:
    """The steps, the largest first. `order`: the rows in order of time."""
    progress = np.empty(data.count)
    progress[order] = np.linspace(-1.0, 1.0, data.count)
    weight = np.repeat(geometry.follows.astype(np.float64), 3)
    span = span_of_all_else(data, geometry, progress)
    found: list[_Step] = []
    for _ in range(_MOST_STEPS):
        left = geometry.residual_m.ravel() * weight
        left = left - span @ (span.T @ left)
        step = _best(geometry, span, left, order)
        if step is None:
            return found
        found.append(step)
        taken = np.zeros((data.count, 3, 6))
        later = order[step.at :]
        taken[later] = _columns_of(geometry, step.kind)[later]
        flat = taken.reshape(3 * data.count, -1) * weight[:, None]
        flat = flat - span @ (span.T @ flat)
        span = np.hstack([span, seen_part(flat, _LEAST_SEEN)[0]])
    return found


def _best(geometry: Geometry, span: Array, left: Array, order: NDArray[np.int64]) -> _Step | None:
    """The step that explains `left` (3N,) best, if its F statistic is large enough."""
    kinds = ["base", *(f"tool {number}" for number in range(int(geometry.tool.max()) + 1))]
    found = [step for kind in kinds if (step := _of_kind(geometry, span, left, order, kind)) is not None]
    # The Bayesian information criterion compares the six coordinates of a base with the three of a tool.
    equations = 3 * int(geometry.follows.sum())

    def criterion(one: _Step) -> float:
        return equations * math.log(max(1e-9, 1.0 - one.explained)) + _size(one.kind) * math.log(equations)

    found.sort(key=criterion)
    return next((one for one in found if one.beyond_chance >= _FAR_MORE_THAN_CHANCE), None)


def _size(kind: str) -> int:
    return 6 if kind == "base" else 3


def _columns_of(geometry: Geometry, kind: str) -> Array:
    """Shifts of the points (N, 3, 6) by the coordinates of a step of `kind`; for a tool the last three are 0."""
    if kind == "base":
        return moved_by(geometry.frames[0], geometry.points, geometry.reach_m).transpose(0, 2, 1)
    of_tool = geometry.tool == int(kind.split()[1])
    result = np.zeros((len(of_tool), 3, 6))
    result[of_tool, :, :3] = geometry.flange[of_tool, :3, :3]
    return result


def _of_kind(
    geometry: Geometry, span: Array, left: Array, order: NDArray[np.int64], kind: str
) -> _Step | None:
    """The best step of `kind`; None if no step has enough rows on both sides."""
    count, size = len(order), _size(kind)
    weight = geometry.follows[order].astype(np.float64)
    columns = _columns_of(geometry, kind)[order, :, :size] * weight[:, None, None]
    kept, rest = span.reshape(count, 3, -1)[order], left.reshape(count, 3)[order]
    seen = np.cumsum(columns.any(axis=(1, 2)))
    fewest = max(_FEWEST_ROWS, count // _SHARE_OF_ROWS)
    places = np.flatnonzero((seen[:-1] >= fewest) & (seen[-1] - seen[:-1] >= fewest)) + 1
    if not places.size:
        return None
    # Sums from each row to the last give the normal equations of a step at that row, for all rows at once.
    square = _from_each_on(np.einsum("nia,nib->nab", columns, columns))[places]
    shared = _from_each_on(np.einsum("nia,nip->nap", columns, kept))[places]
    right = _from_each_on(np.einsum("nia,ni->na", columns, rest))[places]
    # Scaled by the size before `span` is projected out, so that a step within `span`, as of a set-up, gains nothing.
    scale = np.sqrt(np.maximum(1e-12, np.einsum("naa->na", square)))
    square = square - shared @ shared.transpose(0, 2, 1)
    normal = square / scale[:, :, None] / scale[:, None, :] + 1e-6 * np.eye(size)
    solved = np.linalg.solve(normal, (right / scale)[:, :, None])[:, :, 0]
    gains = np.einsum("na,na->n", solved, right / scale)
    best = int(np.argmax(gains))
    total = float((rest**2).sum())
    gain = min(float(gains[best]), (1.0 - 1e-9) * total)
    freedom = 3 * int(weight.sum()) - span.shape[1] - size
    if total <= 0.0 or freedom <= size:
        return None
    step = np.zeros((count, 3))
    step[places[best] :] = np.einsum("nia,a->ni", columns[places[best] :], solved[best] / scale[best])
    flat = kept.reshape(3 * count, -1)
    stays = rest - step + (flat @ (flat.T @ step.ravel())).reshape(-1, 3)
    alike = max(0.0, float((stays[1:] * stays[:-1]).sum() / max(1e-30, (stays**2).sum())))
    beyond = gain / size / ((total - gain) / freedom) * (1.0 - alike) / (1.0 + alike)
    return _Step(kind, int(places[best]), gain / total, beyond)


def _from_each_on(values: Array) -> Array:
    return np.cumsum(values[::-1], axis=0)[::-1]


def _finding(data: Dataset, geometry: Geometry, step: _Step, order: NDArray[np.int64]) -> Finding:
    before, first = (int(row) for row in data.rows[order[[step.at - 1, step.at]]])
    where = f"from row {first} on" if first == before + 1 else f"from a row between {before} and {first} on"
    shift_m, turn = _how_far(geometry, step, order)
    evidence: dict[str, Any] = {
        "first_row": first,
        "last_row_before": before,
        "shift_m": shift_m,
        "turn_rad": turn,
        "explained": step.explained,
    }
    share = f"that explains {step.explained:.0%} of the residual that the arm's geometry leaves"
    joint = _joint_that_parts(data, order, step.at)
    if joint is not None:
        evidence["joint"] = joint
        share += (
            f"; it may also be a jump of joint {joint}, which is on one side before and on the other after"
        )
    if step.kind == "base":
        return Finding(
            "base_step",
            "warning",
            f"{where} the points lie {shift_m * 1000:.1f} mm RMS from where they were before, turned by "
            f"{math.degrees(turn):.2f}°, as if tracker or base had been moved: {share}",
            evidence,
            "Increase the number in a column 'station' from there on and add the effect station to the model, or leave "
            "out the smaller part of the rows.",
        )
    names = data.labels.get("target", [])
    codes = data.columns.get("target", np.zeros(data.count)).astype(np.int64)
    number = int(step.kind.split()[1])
    name = f" '{names[int(codes[geometry.tool == number][0])]}'" if len(names) > 1 else ""
    return Finding(
        "reflector_step",
        "warning",
        f"{where} the reflector{name} is {shift_m * 1000:.1f} mm from its earlier place on the arm, as if it had been "
        f"exchanged or put back: {share}",
        evidence,
        "Increase the number in a column 'nest' from there on and add the effect nest to the model (for another "
        "reflector: another name in the column target), or leave out the smaller part of the rows.",
    )


def _joint_that_parts(data: Dataset, order: NDArray[np.int64], at: int) -> int | None:
    """The first joint, from 1, whose angles before the step are all below, or all above, those after it."""
    for k, name in enumerate(commanded_joints(data.columns), start=1):
        before, after = data.columns[name][order[:at]], data.columns[name][order[at:]]
        slack = 0.02 * float(np.ptp(data.columns[name]))
        if slack > 0.0 and (before.max() <= after.min() + slack or after.max() <= before.min() + slack):
            return k
    return None


def _set_ups(geometry: Geometry) -> Iterator[Finding]:
    """A note on the set-ups named in the file: a model without the effect station mixes their frames."""
    if len(geometry.bases) < 2:
        return
    middle = np.append(geometry.points.mean(axis=0), 1.0)
    from_first = [base @ np.linalg.inv(geometry.bases[0]) for base in geometry.bases[1:]]
    apart_m = max(float(np.linalg.norm((motion @ middle - middle)[:3])) for motion in from_first)
    yield Finding(
        "set_ups",
        "note",
        f"column 'station' names {len(geometry.bases)} set-ups, whose frames put the arm up to "
        f"{apart_m * 1000:.1f} mm apart",
        {"set_ups": len(geometry.bases), "apart_m": apart_m},
        "Add the effect station to the model: without it, a fit assumes one frame for all rows.",
    )


def _how_far(geometry: Geometry, step: _Step, order: NDArray[np.int64]) -> tuple[float, float]:
    """RMS shift [m] of the points and turn [rad] of the step, fitted together with the arm's geometry alone."""
    count, size = len(order), _size(step.kind)
    later = order[step.at :]
    columns = np.zeros((count, 3, size))
    columns[later] = _columns_of(geometry, step.kind)[later, :, :size]
    weight = np.repeat(geometry.follows.astype(np.float64), 3)
    flat = columns.reshape(3 * count, size) * weight[:, None]
    flat = flat - geometry.span @ (geometry.span.T @ flat)
    found = np.linalg.lstsq(flat, geometry.residual_m.ravel() * weight, rcond=1e-4)[0]
    moved = np.linalg.norm((columns @ found)[later], axis=1)
    moved = moved[moved > 0.0]
    turn = float(np.linalg.norm(found[3:])) / geometry.reach_m if size == 6 else 0.0
    return float(np.sqrt((moved**2).mean())), turn
