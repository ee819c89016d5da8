"""The fitted model and its exact inverse in double precision: what the fixed-point engine is measured against.

docs/model.md gives every formula. Vectorised over poses with NumPy; shares no code with the fitter or the firmware.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armtrue.arrays import Array
from armtrue.io.rotation import matrix_from_rotation_vector
from armtrue.tables import expression
from armtrue.tables.fitted import FittedArm
from armtrue.tables.layout import COMPONENTS

_REGRESSOR = re.compile(r"^u(x|y)?_(\d+)_(\d+)_([mxyz])$|^up(x|y)?_(\d+)$")

# Newton's method stops at this [m]; away from singularities it gets there in four steps.
_CONVERGED_M = 1e-13
_MOST_STEPS = 30
# Damping of the reference [m/rad]: takes 1e-6 of a step where the smallest singular value is 0.1 m/rad.
_DAMPING = 1e-4


@dataclass(frozen=True)
class Surroundings:
    """What the terms read besides the joints, each (N,) or (N, n); None where it is not recorded."""

    temperature: Mapping[str, Array]  # sensor → °C
    payload: Array | None = None  # kg
    time: Array | None = None  # s
    direction: Array | None = None  # (N, n)


@dataclass(frozen=True)
class Standing:
    """Where loads act: frames 1…n in the robot base, (N, 4, 4) each, and the payload's place in the last, (N, 3)."""

    frames: list[Array]
    payload: Array


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
        """Loads of the nominal arm."""
        point = (self.chain.end @ [*self.arm.payload_point, 1.0])[:3]
        return Standing(self.chain.frames(motor), np.tile(point, (motor.shape[0], 1)))

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

    def inverse(self, target: Array, around: Surroundings, rotation_length_m: float | None = None) -> Array:
        """Motor-side joints (N, n) at which the real tool is where nominal kinematics puts it for `target`.

        Motor-side deflections are taken off directly; the rest by least-norm steps, iterated to convergence. Loads are
        those of the nominal arm at `target`, where the corrected arm stands, or at what is commanded if so fitted.
        `rotation_length_m`: metres that weigh as one radian where the full pose is to be met; None: position only.
        """
        wanted, standing = self.nominal(target), self.at_nominal(target)
        coordinates = self.coordinates(self.state(target, around, standing))
        deflection = self._motor_deflection(coordinates, target.shape)
        pose, jacobian = self._propagate(target - deflection, coordinates)
        corrected = target - deflection + self._step(wanted, pose, jacobian, rotation_length_m)
        for _ in range(_MOST_STEPS):
            loads = self.at_nominal(corrected) if self.arm.loads_act_at_command else standing
            pose, jacobian = self.real(corrected, around, loads)
            step = self._step(wanted, pose, jacobian, rotation_length_m)
            corrected = corrected + step
            if np.abs(step).max(initial=0.0) < _CONVERGED_M:
                break
        return corrected

    def _step(self, wanted: Array, pose: Array, jacobian: Array, rotation_length_m: float | None) -> Array:
        error = wanted[:, :3, 3] - pose[:, :3, 3]
        rows = jacobian[:, :3]
        if rotation_length_m is not None:
            between = wanted[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], 1, 2)
            skew = 0.5 * (between - np.swapaxes(between, 1, 2))
            turn = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
            error = np.concatenate([error, rotation_length_m * turn], axis=1)
            rows = np.concatenate([rows, rotation_length_m * jacobian[:, 3:]], axis=1)
        square = rows @ np.swapaxes(rows, 1, 2) + _DAMPING**2 * np.eye(rows.shape[1])
        multipliers = np.linalg.solve(square, error[:, :, None])
        return np.asarray((np.swapaxes(rows, 1, 2) @ multipliers)[:, :, 0])

    def _motor_deflection(self, coordinates: dict[str, Array], shape: tuple[int, ...]) -> Array:
        result = np.zeros(shape)
        for k in range(shape[1]):
            result[:, k] = coordinates.get(f"motor{k + 1}", 0.0)
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
        return current, self._jacobian(frames, current[:, :3, 3])

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

    def _jacobian(self, frames: list[Array], tool: Array) -> Array:
        links = np.zeros((tool.shape[0], 6, len(frames)))
        for k, frame in enumerate(frames):
            axis = frame[:, :3, 2]
            if self.chain.prismatic[k]:
                links[:, :3, k] = axis
            else:
                links[:, :3, k] = np.cross(axis, tool - frame[:, :3, 3])
                links[:, 3:, k] = axis
        return np.asarray(links @ self.chain.coupling)

    def _add_gravity(self, columns: dict[str, Array], names: set[str], standing: Standing) -> None:
        chain, frames, point = self.chain, standing.frames, standing.payload
        rows = point.shape[0]
        if chain.masses is not None and chain.coms is not None:
            masses = np.tile(chain.masses, (rows, 1))
            moments = np.tile(chain.masses[:, None] * chain.coms, (rows, 1, 1))
            masses[:, -1] += columns["payload"]
            moments[:, -1] += columns["payload"][:, None] * point
            arm_moments = gravity_moments(chain.gravity, frames, masses, moments)
            for kind, prefix in enumerate(("tau", "gmx", "gmy")):
                for k in range(chain.joint_count):
                    columns[f"{prefix}{k + 1}"] = self._gravity_of(arm_moments, frames, kind, k + 1)
            columns["bmx"] = self._gravity_of(arm_moments, frames, 1, 0)
            columns["bmy"] = self._gravity_of(arm_moments, frames, 2, 0)
        for name in names:
            match = _REGRESSOR.match(name)
            if match is None:
                continue
            masses, moments = np.zeros((rows, chain.joint_count)), np.zeros((rows, chain.joint_count, 3))
            if match[6] is not None:
                masses[:, -1], moments[:, -1] = 1.0, point
                kind, joint = _kind(match[5]), int(match[6])
            else:
                link = int(match[3]) - 1
                if match[4] == "m":
                    masses[:, link] = 1.0
                else:
                    moments[:, link, "xyz".index(match[4])] = 1.0
                kind, joint = _kind(match[1]), int(match[2])
            unit = gravity_moments(chain.gravity, frames, masses, moments)
            columns[name] = self._gravity_of(unit, frames, kind, joint)

    def _gravity_of(self, moments: tuple[Array, Array], frames: list[Array], kind: int, joint: int) -> Array:
        """Torque (kind 0) on motor joint `joint`, or moment x (1), y (2) about frame `joint`; joint 0 is the base."""
        about_origin, force = moments
        if joint == 0:
            at_base = about_origin[:, 0] + np.cross(frames[0][:, :3, 3], force[:, 0])
            return np.asarray(at_base[:, kind - 1])
        if kind != 0:
            axis = frames[joint - 1][:, :3, kind - 1]
            return np.asarray(np.einsum("ni,ni->n", axis, about_origin[:, joint - 1]))
        total = np.zeros(force.shape[0])
        for k in range(self.chain.joint_count):
            ratio = self.chain.coupling[k, joint - 1]
            if ratio != 0.0:
                acting = force[:, k] if self.chain.prismatic[k] else about_origin[:, k]
                total += ratio * np.einsum("ni,ni->n", frames[k][:, :3, 2], acting)
        return total


def _kind(letter: str | None) -> int:
    return {None: 0, "x": 1, "y": 2}[letter]


def gravity_moments(
    gravity: Array, frames: list[Array], masses: Array, moments: Array
) -> tuple[Array, Array]:
    """Moment about the origin of frame k, and force, of everything beyond joint k: (N, n, 3) each, in the base.

    `masses` (N, n); `moments` (N, n, 3): mass times centre of mass, in frame k.
    """
    count = len(frames)
    rows = masses.shape[0]
    about_base = np.zeros((rows, count, 3))
    force = np.zeros((rows, count, 3))
    first_moment: Array = np.zeros((rows, 3))
    mass: Array = np.zeros(rows)
    for k in reversed(range(count)):
        origin = frames[k][:, :3, 3]
        turned = np.einsum("nij,nj->ni", frames[k][:, :3, :3], moments[:, k])
        first_moment = first_moment + turned + masses[:, k, None] * origin
        mass = mass + masses[:, k]
        about_base[:, k] = np.cross(first_moment - mass[:, None] * origin, gravity)
        force[:, k] = mass[:, None] * gravity
    return about_base, force
