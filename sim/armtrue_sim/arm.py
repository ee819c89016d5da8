"""An arm whose truth is exact: nominal kinematics plus the terms that the real one has and nobody told the fitter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .chain import Chain, Frames
from .errors import ScenarioError
from .expression import evaluate, variables
from .fourbar import FourBar
from .statics import GravityLoads, gravity_loads
from .transforms import Array, Pose, exp_so3

COORDINATES = ("tx", "ty", "tz", "rx", "ry", "rz")
MEASUREMENT_EFFECTS = frozenset({"base_frame", "tool_offset", "time_drift", "command_readback"})
Columns = Mapping[str, Array]


@dataclass(frozen=True)
class Term:
    """`value x expression(state)` on one coordinate (docs/model.md): the true coefficient behind an effect."""

    effect: str
    joints: tuple[int, ...]
    coordinate: str
    expression: str
    value: float
    unit: str

    def as_dict(self) -> dict[str, Any]:
        """For truth.json."""
        return {**self.__dict__, "joints": list(self.joints)}


class State(Mapping[str, Array]):
    """State variables of N poses by their names in docs/model.md; loads are computed only where an expression asks.

    A column that nobody recorded reads as its neutral value: no payload, reference temperature, direction 0, time 0.
    """

    def __init__(self, arm: Arm, q: Array, columns: Columns) -> None:
        self.q = np.atleast_2d(np.asarray(q, dtype=float))
        if self.q.shape[1] != arm.chain.n:
            raise ValueError(f"q has {self.q.shape[1]} columns, the arm has {arm.chain.n} joints")
        self._arm = arm
        self._columns = columns
        self._cache: dict[str, Array] = {}
        self._loads: GravityLoads | None = None

    def __iter__(self) -> Iterator[str]:
        return iter(self._cache)

    def __len__(self) -> int:
        return len(self._cache)

    def column(self, name: str, neutral: float) -> Array:
        """A recorded column (N,), or its neutral value."""
        values = self._columns.get(name)
        return np.full(len(self.q), neutral) if values is None else np.asarray(values, dtype=float)

    @property
    def loads(self) -> GravityLoads:
        """Gravity loads; of the nominal arm unless replaced by `use_loads`."""
        if self._loads is None:
            self._loads = self._arm.loads(self._arm.nominal_frames(self.q), self.column("payload", 0.0))
        return self._loads

    def use_loads(self, loads: GravityLoads) -> None:
        """Replaces the gravity loads, for statics on the deflected arm."""
        self._loads = loads
        self._cache = {k: v for k, v in self._cache.items() if not k.startswith(("tau", "gm", "bm"))}

    def __getitem__(self, name: str) -> Array:
        if name not in self._cache:
            self._cache[name] = self._compute(name)
        return self._cache[name]

    def _compute(self, name: str) -> Array:
        arm = self._arm
        if name in ("payload", "time"):
            return self.column(name, 0.0)
        if name in ("bmx", "bmy"):
            return self.loads.base_moment[:, 0 if name == "bmx" else 1]
        sensors = arm.sensors
        if name == "dT" or name.startswith("dT_"):
            sensor = name[3:] or (sensors[0] if sensors else "")
            if sensor in sensors:
                return self.column(f"temp_{sensor}", arm.reference_temperature) - arm.reference_temperature
            raise KeyError(name)
        stem = name.rstrip("0123456789")
        number = name[len(stem) :]
        if not number or not 1 <= int(number) <= arm.chain.n:
            raise KeyError(name)
        k = int(number) - 1
        if stem == "q":
            return self.q[:, k]
        if stem == "th":
            return arm.chain.link_variables(self.q)[:, k]
        if stem == "qr":
            return self.q[:, k] if name not in self._columns else np.asarray(self._columns[name], dtype=float)
        if stem == "dir":
            return self.column(name, 0.0)
        loads = {"tau": "motor_torque", "gmx": "moment_x", "gmy": "moment_y"}
        if stem in loads:
            result: Array = getattr(self.loads, loads[stem])[:, k]
            return result
        raise KeyError(name)


@dataclass
class Arm:
    """A nominal robot.yaml (with `base` and `tool`) and everything in which the real arm differs from it.

    measuring_from_base and flange_from_tool (by reflector id, "" where there is one) are the real poses. `statics`:
    "nominal" (torques of the nominal geometry, as docs/model.md defines) or "deflected" (of the arm as it stands).
    """

    robot: dict[str, Any]
    terms: list[Term]
    measuring_from_base: Pose
    flange_from_tool: dict[str, Pose]
    linkage: FourBar | None = None
    statics: str = "nominal"
    chain: Chain = field(init=False)
    nominal_base: Pose = field(init=False)
    nominal_tool: Pose = field(init=False)

    def __post_init__(self) -> None:
        self.chain = Chain.from_robot(self.robot)
        base, tool = self.robot.get("base"), self.robot.get("tool")
        zero = [0.0, 0.0, 0.0]
        self.nominal_base = Pose.from_xyz_rpy(base["xyz"], base.get("rpy", zero)) if base else Pose.identity()
        self.nominal_tool = Pose.from_xyz_rpy(tool["xyz"], tool.get("rpy", zero)) if tool else Pose.identity()
        for term in self.terms:
            self._slot(term.coordinate)

    @property
    def sensors(self) -> list[str]:
        """Temperature sensors by name."""
        return list(self.robot.get("temperature", {}).get("sensors", []))

    @property
    def reference_temperature(self) -> float:
        """Temperature in degC at which nothing has expanded."""
        return float(self.robot.get("temperature", {}).get("reference", 20.0))

    def _slot(self, coordinate: str) -> tuple[str, int, int]:
        """(kind, frame or joint from 0, component) of a coordinate name. Raises ScenarioError on an unknown one."""
        if coordinate.startswith("motor") and coordinate[5:].isdigit():
            k = int(coordinate[5:])
            if 1 <= k <= self.chain.n:
                return "motor", k - 1, 0
        frame, _, component = coordinate.partition(".")
        if component in COORDINATES:
            c = COORDINATES.index(component)
            if frame in ("base", "tool"):
                return frame, 0, c
            if frame.startswith("link") and frame[4:].isdigit() and 1 <= int(frame[4:]) <= self.chain.n:
                return "link", int(frame[4:]) - 1, c
        raise ScenarioError(
            f"coordinate '{coordinate}' is none of motor1...n, base.tx, link1.tx...linkn.rz, tool.tx"
        )

    def nominal_frames(self, q: Array) -> Frames:
        """Frames of the perfect arm in the robot base, for q (N, n)."""
        return self.chain.frames(self.chain.link_variables(q))

    def loads(self, frames: Frames, payload: Array) -> GravityLoads:
        """Gravity loads for given frames; the payload (N,) kg hangs at the nominal tool point."""
        point = frames.flange_origin + frames.flange_rotation @ self.nominal_tool.translation
        return gravity_loads(self.chain, frames, payload, point)

    def state(self, q: Array, columns: Columns | None = None) -> State:
        """State of poses q (N, n) with the recorded columns (names of data.csv)."""
        return State(self, q, columns or {})

    def true_pose(
        self,
        q: Array,
        columns: Columns | None = None,
        *,
        measurement_effects: bool = True,
        motor_error: Array | None = None,
    ) -> tuple[Array, Array]:
        """Where the real tool stands: rotations (N, 3, 3) and positions (N, 3) in the measuring frame, metres.

        q (N, n) commanded, motor side. columns: arrays (N,) named as in data.csv (payload, temp_NAME, dir1..., time,
        qr1..., target), each optional. measurement_effects=False leaves out what belongs to the measurement and not to
        the arm (time_drift, command_readback). motor_error (N, n): what the drives add at random.
        """
        _, tool_rotation, tool_position = self.true_frames(
            q, columns or {}, measurement_effects=measurement_effects, motor_error=motor_error
        )
        base = self.measuring_from_base
        return base.rotation @ tool_rotation, tool_position @ base.rotation.T + base.translation

    def true_frames(
        self,
        q: Array,
        columns: Columns,
        *,
        measurement_effects: bool = True,
        motor_error: Array | None = None,
    ) -> tuple[Frames, Array, Array]:
        """As `true_pose`, but in the robot base: real joint frames, tool rotations (N, 3, 3) and positions (N, 3)."""
        state = self.state(q, columns)
        rounds = 1 if self.statics == "nominal" else 4
        for _ in range(rounds):
            motor, link, base, tool = self._deflections(state, measurement_effects)
            if motor_error is not None:
                motor = motor + motor_error
            theta = self._true_link_variables(state.q + motor)
            frames = self.chain.frames(theta, link, base)
            if rounds > 1:
                state.use_loads(self.loads(frames, state.column("payload", 0.0)))
        rotation, position = frames.flange_rotation, frames.flange_origin
        for pose_rotation, pose_translation in (self._tools(columns, len(state.q)), tool):
            position = position + np.einsum("nij,nj->ni", rotation, pose_translation)
            rotation = rotation @ pose_rotation
        return frames, rotation, position

    def true_position(
        self,
        q: Array,
        columns: Columns | None = None,
        *,
        measurement_effects: bool = True,
        motor_error: Array | None = None,
    ) -> Array:
        """Positions (N, 3) of `true_pose`."""
        return self.true_pose(q, columns, measurement_effects=measurement_effects, motor_error=motor_error)[1]

    def nominal_position(self, q: Array) -> Array:
        """Where robot.yaml says that the tool stands, (N, 3) in the measuring frame, with its nominal base and tool."""
        q = np.atleast_2d(np.asarray(q, dtype=float))
        frames = self.nominal_frames(q)
        position = frames.flange_origin + frames.flange_rotation @ self.nominal_tool.translation
        result: Array = position @ self.nominal_base.rotation.T + self.nominal_base.translation
        return result

    def with_terms(self, terms: Sequence[Term]) -> Arm:
        """The same arm with other terms."""
        return Arm(
            self.robot,
            list(terms),
            self.measuring_from_base,
            self.flange_from_tool,
            self.linkage,
            self.statics,
        )

    def _true_link_variables(self, motor_angle: Array) -> Array:
        theta = self.chain.link_variables(motor_angle)
        if self.linkage is not None:
            # Only the rod's own error is added: the coupling matrix has already turned link 3 with the crank.
            beta = self.linkage.angle + theta[:, 2] - self.chain.offset[2]
            theta[:, 2] += self.linkage.rocker_angle(theta[:, 1], beta) - beta
        return theta

    def _deflections(
        self, state: State, measurement_effects: bool
    ) -> tuple[Array, dict[int, Array], Array | None, tuple[Array, Array]]:
        count = len(state.q)
        motor = np.zeros((count, self.chain.n))
        link: dict[int, Array] = {}
        base: Array | None = None
        tool = np.zeros((count, 6))
        for term in self.terms:
            if term.effect in MEASUREMENT_EFFECTS and not measurement_effects:
                continue
            value = term.value * evaluate(term.expression, state)
            kind, k, c = self._slot(term.coordinate)
            if kind == "motor":
                motor[:, k] += value
            elif kind == "link":
                link.setdefault(k, np.zeros((count, 6)))[:, c] += value
            elif kind == "base":
                base = np.zeros((count, 6)) if base is None else base
                base[:, c] += value
            else:
                tool[:, c] += value
        return motor, link, base, _batch_pose(tool)

    def _tools(self, columns: Columns, count: int) -> tuple[Array, Array]:
        names = list(self.flange_from_tool)
        index: Array = np.zeros(count, dtype=int)
        if "target" in columns:
            unknown = set(map(str, columns["target"])) - set(names)
            if unknown:
                raise ValueError(f"target {sorted(unknown)[0]!r} is none of {names}")
            index = np.array([names.index(str(t)) for t in columns["target"]])
        poses = list(self.flange_from_tool.values())
        return np.stack([p.rotation for p in poses])[index], np.stack([p.translation for p in poses])[index]


def _batch_pose(vector: Array) -> tuple[Array, Array]:
    return exp_so3(vector[:, 3:]), vector[:, :3]


def state_variables(terms: Sequence[Term]) -> frozenset[str]:
    """Every state variable that the terms read."""
    return frozenset().union(*(variables(term.expression) for term in terms)) if terms else frozenset()
