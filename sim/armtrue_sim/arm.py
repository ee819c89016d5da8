"""An arm with exactly known errors: nominal kinematics plus the true terms, which the fitter does not know."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from .errors import ScenarioError
from .history import History
from .mechanics.chain import Chain, Frames
from .mechanics.expression import evaluate, variables
from .mechanics.fourbar import FourBar
from .mechanics.statics import BodyError, GravityLoads, gravity_loads, real_body
from .mechanics.transforms import Array, Pose, exp_so3
from .tracker import TrackerError

COORDINATES = ("tx", "ty", "tz", "rx", "ry", "rz")
MEASUREMENT_EFFECTS = frozenset(
    {
        *("base_frame", "tool_offset", "time_drift", "command_readback"),
        *("tracker_scale", "tracker_angles", "station", "nest"),
    }
)
# State variables that depend on the arm's deflected pose.
LOADS = ("tau", "gmx", "gmy", "bmx", "bmy", "load", "balancer")
# Loads deflect the arm, and the deflection changes the loads: iterated until the tool moves less than STANDS_STILL (m).
STANDS_STILL, MOST_ROUNDS = 1e-12, 40
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


class LinkPhysics(Protocol):
    """A physical deflection of links that no sum of terms expresses."""

    def coordinates(self, arm: Arm, state: State, frames: Frames) -> dict[int, Array]:
        """Virtual-joint coordinates (N, 6) by link (from 0), for an arm that stands in `frames`."""

    def scaled(self, factor: float) -> LinkPhysics:
        """The same, `factor` times as large."""


@dataclass
class Deflections:
    """Deflections of motors (N, n), links (N, 6 each, from 0), base (N, 6) and tool (N, 6)."""

    motor: Array
    link: dict[int, Array]
    base: Array
    tool: Array


class State(Mapping[str, Array]):
    """State variables of N poses by their names in docs/model.md; loads are computed only if an expression reads them.

    A column that is not recorded has its neutral value: no payload, reference temperature, direction 0, time 0,
    infinite travel. Variables that are in no file: load2 is the torque on gear 2, gravity's plus the balancer's;
    balancer2 the balancer's alone; names that begin with _ are states that depend on the path to the pose (history.py).
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
        """Gravity loads of the nominal geometry, unless replaced by `use_loads`."""
        if self._loads is None:
            self._loads = self._arm.loads(self._arm.nominal_frames(self.q), self.column("payload", 0.0))
        return self._loads

    def use_loads(self, loads: GravityLoads) -> None:
        """Replaces the gravity loads, for statics on the deflected arm."""
        self._loads = loads
        self._cache = {k: v for k, v in self._cache.items() if not k.startswith(LOADS)}

    def __getitem__(self, name: str) -> Array:
        if name not in self._cache:
            self._cache[name] = self._compute(name)
        return self._cache[name]

    def _balancer(self, joint: int) -> Array:
        """Torque of the gravity_balancer that carries a joint (from 1)."""
        if not self._arm.has_balancer(joint):
            raise ScenarioError(f"joint {joint} has no gravity_balancer, which an effect beside it reads")
        return sum(
            (evaluate(t.expression, self) for t in self._arm.terms if t.effect == "gravity_balancer"),
            self.q[:, 0] * 0.0,
        )

    def _compute(self, name: str) -> Array:
        arm = self._arm
        if name in ("payload", "time") or name.startswith("_"):
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
        if stem in ("dir", "travel"):
            return self.column(name, 0.0 if stem == "dir" else np.inf)
        if stem == "balancer":
            return self._balancer(k + 1)
        if stem == "load":
            return self[f"tau{k + 1}"] + (self._balancer(k + 1) if self._arm.has_balancer(k + 1) else 0.0)
        loads = {"tau": "motor_torque", "gmx": "moment_x", "gmy": "moment_y"}
        if stem in loads:
            return getattr(self.loads, loads[stem])[:, k]
        raise KeyError(name)


