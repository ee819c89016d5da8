"""The fitted model and its inverse in double precision: the reference for the fixed-point engine.

docs/model.md gives every formula. Vectorised over poses with NumPy; shares no code with the fitter or the firmware.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.io.rotation import matrix_from_rotation_vector
from armtrue.tables import expression, layout
from armtrue.tables.chain import Chain
from armtrue.tables.fitted import FittedArm
from armtrue.tables.gravity_sets import PAYLOAD, Reading, gravity_variable, masses_of
from armtrue.tables.layout import COMPONENTS, State

# The inverse stops at steps below this [rad, m]; away from singularities it needs four.
_CONVERGED_M = 1e-13
# Most steps: near singularities many are refused and tried again with more damping.
_MOST_STEPS = 100
_MOST_NEWTON_STEPS = 30
# Least damping [m/rad]: it shortens a step by 1e-6 where the smallest singular value is 0.1 m/rad.
_DAMPING = 1e-4
# The damping of a pose is multiplied by this with every refused step, and divided with every accepted one.
_DAMPING_FACTOR = 4.0
# Number of postures at which the rank of the Jacobian is computed, and its tolerance per metre of reach [1/rad].
_POSTURES = 50
_MOVES = 1e-6
# A pose whose error is above this [m] does not reach its target: a hundredth of what an instrument can resolve.
_REACHED_M = 1e-7


@dataclass(frozen=True)
class Surroundings:
    """The inputs of the terms besides the joints, each (N,) or (N, n); None where not recorded."""

    temperature: Mapping[str, Array]  # sensor → °C
    payload: Array | None = None  # kg
    time: Array | None = None  # s
    direction: Array | None = None  # (N, n)

    def of(self, rows: NDArray[np.bool_]) -> Surroundings:
        """The inputs of the masked rows."""
        return Surroundings(
            {sensor: column[rows] for sensor, column in self.temperature.items()},
            *(
                None if column is None else column[rows]
                for column in (self.payload, self.time, self.direction)
            ),
        )


@dataclass(frozen=True)
class Standing:
    """Where loads act: frames 1…n in the robot base, (N, 4, 4) each, and the payload's position in the last, (N, 3)."""

    frames: list[Array]
    payload: Array

    def of(self, rows: NDArray[np.bool_]) -> Standing:
        """The same of the masked rows."""
        return Standing([frame[rows] for frame in self.frames], self.payload[rows])


@dataclass(frozen=True)
class Solved:
    """Result of the inverse: motor-side joints (N, n), and the remaining error of the tool, (N,) each.

    `attitude_rad` is zero where only the position is corrected.
    """

    joints: Array
    position_m: Array
    attitude_rad: Array
    is_reached: NDArray[np.bool_]


