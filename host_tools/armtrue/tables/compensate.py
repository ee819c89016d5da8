"""Poses corrected by a table: with the firmware's own code, or with the inverse of the fit in double precision."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.extrapolation import duration
from armtrue.io import Dataset, Robot, load_data
from armtrue.io.files import read_json
from armtrue.tables import fixed
from armtrue.tables.fitted import FittedArm, fitted_arm
from armtrue.tables.image import Image
from armtrue.tables.reference import Reference, Surroundings, coordinates_moved

_LARGEST_FIT_BYTES = 512 * 1024 * 1024

_NEUTRAL = {
    "payload": "0 kg",
    "time": "0 s",
    "dir": "no direction (0)",
    "temp": "the reference temperature",
}
_FLAGS = (
    (fixed.MAGNITUDE_CLAMPED, "clamped to the table's largest correction"),
    (fixed.NEAR_SINGULAR, "close to a singularity, where the damping leaves part of the error"),
    (fixed.OUTSIDE_COVERAGE, "outside what some table was trained on, where that table is neutral"),
    (fixed.STATE_SATURATED, "with an input beyond the range of the format"),
)


# A row is reported if it keeps more than both of these: what a tracker can resolve, and a relevant share of its error.
_TOLD_UM = 20.0
_TOLD_SHARE = 0.05
# Rows that are computed at a time, some kilobytes each; a row takes about ten microseconds.
_CHUNK = 10_000


@dataclass(frozen=True)
class Remainder:
    """Distance of each row's tool point from the intended one [µm], corrected and uncorrected, (N,) each.

    `rows`: their numbers in the file. NaN where the fit has no value, as for the logarithm of a negative number.
    """

    rows: NDArray[np.int64]
    left_um: Array
    uncorrected_um: Array

    def words(self) -> str:
        """Rows that keep much of their error, and the farthest of them; empty where none does."""
        told = (self.left_um > _TOLD_UM) & (self.left_um > _TOLD_SHARE * self.uncorrected_um)
        count = int(told.sum())
        if not count:
            return ""
        farthest = int(np.argmax(np.where(told, self.left_um, -1.0)))
        worse = int((told & (self.left_um > self.uncorrected_um)).sum())
        than_before = (
            f"{worse} of them {'is' if worse == 1 else 'are'} farther off than uncorrected; " if worse else ""
        )
        return (
            f"{count} of {len(self.rows)} rows keep more than {_TOLD_UM:g} µm and {100 * _TOLD_SHARE:g} % of their "
            f"error, by the fit: at most {self.left_um[farthest]:.1f} µm of {self.uncorrected_um[farthest]:.1f} µm, "
            f"in row {self.rows[farthest]}; {than_before}all rows {np.nanmean(self.left_um):.1f} µm on average"
        )

    def figures(self) -> dict[str, Any]:
        """Mean, largest with its row, and every row in the order of the file; None where the fit has no value."""
        known = np.flatnonzero(np.isfinite(self.left_um))
        largest = int(known[np.argmax(self.left_um[known])]) if known.size else None
        rows = _rounded(self.left_um)
        return {
            "mean_um": round(float(self.left_um[known].mean()), 3) if known.size else None,
            "max_um": None if largest is None else rows[largest],
            "max_row": None if largest is None else int(self.rows[largest]),
            "rows_um": rows,
            "uncorrected_rows_um": _rounded(self.uncorrected_um),
        }


def remainder(
    arm: FittedArm,
    rows: NDArray[np.int64],
    commands: tuple[Array, Array],
    around: Surroundings,
    tool: NDArray[np.uint8],
) -> Remainder:
    """`commands`: requested and corrected motor-side joints, (N, n) each. `tool`: number of each row's tool."""
    asked, corrected = commands
    left_um, uncorrected_um = np.empty(len(asked)), np.empty(len(asked))
    for number, name in enumerate(arm.flange_from_tool):
        reference = Reference(arm, name)
        for first in range(0, len(asked), _CHUNK):
            chunk = np.zeros(len(asked), dtype=np.bool_)
            chunk[first : first + _CHUNK] = tool[first : first + _CHUNK] == number
            if chunk.any():
                here = around.of(chunk)
                left_um[chunk] = 1e6 * reference.distances(corrected[chunk], asked[chunk], here)
                uncorrected_um[chunk] = 1e6 * reference.distances(asked[chunk], asked[chunk], here)
    return Remainder(rows, left_um, uncorrected_um)