@dataclass
class Arm:
    """A nominal robot.yaml (with `base` and `tool`) and everything in which the real arm differs from it.

    measuring_from_base and flange_from_tool (by reflector id, "" if there is only one) are the real poses. `statics`:
    "deflected" (loads at the deflected pose) or "nominal" (loads of the nominal geometry, which no real arm has).
    body: errors of the stated masses, centres and gravity. physics: deflections of links that terms do not express;
    histories: states that depend on the path to a pose; tracker: systematic errors of the instrument.
    """

    robot: dict[str, Any]
    terms: list[Term]
    measuring_from_base: Pose
    flange_from_tool: dict[str, Pose]
    linkage: FourBar | None = None
    statics: str = "deflected"
    body: BodyError = field(default_factory=BodyError)
    physics: list[LinkPhysics] = field(default_factory=list)
    histories: list[History] = field(default_factory=list)
    tracker: TrackerError = field(default_factory=TrackerError)
    chain: Chain = field(init=False)
    nominal_base: Pose = field(init=False)
    nominal_tool: Pose = field(init=False)
    heavy: Chain = field(init=False)

    def __post_init__(self) -> None:
        self.chain = Chain.from_robot(self.robot)
        base, tool = self.robot.get("base"), self.robot.get("tool")
        zero = [0.0, 0.0, 0.0]
        self.nominal_base = Pose.from_xyz_rpy(base["xyz"], base.get("rpy", zero)) if base else Pose.identity()
        self.nominal_tool = Pose.from_xyz_rpy(tool["xyz"], tool.get("rpy", zero)) if tool else Pose.identity()
        self.heavy = real_body(self.chain, self.body)
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

    def has_balancer(self, joint: int) -> bool:
        """True where a gravity_balancer carries the joint (from 1)."""
        return any(t.effect == "gravity_balancer" and joint in t.joints for t in self.terms)

    def nominal_frames(self, q: Array) -> Frames:
        """Frames of the perfect arm in the robot base, for q (N, n)."""
        return self.chain.frames(self.chain.link_variables(q))

    def loads(self, frames: Frames, payload: Array) -> GravityLoads:
        """Gravity loads for given frames; the payload (N,) kg acts at the tool point, shifted by `body`'s error."""
        return gravity_loads(self.heavy, frames, payload, self.payload_point(frames))

    def payload_point(self, frames: Frames) -> Array:
        """Points (N, 3) at which the payload's weight acts, in the robot base."""
        centre = self.nominal_tool.translation + self.body.payload_centre
        return frames.flange_origin + frames.flange_rotation @ centre

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
        """Poses of the real tool: rotations (N, 3, 3) and positions (N, 3) in the measuring frame, metres.

        q (N, n) commanded, motor side. columns: arrays (N,) named as in data.csv (payload, temp_NAME, dir1..., time,
        qr1..., target), each optional. measurement_effects=False leaves out the terms of the measurement, which are not
        the arm's (time_drift, command_readback). motor_error (N, n): random error of the drives.
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
        state, frames, moved = self._stand(q, columns, measurement_effects, motor_error)
        rotation, position = frames.flange_rotation, frames.flange_origin
        moved_tool = exp_so3(moved.tool[:, 3:]), moved.tool[:, :3]
        for pose_rotation, pose_translation in (self._tools(columns, len(state.q)), moved_tool):
            position = position + np.einsum("nij,nj->ni", rotation, pose_translation)
            rotation = rotation @ pose_rotation
        return frames, rotation, position

    def standing_state(self, q: Array, columns: Columns | None = None) -> State:
        """State of poses q (N, n) with the loads of the arm in its deflected pose."""
        return self._stand(q, columns or {}, True, None)[0]

    def _stand(
        self, q: Array, columns: Columns, measurement_effects: bool, motor_error: Array | None
    ) -> tuple[State, Frames, Deflections]:
        state = self.state(q, columns)
        terms = [t for t in self.terms if measurement_effects or t.effect not in MEASUREMENT_EFFECTS]
        loaded = [t for t in terms if any(v.startswith(LOADS) for v in variables(t.expression))]
        n, count = self.chain.n, len(state.q)
        still = Deflections(np.zeros((count, n)), {}, np.zeros((count, 6)), np.zeros((count, 6)))
        self._add(still, [t for t in terms if t not in loaded], state)
        if motor_error is not None:
            still.motor += motor_error
        frames = self.nominal_frames(state.q)
        for _ in range(MOST_ROUNDS):
            before = frames
            moved = deepcopy(still)
            self._add(moved, loaded, state)
            for physics in self.physics:
                for k, value in physics.coordinates(self, state, before).items():
                    moved.link[k] = moved.link.get(k, 0.0) + value
            theta = self._true_link_variables(state.q + moved.motor)
            frames = self.chain.frames(theta, moved.link, moved.base)
            if self.statics == "nominal" or not (loaded or self.physics):
                break
            state.use_loads(self.loads(frames, state.column("payload", 0.0)))
            if np.abs(frames.flange_origin - before.flange_origin).max(initial=0.0) < STANDS_STILL:
                break
        else:
            raise ScenarioError(f"the arm is too soft to stand: still moving after {MOST_ROUNDS} rounds")
        if self.statics == "deflected":
            state.use_loads(self.loads(frames, state.column("payload", 0.0)))
        return state, frames, moved

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
        """Tool positions (N, 3) in the measuring frame by robot.yaml, with its nominal base and tool."""
        q = np.atleast_2d(np.asarray(q, dtype=float))
        frames = self.nominal_frames(q)
        position = frames.flange_origin + frames.flange_rotation @ self.nominal_tool.translation
        return position @ self.nominal_base.rotation.T + self.nominal_base.translation

    def with_terms(self, terms: Sequence[Term]) -> Arm:
        """The same arm with other terms."""
        return replace(self, terms=list(terms))

    def _true_link_variables(self, motor_angle: Array) -> Array:
        theta = self.chain.link_variables(motor_angle)
        if self.linkage is not None:
            # Only the linkage's error is added: the coupling matrix already turns link 3 with the crank.
            beta = self.linkage.angle + theta[:, 2] - self.chain.offset[2]
            theta[:, 2] += self.linkage.rocker_angle(theta[:, 1], beta) - beta
        return theta

    def _add(self, to: Deflections, terms: Sequence[Term], state: State) -> None:
        for term in terms:
            value = term.value * evaluate(term.expression, state)
            kind, k, c = self._slot(term.coordinate)
            if kind == "motor":
                to.motor[:, k] += value
            elif kind == "link":
                to.link.setdefault(k, np.zeros((len(state.q), 6)))[:, c] += value
            else:
                (to.base if kind == "base" else to.tool)[:, c] += value

    def _tools(self, columns: Columns, count: int) -> tuple[Array, Array]:
        names = list(self.flange_from_tool)
        index: Array = np.zeros(count, dtype=int)
        if "target" in columns:
            unknown = set(map(str, columns["target"])) - set(names)
            if unknown:
                raise ValueError(f"target {sorted(unknown)[0]!r} is none of {names}")
            index = np.array([names.index(str(t)) for t in columns["target"]], dtype=int)
        poses = list(self.flange_from_tool.values())
        return np.stack([p.rotation for p in poses])[index], np.stack([p.translation for p in poses])[index]
