"""Columns with the controller's own pose, which is computed from the joints and not measured by an instrument.

They are recognised by their values, which follow nominal kinematics to the rounding of the file, far below the errors
of any arm, or by their name, as a calibrated controller computes with other kinematics.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass

import numpy as np

from armtrue.checking.alignment import NOMINAL_ERROR_PER_REACH, align, evenly
from armtrue.errors import InputError
from armtrue.foreign.pairing import Rows, match_rows
from armtrue.foreign.parts import Part, in_si, point_axis
from armtrue.io import Robot
from armtrue.io.columns import POSITION, commanded_joints
from armtrue.io.dataset import with_joints_mapped

_OWN = re.compile(
    r"\btcp|\bcart(?:esian)?\b|\brobot\b|\bcontroller\b|\bsteuerung\b|\bcmd\b|\bcommand(?:ed)?\b|"
    r"\btool ?(?:pose|pos|position|vector|frame|0)\b|\bpos(?:ition)? act\b",
    re.IGNORECASE,
)
_INSTRUMENT = re.compile(
    r"leica|laser|track|faro|\bapi\b|radian|\blt\b|smr|refl|prism|ball|meas|mess|\bcmm\b|romer|nikon|vicon|optitrack|"
    r"creaform|t.?mac|instrument|camera",
    re.IGNORECASE,
)
# Names of the controller's pose if another set is named after an instrument; else the set may be the measured one.
_ACTUAL = re.compile(r"\b(?:act|actual|ist|fb|feedback)\b", re.IGNORECASE)
_MEASURED = re.compile(r"act|meas|fb|feedback|readback|read_back|\bist\b", re.IGNORECASE)
_PERHAPS = re.compile(r"^$|\bflange\b|\btool\b|\bwrist\b|\bbase\b|\bpos\w*\b|\bact", re.IGNORECASE)
# Rounding leaves at most this many of its standard deviations; the digits of a data sheet this much per metre of reach.
_ROUNDINGS = 3.0
_DATA_SHEET = 2e-5
# A measured set has at least this many times the residual of the controller's own pose.
_LEAST_RATIO = 3.0
_ROWS = 200
# A reflector that moves less is fixed to the floor; the distance between two on one tool varies by less.
_STILL_M = 5e-3
_RIGID_M = 0.1


@dataclass(eq=False)
class _Set:
    """One set of points of a file, with the matched rows of joints and of points.

    `left_m`: RMS residual with nominal kinematics; `rounding_m`: residual that rounding explains; `data_sheet_m`: that
    which the rounding of the data sheet alone explains.
    """

    part: Part
    name: str
    joints: Rows
    points: Rows
    left_m: float = math.inf
    rounding_m: float = 0.0
    data_sheet_m: float = 0.0

    @property
    def headers(self) -> str:
        return ", ".join(self.part.meaning.points[self.name])

    @property
    def label(self) -> str:
        alone = not self.part.meaning.joints and len(self.part.meaning.points) == 1
        return self.part.sheet.path.stem if alone or not self.name else self.name

    def own_by_name(self) -> bool:
        return bool(_OWN.search(self.name)) and not _INSTRUMENT.search(self.name)


def leave_out_own_poses(parts: list[Part], arms: list[Robot]) -> None:
    """Take a controller's own points and orientations out of `parts`, with a note on each.

    `arms`: the arm in each form it may have. Errors: InputError if points lie in two frames and it cannot be decided
    which of them the instrument measured.
    """
    with_joints = [part for part in parts if part.meaning.joints]
    if len(with_joints) != 1 or not any(part.meaning.points for part in parts):
        return
    base = with_joints[0]
    sets = [found for part in parts if part.meaning.points for found in _sets(base, part)]
    spans = [np.ptp(found.part.points_m(found.name), axis=0) for found in sets]
    moving = [found for found, span in zip(sets, spans, strict=True) if np.linalg.norm(span) > _STILL_M]
    for found in moving:
        _place(found, base, arms)
    gone = _by_numbers(moving)
    for step in (_by_name, _beside_measured):
        gone |= step([found for found in moving if found not in gone])
    for part in parts:
        _choose_rotation(part, gone)
    for found, why in gone.items():
        found.part.notes.append(f"{found.headers}: not taken, as {why}")
        del found.part.meaning.points[found.name]
    left = [found for found in moving if found not in gone]
    _say_what_may_be(left, bool(gone))
    _refuse_two_frames(left, arms)


def _sets(base: Part, part: Part) -> list[_Set]:
    rows = np.arange(len(base.sheet.rows), dtype=np.int64)
    joints, points = (rows, rows) if part is base else match_rows(base, part)[:2]
    return [_Set(part, name, joints, points) for name in part.meaning.points]


def _place(found: _Set, base: Part, arms: list[Robot]) -> None:
    """Fill in the residuals of a set of points: the least that any of `arms` leaves with base and tool aligned."""
    few = evenly(found.joints.size, _ROWS)
    names = commanded_joints(base.meaning.joints)
    joints = base.meaning.joints.items()
    columns = {name: base.in_si(name, header)[found.joints[few]] for name, header in joints}
    points = found.part.points_m(found.name)[found.points[few]]
    for arm in arms:
        if not {f"q{k}" for k in arm.motors} <= set(names) or len(names) > arm.joint_count:
            continue
        still = {f"q{k}": np.zeros(few.size) for k in arm.passive}
        placed = with_joints_mapped(columns | still, arm.drives_from_reported)
        wanted = {name: np.ascontiguousarray(placed[name]) for name in {*names, *still}}
        wanted |= dict(zip(POSITION, np.ascontiguousarray(points.T), strict=True))
        try:
            left = align(wanted, arm).rms_m
        except ValueError:
            continue
        if left < found.left_m:
            found.left_m, found.data_sheet_m = left, _DATA_SHEET * arm.reach_m
            found.rounding_m = _rounding_m(found, base, arm) + found.data_sheet_m


def _rounding_m(found: _Set, base: Part, arm: Robot) -> float:
    """The largest residual that rounding of joints and points explains."""
    variance = 0.0
    for name, header in base.meaning.joints.items():
        if name.startswith("q") and name[1:].isdigit():
            slides = arm.joints[int(name[1:]) - 1]["type"] == "prismatic"
            step = _step(base, header, base.units.get(name))
            variance += (step * (1.0 if slides else arm.reach_m)) ** 2 / 12.0
    for axis, header in zip("xyz", found.part.meaning.points[found.name], strict=True):
        variance += _step(found.part, header, found.part.units[point_axis(found.name, axis)]) ** 2 / 12.0
    return _ROUNDINGS * math.sqrt(variance)


def _step(part: Part, header: str, unit: str | None) -> float:
    """The step of a column's last digit, SI; 0 if it is not known."""
    cells = part.sheet.cells(header)
    if any("e" in cell.lower() for cell in cells):
        return 0.0
    digits = max(len(cell.partition(part.sheet.decimal)[2]) for cell in cells)
    one = in_si(np.array([0.0, 10.0**-digits]), unit)
    return float(one[1] - one[0])


