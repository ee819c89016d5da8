"""Fast fit of geometry alone, without starting values, in milliseconds: base, tools, zeros and links."""

from __future__ import annotations

import numpy as np

from armtrue.arrays import Array, rigid_motion, rms_length
from armtrue.checking.alignment import Columns, align, thinned
from armtrue.checking.residuals import gross_limit_m
from armtrue.checking.scatter.repeats import numbered, set_up_of_row
from armtrue.io.columns import POSITION, commanded_joints
from armtrue.io.robot import Robot
from armtrue.io.rotation import matrix_from_rotation_vector
from armtrue.tables.chain import chain_from_robot, pose, transform

_PASSES = 4
# Combinations of coordinates with a singular value below this share of the largest stay at their nominal value.
_LEAST_SEEN = 1e-3
# Number of rows of the first alignment of base and tools.
_ROWS_ALIGNED = 120
# A set-up with fewer rows starts from the base of the alignment.
_FEWEST_OF_SET_UP = 4
# Largest plausible deviation of links and zeros from nominal: shifts as a share of the reach, turns [rad].
_PLAUSIBLE_SHARE = 0.1
_PLAUSIBLE_TURN = 0.2
# Largest RMS residual if geometry explains the points: [m per metre of reach], and as a share of the nominal residual.
_EXPLAINED_PER_REACH = 0.002
_EXPLAINED_SHARE = 0.25
_EQUATIONS_PER_UNKNOWN = 3.0