def _rounded(values: Array) -> list[float | None]:
    """Rounded to nanometres, for JSON; None where not finite."""
    return [round(value, 3) if np.isfinite(value) else None for value in values.tolist()]


class Engine(StrEnum):
    """What computes the correction."""

    FIXED = "fixed"  # the firmware's own code
    DOUBLE = "double"  # the fitted model's inverse, with loads as a device takes them (decision 0068)


@dataclass(frozen=True)
class Compensated:
    """Corrected joints (N, n) [rad or m], intended points (N, 3) [m] in the measuring frame, and notes for people.

    `beyond` (N, n): mask of the corrected joints outside the arm's limits, as far as these are known; `sent_beyond`
    (N, n): the same of the commands. `passive`: number of a joint without a motor → its column as commanded, which is
    never corrected, None where the poses have none. `remainder`: distance of each row from its point; None without the
    fit.
    """

    joints: Array
    intended: Array
    beyond: NDArray[np.bool_]
    sent_beyond: NDArray[np.bool_]
    notes: list[str] = field(default_factory=list)
    remainder: Remainder | None = None
    passive: dict[int, Array | None] = field(default_factory=dict)

    def columns(self) -> dict[str, Array]:
        """`q1…qn` to send: corrected; those of passive joints as commanded."""
        each = {k: self.passive.get(k, self.joints[:, k - 1]) for k in range(1, self.joints.shape[1] + 1)}
        return {f"q{k}": values for k, values in each.items() if values is not None}

    def limits_words(self) -> str:
        """Rows whose corrected joints leave the limits, and which joints; empty where none does."""
        rows = int(self.beyond.any(axis=1).sum())
        if not rows:
            return ""
        each = [
            f"joint {k + 1} in {count}" for k, count in enumerate(self.beyond.sum(axis=0).tolist()) if count
        ]
        already = int((self.beyond & self.sent_beyond).any(axis=1).sum())
        sent = f", {already} of them as commanded" if already else ""
        return f"{rows} of {len(self.beyond)} rows leave the joint limits when corrected ({', '.join(each)}{sent})"


def sidecar(tables: Path) -> Path:
    """Path of the copy of a table's fit that export writes, for the double engine."""
    return Path(f"{tables}.fit.json")


def compensate(
    tables: Path,
    poses: Path,
    engine: Engine = Engine.FIXED,
    fit: Path | None = None,
    quantise: bool = False,
) -> Compensated:
    """Correct the commands in `poses` with the table in `tables`.

    `fit`: the fit that the table was made from; default: the copy that export left beside it. The double engine needs
    it; the fixed one corrects without, but then the remaining error is unknown. `quantise`: round the corrections to
    the drives' increments. Columns that `poses` lacks take neutral values, and a note says so. Errors: InputError.
    """
    image = Image.load(tables)
    document: dict[str, Any] = {}
    arm: FittedArm | None = None
    try:
        document, arm = _made_from(tables, fit, image)
    except (InputError, ValueError, RecursionError, AttributeError, KeyError, TypeError):
        if engine is Engine.DOUBLE:
            raise
    robot = _robot_of(image, document)
    data = load_data(poses, robot, need_position=False)
    joints = data.joints
    clock = _Clock.of(document)
    around, notes = _surroundings(image, data, clock)
    tool = _tool_numbers(image, data)
    if engine is Engine.DOUBLE and arm is not None:
        corrected, more = _double(image, arm, joints, around, tool)
    else:
        corrected, more = _fixed(image, joints, around, tool)
    notes += more
    if quantise:
        per_unit = np.array([joint.increments for joint in image.joints()])
        corrected = joints + np.round((corrected - joints) * per_unit) / per_unit
    kept = None if arm is None else remainder(arm, data.rows, (joints, corrected), around, tool)
    if engine is Engine.FIXED:  # the double engine notes the remaining error itself
        unknown = (
            f"how far rows stay from their points is not known: {sidecar(tables).name if fit is None else fit} is not "
            f"the fit that {tables.name} was made from; --fit names another file"
        )
        words = unknown if kept is None else kept.words()
        notes += [words] if words else []
    # Nominal kinematics, with the fitted base and each row's fitted tool.
    last_from_tool = np.stack(list(image.tools().values()))[tool]
    intended = (image.measuring_from_base() @ image.chain().frames(joints)[-1] @ last_from_tool)[:, :3, 3]
    limits = _limits(document, image)
    reported_from_drives = np.linalg.inv(robot.drives_from_reported)
    reported = corrected @ reported_from_drives.T
    return Compensated(
        reported,
        intended,
        _is_beyond(reported, limits),
        _is_beyond(joints @ reported_from_drives.T, limits),
        notes,
        kept,
        {k: data.passive.get(f"q{k}") for k in robot.passive},
    )