class Reference:
    """Forward model and inverse of a fitted arm for one tool."""

    def __init__(self, arm: FittedArm, tool: str) -> None:
        self.arm = arm
        self.chain = arm.chain
        self.flange_from_tool = arm.flange_from_tool[tool]
        self._tool = tool
        self._trees = {
            coordinate: [(expression.parse(text), c) for text, c in basis.items()]
            for coordinate, basis in arm.terms.items()
        }
        self._variables = arm.variables()

    def at_nominal(self, motor: Array) -> Standing:
        """Where loads act on the nominal arm at motor-side joints (N, n)."""
        point = np.tile(self.arm.payload_in_last_link(), (motor.shape[0], 1))
        return Standing(self.chain.frames(motor), point)

    def state(self, motor: Array, around: Surroundings, standing: Standing | None = None) -> dict[str, Array]:
        """Columns of every state variable that the exported terms read, at motor-side joints (N, n).

        `standing`: where loads act; default the nominal arm at `motor`.
        """
        chain = self.chain
        rows = motor.shape[0]
        zero = np.zeros(rows)
        columns: dict[str, Array] = {}
        link = chain.link_variables(motor)
        for k in range(chain.joint_count):
            columns[f"q{k + 1}"] = motor[:, k]
            columns[f"th{k + 1}"] = link[:, k]
            columns[f"dir{k + 1}"] = zero if around.direction is None else around.direction[:, k]
        columns["payload"] = zero if around.payload is None else around.payload
        columns["time"] = zero if around.time is None else around.time
        for sensor in chain.sensors:
            known = around.temperature.get(sensor)
            columns[f"dT_{sensor}"] = zero if known is None else known - chain.temperature_reference
        if chain.sensors:
            columns["dT"] = columns[f"dT_{chain.sensors[0]}"]
        gravity = {name for name in self._variables if name not in columns}
        if gravity:
            self._add_gravity(columns, gravity, standing or self.at_nominal(motor))
        return columns

    def coordinates(self, columns: dict[str, Array]) -> dict[str, Array]:
        """Every coordinate that has a term, as columns (N,), rad or m."""
        shape = columns["q1"].shape
        result: dict[str, Array] = {}
        for coordinate, terms in self._trees.items():
            total = np.zeros(shape)
            for tree, coefficient in terms:
                total = total + coefficient * expression.evaluate(tree, columns)
            result[coordinate] = total
        for grid in self.arm.grids:
            result[grid.coordinate] = result.get(grid.coordinate, 0.0) + grid.evaluate(columns)
        return result

    def real(
        self, motor: Array, around: Surroundings, standing: Standing | None = None
    ) -> tuple[Array, Array]:
        """Real base_from_tool (N, 4, 4) and its Jacobian (N, 6, n) by the motor-side joints."""
        coordinates = self.coordinates(self.state(motor, around, standing))
        return self._propagate(motor, coordinates)

    def nominal(self, motor: Array) -> Array:
        """Nominal base_from_tool (N, 4, 4) with the fitted tool."""
        return self.chain.tool_poses(motor, self.flange_from_tool)

    def solve(self, target: Array, around: Surroundings, rotation_length_m: float | None = None) -> Solved:
        """Motor-side joints (N, n) at which the real tool is where nominal kinematics puts it for `target`.

        Motor-side deflections are subtracted directly, the rest by least-norm steps, iterated to convergence. Loads are
        those of the nominal arm at `target`, where the corrected arm stands, or at the commanded joints if so fitted.
        `rotation_length_m`: length weighted as one radian if the full pose is corrected; None: position only.

        Near singularities the linear model of a step holds for short steps only (Levenberg-Marquardt): a step that
        does not lower the error, or leads further than any table may correct, is tried again with more damping. No
        pose ends with a larger error than without correction.
        """
        # The largest distance of each joint from the start of the steps [rad, m]: what a table may correct at most.
        farthest = np.where(
            self.chain.prismatic, layout.MAX_DELTA[True], 2.0 * np.pi * layout.MAX_DELTA[False]
        )
        wanted, standing = self.nominal(target), self.at_nominal(target)
        coordinates = self.coordinates(self.state(target, around, standing))
        start = target - self._taken_off(coordinates, target.shape)

        def seen(
            joints: Array, rows: NDArray[np.bool_], given: dict[str, Array] | None = None
        ) -> tuple[Array, Array]:
            """Error and Jacobian of `rows` at `joints`, with the coordinates there, or with those `given`."""
            if given is None:
                loads = self._loads(joints, standing.of(rows))
                pose, jacobian = self.real(joints, around.of(rows), loads)
            else:
                pose, jacobian = self._propagate(joints, given)
            return _error(wanted[rows], pose, rotation_length_m), _weighed(jacobian, rotation_length_m)

        active = np.ones(len(target), dtype=np.bool_)
        uncorrected, _ = seen(target, active, coordinates)
        corrected = start.copy()
        error, slope = seen(start, active)
        damping = np.full(len(target), _DAMPING)
        # The first step takes the coordinates at the target, as the firmware does: a redundant arm reaches the point
        # with many joint angles, and the steps decide which of them are found.
        step = _damped_step(*seen(start, active, coordinates), damping)
        for count in range(_MOST_STEPS):
            tried = corrected[active] + step
            found, found_slope = seen(tried, active)
            is_near = (np.abs(tried - start[active]) <= farthest).all(axis=1)
            if count == 0:
                # Coordinates at the target differ a little from those at the start, so the first step may raise an
                # error that was already small there.
                is_done = np.zeros(len(tried), dtype=np.bool_)
                is_better = (_norm(found) <= np.maximum(_norm(error), _norm(uncorrected))) & is_near
            else:
                is_done = np.abs(step).max(axis=1, initial=0.0) < _CONVERGED_M
                is_better = (_norm(found) < _norm(error[active])) & is_near
            taken = np.flatnonzero(active)[is_better]
            corrected[taken], error[taken], slope[taken] = (
                tried[is_better], found[is_better], found_slope[is_better],
            )  # fmt: skip
            damping[active] = np.where(
                is_better,
                np.maximum(_DAMPING, damping[active] / _DAMPING_FACTOR),
                damping[active] * _DAMPING_FACTOR,
            )
            active[active] = ~is_done
            if not active.any():
                break
            step = _damped_step(error[active], slope[active], damping[active])
        is_worse = _norm(error) > _norm(uncorrected)
        corrected[is_worse], error[is_worse] = target[is_worse], uncorrected[is_worse]
        return Solved(
            corrected,
            _norm(error[:, :3]),
            _norm(error[:, 3:]) / (rotation_length_m or 1.0),
            _norm(error) <= _REACHED_M,
        )

    def newton_joints(
        self, target: Array, around: Surroundings, rotation_length_m: float | None = None
    ) -> Array:
        """As `solve`, by Newton's method with unbounded steps: only for the limits of an export.

        Away from singularities the result is the same. Near them it diverges, which makes an export's limits generous:
        with the bounded steps of `solve` they would be a third tighter on some arms, and a device would clamp more.
        """
        wanted, standing = self.nominal(target), self.at_nominal(target)
        coordinates = self.coordinates(self.state(target, around, standing))
        joints = target - self._taken_off(coordinates, target.shape)
        pose, jacobian = self._propagate(joints, coordinates)
        damping = np.full(len(target), _DAMPING)
        for count in range(_MOST_NEWTON_STEPS + 1):
            step = _damped_step(
                _error(wanted, pose, rotation_length_m), _weighed(jacobian, rotation_length_m), damping
            )
            joints = joints + step
            # The first step takes the coordinates at the target and may be zero where the error is not.
            if count and np.abs(step).max(initial=0.0) < _CONVERGED_M:
                break
            pose, jacobian = self.real(joints, around, self._loads(joints, standing))
        return joints

    def distances(self, joints: Array, target: Array, around: Surroundings) -> Array:
        """Distance (N,) [m] of the real tool point at `joints` from the nominal at `target`; loads as in `solve`."""
        with np.errstate(all="ignore"):
            pose, _ = self.real(joints, around, self._loads(joints, self.at_nominal(target)))
        return _norm(pose[:, :3, 3] - self.nominal(target)[:, :3, 3])

    def _loads(self, joints: Array, at_target: Standing) -> Standing:
        """Where the loads of `joints` act: at the commanded joints if so fitted, else at the corrected arm."""
        return self.at_nominal(joints) if self.arm.loads_act_at_command else at_target

    def _motor_deflection(self, coordinates: dict[str, Array], shape: tuple[int, ...]) -> Array:
        result = np.zeros(shape)
        for k in range(shape[1]):
            result[:, k] = coordinates.get(f"motor{k + 1}", 0.0)
        return result

    def _taken_off(self, coordinates: dict[str, Array], shape: tuple[int, ...]) -> Array:
        """The part of the motor sides' deflection that motors can correct."""
        result = self._motor_deflection(coordinates, shape)
        result[:, list(self.chain.passive)] = 0.0
        return result

    def _virtual_joint(self, coordinates: dict[str, Array], frame: str, rows: int) -> Array | None:
        """V of a frame, (N, 4, 4), or None where no term acts on it."""
        names = [f"{frame}.{component}" for component in COMPONENTS]
        if not any(name in coordinates for name in names):
            return None
        value = np.stack([np.broadcast_to(coordinates.get(name, 0.0), rows) for name in names], axis=1)
        result = np.tile(np.eye(4), (rows, 1, 1))
        result[:, :3, 3] = value[:, :3]
        result[:, :3, :3] = matrix_from_rotation_vector(value[:, 3:])
        return result

    def _propagate(self, motor: Array, coordinates: dict[str, Array]) -> tuple[Array, Array]:
        frames, current = self._frames(motor, coordinates)
        current = current @ self.chain.end @ self.flange_from_tool
        for name in ("tool", f"tool[{self._tool}]"):
            virtual = self._virtual_joint(coordinates, name, motor.shape[0])
            current = current if virtual is None else current @ virtual
        return current, tool_jacobian(self.chain, frames, current[:, :3, 3])

    def _frames(self, motor: Array, coordinates: dict[str, Array]) -> tuple[list[Array], Array]:
        """Frames 1…n before their virtual joints, and the last one's end."""
        chain = self.chain
        rows = motor.shape[0]
        link = chain.link_variables(motor + self._motor_deflection(coordinates, motor.shape))
        current = np.tile(np.eye(4), (rows, 1, 1))
        frames = []
        base = self._virtual_joint(coordinates, "base", rows)
        current = current if base is None else current @ base
        for k in range(chain.joint_count):
            current = current @ chain.fixed[k] @ chain.joint_transforms(k, link[:, k])
            frames.append(current)
            virtual = self._virtual_joint(coordinates, f"link{k + 1}", rows)
            current = current if virtual is None else current @ virtual
        return frames, current

    def _add_gravity(self, columns: dict[str, Array], names: set[str], standing: Standing) -> None:
        known: dict[tuple[int, str] | None, tuple[Array, Array]] = {}

        def caused_by(unit: tuple[int, str] | None, reading: Reading) -> Array:
            if unit not in known:
                own = masses_of(unit, self.chain, np.zeros(3))
                moments = np.tile(own.moments, (len(standing.payload), 1, 1))
                if unit == PAYLOAD:
                    moments[:, -1] = standing.payload
                known[unit] = gravity_moments(self.chain.gravity, standing.frames, own.masses, moments)
            return self._gravity_of(known[unit], standing.frames, reading)

        for name in names:
            variable = gravity_variable(name)
            if variable is None or (variable.unit is None and self.chain.masses is None):
                continue
            columns[name] = caused_by(variable.unit, variable.reading)
            if variable.unit is None:
                columns[name] = columns[name] + columns["payload"] * caused_by(PAYLOAD, variable.reading)

    def _gravity_of(self, moments: tuple[Array, Array], frames: list[Array], reading: Reading) -> Array:
        about_origin, force = moments
        axis = 0 if reading.kind in (State.BASE_MOMENT_X, State.MOMENT_X) else 1
        if reading.kind in (State.BASE_MOMENT_X, State.BASE_MOMENT_Y):
            at_base = about_origin[:, 0] + np.cross(frames[0][:, :3, 3], force[:, 0])
            return np.asarray(at_base[:, axis])
        if reading.kind is not State.TORQUE:
            return np.asarray(
                np.einsum("ni,ni->n", frames[reading.joint][:, :3, axis], about_origin[:, reading.joint])
            )
        total = np.zeros(force.shape[0])
        for k, ratio in enumerate(self.chain.coupling[:, reading.joint]):
            if ratio != 0.0:
                acting = force[:, k] if self.chain.prismatic[k] else about_origin[:, k]
                total += ratio * np.einsum("ni,ni->n", frames[k][:, :3, 2], acting)
        return total