def _by_numbers(sets: list[_Set]) -> dict[_Set, str]:
    """The sets that follow nominal kinematics to rounding while another one does not, each with the reason in words."""
    gone: dict[_Set, str] = {}
    for found in sets:
        others = [other for other in sets if other is not found]
        far = [o for o in others if o.left_m >= max(_LEAST_RATIO * found.left_m, o.data_sheet_m)]
        if found.left_m <= found.rounding_m and far:
            other = min(far, key=lambda one: one.left_m)
            gone[found] = (
                f"they are the controller's own pose{' by their name, and' if found.own_by_name() else ': they'} "
                f"follow the nominal kinematics of the joints within {_short(found.left_m)}, which is rounding, "
                f"where {other.headers} lie {_short(other.left_m)} off"
            )
    return gone


def _by_name(sets: list[_Set]) -> dict[_Set, str]:
    """The sets named as the controller's own pose, unless all are, each with the reason in words."""
    own = [found for found in sets if found.own_by_name()]
    others = [found for found in sets if not _INSTRUMENT.search(found.name)]
    if len(others) < len(sets):
        own += [found for found in others if _ACTUAL.search(found.name)]
    if all(found in own for found in sets):
        return {}
    return {
        found: f"they are the controller's own pose by their name, though they lie {_short(found.left_m)} from the "
        "nominal kinematics of the joints"
        for found in own
    }