class Geometry:
    """An arm whose geometry is fitted to points, N rows, by Gauss-Newton from nominal values.

    `nominal_m` (N, 3): measured minus predicted with nominal kinematics. `residual_m` (N, 3): with geometry fitted.
    `span` (3N, r): orthonormal basis of the changes that geometry can make. `follows` (N,): rows without gross error.
    `frames`: measuring_from_frame (N, 4, 4) of the base and after each joint; `flange`: of the flange.
    `points` (N, 3): predicted positions. `bases`: one of each set-up. `tool` (N,): the number of each row's tool.
    `largest_turn` [rad], `largest_shift_m`: largest corrections of zeros and links.
    """

    def __init__(self, columns: Columns, robot: Robot) -> None:
        """Fit `columns` (q1…qn, x, y, z, and target, station, nest if present).

        Errors: ValueError if there are too few rows to align.
        """
        self.chain = chain_from_robot(robot.spec)
        self.reach_m = robot.reach_m
        self._measured = np.column_stack([columns[name] for name in POSITION])
        joints = np.column_stack([columns[name] for name in commanded_joints(columns)])
        link = self.chain.link_variables(joints)
        self._turned = [self.chain.joint_transforms(k, link[:, k]) for k in range(self.chain.joint_count)]
        # The frame after each joint has a correction in six coordinates.
        self._corrections = [np.eye(4) for _ in range(self.chain.joint_count)]
        count = len(joints)
        self._set_up = set_up_of_row(columns)
        seat = [columns[name] for name in ("target", "nest") if name in columns]
        self.tool = numbered(np.zeros(count), *seat)
        known = {name: values for name, values in columns.items() if name != "nest"}
        found = align(thinned(known, _ROWS_ALIGNED), robot)
        self.bases = [pose(dict(found.measuring_from_base))] * (int(self._set_up.max()) + 1)
        first = next(iter(found.flange_from_tool.values()))
        targets = columns.get("target", np.zeros(count)).astype(np.int64)
        codes = [str(targets[self.tool == number][0]) for number in range(int(self.tool.max()) + 1)]
        self._tools = np.array([found.flange_from_tool.get(code, first)["xyz"] for code in codes])
        self._place()
        if len(self.bases) > 1:
            self._place_set_ups()
        self.nominal_m = self.residual_m
        for _ in range(_PASSES):
            self._step()
        self.span = self._decomposed()[0]
        cosines = [(np.trace(one[:3, :3]) - 1.0) / 2.0 for one in self._corrections]
        self.largest_turn = max(float(np.arccos(np.clip(cosine, -1.0, 1.0))) for cosine in cosines)
        self.largest_shift_m = max(float(np.linalg.norm(one[:3, 3])) for one in self._corrections)

    @property
    def nominal_rms_m(self) -> float:
        """RMS distance with nominal kinematics, without gross errors."""
        return rms_length(self.nominal_m[self.follows])

    @property
    def rms_m(self) -> float:
        """RMS distance with geometry fitted, without gross errors."""
        return rms_length(self.residual_m[self.follows])

    @property
    def explains(self) -> bool:
        """True if a plausible deviation from nominal geometry explains the points."""
        rows = int(self.follows.sum())
        return bool(
            3 * rows >= _EQUATIONS_PER_UNKNOWN * self.span.shape[1]
            and rows > 0.9 * len(self.follows)
            and self.rms_m <= min(_EXPLAINED_PER_REACH * self.reach_m, _EXPLAINED_SHARE * self.nominal_rms_m)
            and self.largest_turn <= _PLAUSIBLE_TURN
            and self.largest_shift_m <= _PLAUSIBLE_SHARE * self.reach_m
        )

    def _place(self) -> None:
        current = np.stack(self.bases)[self._set_up]
        self.frames = [current]
        for fixed, turned, corrected in zip(self.chain.fixed, self._turned, self._corrections, strict=True):
            current = current @ fixed @ turned @ corrected
            self.frames.append(current)
        self.flange = current @ self.chain.end
        offset = self.flange[:, :3, :3] @ self._tools[self.tool][:, :, None]
        self.points = offset[:, :, 0] + self.flange[:, :3, 3]
        self.residual_m = np.asarray(self._measured - self.points)
        distance = np.linalg.norm(self.residual_m, axis=1)
        self.follows = np.asarray(distance <= gross_limit_m(distance))

    def _place_set_ups(self) -> None:
        """Give each set-up the frame that brings its own points onto the arm."""
        base = self.bases[0]
        for number in range(len(self.bases)):
            rows = self._set_up == number
            if rows.sum() >= _FEWEST_OF_SET_UP:
                self.bases[number] = rigid_motion(self.points[rows], self._measured[rows]) @ base
        self._place()

    def _decomposed(self) -> tuple[Array, Array, Array]:
        """Left vectors (3N, r), singular values (r,) and right vectors (r, p) of the weighted design matrix."""
        count = len(self._measured)
        by_base, *moved = (moved_by(frame, self.points, self.reach_m) for frame in self.frames)
        set_ups = [self._set_up == number for number in range(len(self.bases))]
        moved = [*(np.where(rows[:, None, None], by_base, 0.0) for rows in set_ups), *moved]
        axes = self.flange[:, :3, :3].transpose(0, 2, 1)
        moved += [
            np.where((self.tool == number)[:, None, None], axes, 0.0) for number in range(len(self._tools))
        ]
        design = np.concatenate(moved, axis=1).transpose(0, 2, 1).reshape(3 * count, -1)
        return seen_part(design * self._weight(), _LEAST_SEEN)

    def _step(self) -> None:
        """One Gauss-Newton step."""
        left, values, right = self._decomposed()
        step = right.T @ ((left.T @ (self.residual_m.ravel() * self._weight()[:, 0])) / values)
        moved = [*self.bases, *self._corrections]
        sixes, tools = step[: 6 * len(moved)].reshape(-1, 6), step[6 * len(moved) :]
        turns = matrix_from_rotation_vector(sixes[:, 3:] / self.reach_m)
        moved = [one @ transform(six[:3], turn) for one, six, turn in zip(moved, sixes, turns, strict=True)]
        self.bases, self._corrections = moved[: len(self.bases)], moved[len(self.bases) :]
        self._tools = self._tools + tools.reshape(-1, 3)
        self._place()

    def _weight(self) -> Array:
        return np.repeat(self.follows.astype(np.float64), 3)[:, None]


def seen_part(design: Array, least: float) -> tuple[Array, Array, Array]:
    """The singular value decomposition of `design` (N, p) without values below `least` of the largest.

    Computed from the p x p normal matrix, a tenth of the work for a tall design; `least` should stay above 1e-6.
    """
    squares, right = np.linalg.eigh(design.T @ design)
    seen = squares > least**2 * squares[-1]
    values = np.sqrt(squares[seen])
    return design @ right[:, seen] / values, values, right[:, seen].T


def moved_by(frame: Array, points: Array, reach_m: float) -> Array:
    """Shifts (N, 6, 3) of `points` (N, 3) by the coordinates of `frame` (N, 4, 4), turns in metres at full reach."""
    axes = frame[:, :3, :3].transpose(0, 2, 1)
    arm = (points - frame[:, :3, 3])[:, None, :]
    return np.concatenate([axes, np.cross(axes, arm) / reach_m], axis=1)