def _norm(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def _error(wanted: Array, pose: Array, rotation_length_m: float | None) -> Array:
    """Error from `pose` to `wanted`, (N, 3) or with the attitude (N, 6), in metres."""
    error = wanted[:, :3, 3] - pose[:, :3, 3]
    if rotation_length_m is None:
        return np.asarray(error)
    between = wanted[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], 1, 2)
    skew = 0.5 * (between - np.swapaxes(between, 1, 2))
    turn = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    return np.concatenate([error, rotation_length_m * turn], axis=1)


def _weighed(jacobian: Array, rotation_length_m: float | None) -> Array:
    """The rows of a Jacobian (N, 6, n) that belong to `_error`."""
    rows = jacobian[:, :3]
    if rotation_length_m is None:
        return rows
    return np.concatenate([rows, rotation_length_m * jacobian[:, 3:]], axis=1)


def _damped_step(error: Array, slope: Array, damping: Array) -> Array:
    """The step (N, n) that removes `error` in the linear model, shortened by `damping` (N,)."""
    square = slope @ np.swapaxes(slope, 1, 2) + (damping**2)[:, None, None] * np.eye(slope.shape[1])
    multipliers = np.linalg.solve(square, error[:, :, None])
    return np.asarray((np.swapaxes(slope, 1, 2) @ multipliers)[:, :, 0])