def _is_beyond(joints: Array, limits: Array) -> NDArray[np.bool_]:
    return np.asarray((joints < limits[:, 0]) | (joints > limits[:, 1]))


def _made_from(tables: Path, fit: Path | None, image: Image) -> tuple[dict[str, Any], FittedArm]:
    """The fit that a table was made from. Errors: InputError where it is missing, no fit or another one."""
    place = sidecar(tables) if fit is None else fit
    if fit is None and not place.is_file():
        raise InputError(
            f"{place}: found no such file, expected the fit that {tables.name} was made from; give it with --fit"
        )
    document = read_json(place, _LARGEST_FIT_BYTES, "a fit.json")
    if not isinstance(document, dict):
        raise InputError(f"{place}: found no fit, expected a fit.json")
    arm = fitted_arm(document, place)
    if arm.digest != image.header["fit_digest"]:
        raise InputError(f"{place}: found another fit than the one that {tables} was made from")
    return document, arm


def _limits(document: dict[str, Any], image: Image) -> Array:
    """Joint limits (n, 2) [rad or m] of the fit that a table was made from; infinite where it has none.

    An image has none: the firmware leaves them to controller and drives.
    """
    limits = np.tile([-np.inf, np.inf], (image.joint_count, 1))
    for k, row in enumerate(document["robot"]["kinematics"]["joints"] if document else []):
        if not row.get("passive"):
            limits[k] = row.get("limits") or limits[k]
    return limits


def _fixed(
    image: Image, joints: Array, around: Surroundings, tool: NDArray[np.uint8]
) -> tuple[Array, list[str]]:
    result = fixed.FixedEngine(image.bytes, image.chain()).solve(joints, around, tool)
    notes = []
    for flag, words in _FLAGS:
        count = int(np.count_nonzero(result.flags & flag))
        if not count:
            continue
        if flag == fixed.NEAR_SINGULAR and (too_few := _too_few_axes(image)):
            words = f"keep part of the error, as {too_few}"
        notes.append(f"{count} of {len(joints)} poses {words}")
    return result.joints, notes


def _too_few_axes(image: Image) -> str:
    """How many coordinates of the tool's pose the arm can set, in words; empty where it can set all that it should."""
    wanted = 3 if image.rotation_length_m is None else 6
    last_from_tool = list(image.tools().values())[image.header["active_tool"]]
    moved = coordinates_moved(image.chain(), last_from_tool, image.rotation_length_m)
    if moved >= wanted:
        return ""
    what = "the tool's position" if wanted == 3 else "the tool's position and attitude"
    axes = image.joint_count - len(image.chain().passive)
    have = "axis sets" if axes == 1 else "axes set"
    return f"the arm's {axes} {have} only {moved} of the {wanted} coordinates of {what}"


def _double(
    image: Image, arm: FittedArm, joints: Array, around: Surroundings, tool: NDArray[np.uint8]
) -> tuple[Array, list[str]]:
    corrected = np.empty_like(joints)
    left = np.zeros((len(joints), 2))
    is_reached = np.ones(len(joints), dtype=np.bool_)
    for number, name in enumerate(image.tools()):
        rows = tool == number
        if rows.any():
            found = Reference(arm, name).solve(joints[rows], around.of(rows), image.rotation_length_m)
            corrected[rows], is_reached[rows] = found.joints, found.is_reached
            left[rows] = np.column_stack([found.position_m, found.attitude_rad])
    count = int(np.count_nonzero(~is_reached))
    if not count:
        return corrected, []
    position, attitude = 1e6 * left[~is_reached].max(axis=0)
    turned = "" if image.rotation_length_m is None else f" and {attitude:.1f} µrad"
    words = f"up to {position:.1f} µm{turned}"
    why = _too_few_axes(image) or "they are close to a singularity or at the end of the reach"
    return corrected, [f"{count} of {len(joints)} poses do not reach their target, {words} are left: {why}"]