def _beside_measured(sets: list[_Set]) -> dict[_Set, str]:
    """Sets in a file that has others named as measured, each with the reason in words."""
    gone: dict[_Set, str] = {}
    for found in sets:
        beside = [other for other in sets if other.part is found.part and _MEASURED.search(other.name)]
        if beside and found not in beside and not _INSTRUMENT.search(found.name):
            gone[found] = f"{beside[0].headers} stand beside them, named as measured"
    return gone


def _choose_rotation(part: Part, gone: dict[_Set, str]) -> None:
    """Take the orientations of a set of points that is kept; those of a set that is left out are dropped."""
    meaning = part.meaning
    of_gone = {found.name for found in gone if found.part is part}
    taken: list[tuple[bool, list[str]]] = []
    for whose, headers in meaning.rotations.items():
        owner = _owner(part, whose, headers)
        if owner in of_gone:
            why = f"as they are the controller's own pose, of which {', '.join(meaning.points[owner])} are"
            part.notes.append(f"{', '.join(headers)}: not taken, {why}")
        else:
            taken.append((owner is None, headers))
    taken.sort(key=lambda each: each[0])
    meaning.rotation = taken[0][1] if taken else []
    for _, headers in taken[1:]:
        why = f"as the orientation is taken from {', '.join(meaning.rotation)}"
        part.notes.append(f"{', '.join(headers)}: not taken, {why}")


def _owner(part: Part, whose: str, headers: list[str]) -> str | None:
    """The set of points of these orientations: of the same name; if they have none, the set in the columns before."""
    points = part.meaning.points
    own = next((name for name in points if name.lower() == whose.lower()), None)
    if own is not None or whose:
        return own
    place = part.sheet.header.index
    before = min(map(place, headers)) - 1
    return next((name for name, axes in points.items() if max(map(place, axes)) == before), None)


def _say_what_may_be(sets: list[_Set], any_gone: bool) -> None:
    """Note which of the points that are kept may be the controller's own pose."""
    for found in sets:
        if not any_gone and found.left_m <= found.data_sheet_m:
            found.part.notes.append(
                f"{found.headers}: they follow the nominal kinematics of the joints within {_short(found.left_m)}, as "
                "a controller's own pose does and no measured arm"
            )
    perhaps = [found for found in sets if _PERHAPS.search(found.name)]
    if len(perhaps) == len(sets):
        return
    for found in perhaps:
        others = [other.label for other in sets if other is not found]
        way = "take its columns out of the file"
        if len(others) == 1:
            way = f"'rows: {{where: {{target: {others[0]}}}}}' in dataset.yaml leaves it out"
        found.part.notes.append(
            f"{found.headers}: if '{found.label}' is the controller's own pose and not a reflector, {way}"
        )


def _refuse_two_frames(sets: list[_Set], arms: list[Robot]) -> None:
    """Refuse two sets of points that both follow the arm although the distance between them varies."""
    for one, other in itertools.combinations(sets, 2):
        rows, of_one, of_other = np.intersect1d(one.joints, other.joints, return_indices=True)
        follow = arms and max(one.left_m, other.left_m) < NOMINAL_ERROR_PER_REACH * arms[0].reach_m
        if not follow or rows.size == 0:
            continue
        points = one.part.points_m(one.name)[one.points[of_one]]
        apart = points - other.part.points_m(other.name)[other.points[of_other]]
        low, high = np.percentile(np.linalg.norm(apart, axis=1), (5.0, 95.0))
        if high - low > _RIGID_M:
            raise InputError(
                f"{other.part.sheet.path} header: found points '{one.label}' and '{other.label}', whose distance "
                f"from one another is between {low:.3g} and {high:.3g} m, so that they lie in two frames, expected "
                "those of one instrument, or a name that says which are the controller's own (TCP, Cart, robot)"
            )


def _short(metres: float) -> str:
    if not math.isfinite(metres):
        return "an unknown distance"
    return f"{1e3 * metres:.2g} mm" if metres > 1e-4 else f"{1e6 * metres:.2g} µm"