def tool_jacobian(chain: Chain, frames: list[Array], tool: Array) -> Array:
    """Derivative (N, 6, n) of tool point (N, 3) and attitude by the motor-side joints; `frames` (N, 4, 4) each.

    Zero for passive joints, which no motor turns.
    """
    links = np.zeros((tool.shape[0], 6, len(frames)))
    for k, frame in enumerate(frames):
        axis = frame[:, :3, 2]
        if chain.prismatic[k]:
            links[:, :3, k] = axis
        else:
            links[:, :3, k] = np.cross(axis, tool - frame[:, :3, 3])
            links[:, 3:, k] = axis
    motors = np.asarray(links @ chain.coupling)
    motors[:, :, list(chain.passive)] = 0.0
    return motors


def coordinates_moved(chain: Chain, last_from_tool: Array, rotation_length_m: float | None) -> int:
    """How many of the tool's 3 coordinates (6 with its attitude) the arm's axes can move in its best posture."""
    joints = np.random.default_rng(0).uniform(-1.0, 1.0, (_POSTURES, chain.joint_count))
    frames = chain.frames(joints)
    tool = (frames[-1] @ last_from_tool)[:, :3, 3]
    slope = _weighed(tool_jacobian(chain, frames, tool), rotation_length_m)
    return int(np.linalg.matrix_rank(slope, tol=_MOVES * chain.reach_m).max())


def gravity_moments(
    gravity: Array, frames: list[Array], masses: Array, moments: Array
) -> tuple[Array, Array]:
    """Moment about the origin of frame k, and force, of everything beyond joint k: (N, n, 3) each, in the base.

    `masses` (n,); `moments` (N, n, 3): mass times centre of mass, in frame k.
    """
    about_base, force = np.zeros(moments.shape), np.zeros(moments.shape)
    first_moment: Array = np.zeros((len(moments), 3))
    mass = 0.0
    for k in reversed(range(len(frames))):
        origin = frames[k][:, :3, 3]
        turned = np.einsum("nij,nj->ni", frames[k][:, :3, :3], moments[:, k])
        first_moment = first_moment + turned + masses[k] * origin
        mass += masses[k]
        about_base[:, k] = np.cross(first_moment - mass * origin, gravity)
        force[:, k] = mass * gravity
    return about_base, force