def _robot_of(image: Image, document: dict[str, Any]) -> Robot:
    """The part of robot.yaml that is needed to read poses; couplings by the controller are known only from the fit."""
    joints = [
        {
            "name": str(k + 1),
            "type": "prismatic" if joint.prismatic else "revolute",
            "xyz": [float(v) for v in joint.fixed[:3, 3]],
            "passive": joint.passive,
        }
        for k, joint in enumerate(image.joints())
    ]
    coupled = image.chain().coupling
    mechanical = [
        {"joint": int(driven) + 1, "driving": int(driving) + 1, "ratio": float(coupled[driven, driving])}
        for driven, driving in np.argwhere(coupled - np.eye(len(joints)))
    ]
    reported = document["robot"].get("coupling", []) if document else []
    return Robot(
        {
            "name": image.serial,
            "kinematics": {"convention": "chain", "joints": joints},
            "temperature": {"sensors": list(image.sensors())},
            "coupling": [*mechanical, *(row for row in reported if row.get("kind") == "controller")],
        }
    )


@dataclass(frozen=True)
class _Clock:
    """The clock of the measurements that a table was fitted to [s]; None where the fit is missing or has no time.

    `first`: time of the first of them, from which the table's own time counts. `last`: time of the last.
    """

    first: float | None
    last: float | None = None

    @staticmethod
    def of(document: dict[str, Any]) -> _Clock:
        """The clock of the fit in `document`, as predict reads it: without an origin it begins at 0."""
        if not document:
            return _Clock(None)
        try:
            last = float(document["data"]["ranges"]["time"][1])
        except (KeyError, IndexError, TypeError, ValueError):  # fits by older versions have no ranges
            last = None
        return _Clock(float(document.get("time_origin_s", 0.0)), last)

    def notes(self, times: Array, file: str) -> list[str]:
        """How `times` of POSES are read, and how many of them are outside the fitted session."""
        first = self.first or 0.0
        found = []
        if self.first is None:
            found.append(
                f"{file} has time, and the table does not know when its first fitted measurement was: time is read as "
                "seconds since then; with the fit (--fit), it is read on the clock of the fitted measurements"
            )
        if before := _outside(first - times, "before the first fitted measurement"):
            clock = "" if self.first is None else ", on the clock of the fitted measurements"
            found.append(f"{before}{clock}: corrected as at that measurement")
        if self.last is not None and (
            after := _outside(times - self.last, "after the last fitted measurement")
        ):
            found.append(f"{after}: corrections there are extrapolated")
        return found


def _outside(by: Array, where: str) -> str:
    """How many rows are outside the session, and by how much at most; `by` [s] is positive there. Empty for none."""
    count = int(np.count_nonzero(by > 0.0))
    if not count:
        return ""
    return f"{count} of {len(by)} poses {'is' if count == 1 else 'are'} up to {duration(by.max())} {where} by time"


def _surroundings(image: Image, data: Dataset, clock: _Clock) -> tuple[Surroundings, list[str]]:
    columns = data.columns
    missing: dict[str, list[str]] = {}  # by kind
    for name in sorted(image.needs() - columns.keys()):
        missing.setdefault(name.split("_")[0].rstrip("0123456789"), []).append(name)
    notes = [
        f"{data.path.name} has no {', '.join(group)}: {_NEUTRAL[kind]} is taken"
        for kind, group in missing.items()
    ]
    names = [f"dir{k + 1}" for k in range(image.joint_count)]
    direction = None
    if columns.keys() & names:
        direction = np.column_stack([columns.get(name, np.zeros(data.count)) for name in names])
    times = columns.get("time") if "time" in image.needs() else None
    if times is not None:
        notes += clock.notes(times, data.path.name)
    around = Surroundings(
        {name: columns[f"temp_{name}"] for name in image.sensors() if f"temp_{name}" in columns},
        columns.get("payload"),
        # A device's time begins at 0, at the first fitted measurement.
        None if times is None else np.maximum(times - (clock.first or 0.0), 0.0),
        direction,
    )
    return around, notes


def _tool_numbers(image: Image, data: Dataset) -> NDArray[np.uint8]:
    names = list(image.tools())
    if "target" not in data.columns or len(names) == 1:
        return np.full(data.count, image.header["active_tool"], dtype=np.uint8)
    return data.reflectors_among(names, "the table's").astype(np.uint8)
