"""The kinematic chain of docs/model.md, evaluated for many poses at once.

    measuring_from_tool = measuring_from_base V_base prod_k [F_k J_k(theta_k) V_k] F_end T_tool

Standard DH is Denavit-Hartenberg's own form, modified DH is Craig's ("Introduction to Robotics", section 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import ScenarioError
from .transforms import Array, Pose, exp_so3, rot_x, rot_z


@dataclass(frozen=True)
class Link:
    """Mass (kg) and centre of mass (m) in frame k of docs/model.md."""

    mass: float
    com: Array


@dataclass
class Frames:
    """Frames 1..n of N poses in the robot base: rotations (n, N, 3, 3) and origins (n, N, 3); the flange after them."""

    rotation: Array
    origin: Array
    flange_rotation: Array
    flange_origin: Array


@dataclass
class Chain:
    """A serial arm read from the `kinematics`, `coupling`, `links` and `gravity` of a robot.yaml dictionary.

    A passive joint has no motor: its motor side stands at zero, and `coupling` turns it.
    """

    names: list[str]
    fixed: list[Pose]
    end: Pose
    prismatic: Array
    passive: Array
    offset: Array
    limits: Array
    gear_ratio: Array
    lead: Array
    coupling: Array
    links: list[Link]
    gravity: Array
    link_lengths: list[Array] = field(default_factory=list)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)

    @classmethod
    def from_robot(cls, robot: dict[str, Any]) -> Chain:
        """Reads a robot.yaml dictionary with convention mdh or dh. Raises ScenarioError on anything else."""
        kinematics = robot.get("kinematics", {})
        convention = kinematics.get("convention")
        if convention not in ("mdh", "dh"):
            raise ScenarioError(
                f"robot '{robot.get('name')}': kinematics.convention is {convention!r}, expected mdh or dh"
            )
        rows = kinematics["joints"]
        before, after = [], []
        for row in rows:
            twist, shift = rot_x(row["alpha"]), np.array([row["a"], 0.0, row["d"]])
            turned = rot_z(row.get("theta", 0.0))
            if convention == "mdh":
                before.append(Pose(twist @ turned, twist @ shift))
                after.append(Pose.identity())
            else:
                before.append(Pose(turned, np.zeros(3)))
                after.append(Pose(twist, shift))
        fixed = [before[0]] + [after[k] @ before[k + 1] for k in range(len(rows) - 1)]
        links = [
            Link(
                float(link["mass"]), after[k].rotation @ np.asarray(link["com"], float) + after[k].translation
            )
            for k, link in enumerate(robot.get("links", []))
        ]
        n = len(rows)
        coupling = np.eye(n)
        for entry in robot.get("coupling", []):
            coupling[entry["joint"] - 1, entry["driving"] - 1] += entry["ratio"]
        following = [*fixed[1:], after[-1]]
        return cls(
            names=[row["name"] for row in rows],
            fixed=fixed,
            end=after[-1],
            prismatic=np.array([row.get("type", "revolute") == "prismatic" for row in rows]),
            offset=np.array([float(row.get("offset", 0.0)) for row in rows]),
            limits=np.array([[0.0, 0.0] if row.get("passive") else row["limits"] for row in rows], float),
            passive=np.array([bool(row.get("passive")) for row in rows]),
            gear_ratio=np.array([float(row.get("gear_ratio", 1.0)) for row in rows]),
            lead=np.array([float(row.get("lead", 0.0)) for row in rows]),
            coupling=coupling,
            links=links,
            gravity=np.asarray(robot.get("gravity", [0.0, 0.0, -9.81]), dtype=float),
            link_lengths=[pose.translation for pose in following],
        )

    def link_variables(self, q: Array) -> Array:
        """theta = C q + offset for motor-side joints q (N, n)."""
        return q @ self.coupling.T + self.offset

    def frames(self, theta: Array, link: dict[int, Array] | None = None, base: Array | None = None) -> Frames:
        """Frames in the robot base for link variables theta (N, n).

        `link[k]` (N, 6), k from 0, and `base` (N, 6) are virtual-joint coordinates tx ty tz rx ry rz; absent is 0.
        """
        count, n = theta.shape
        rotations = np.empty((n, count, 3, 3))
        origins = np.empty((n, count, 3))
        rotation: Array = np.broadcast_to(np.eye(3), (count, 3, 3))
        origin: Array = np.zeros((count, 3))
        if base is not None:
            origin = base[:, :3]
            rotation = exp_so3(base[:, 3:])
        for k in range(n):
            origin = origin + rotation @ self.fixed[k].translation
            rotation = rotation @ self.fixed[k].rotation
            if self.prismatic[k]:
                origin = origin + rotation[:, :, 2] * theta[:, k, None]
            else:
                c, s = np.cos(theta[:, k, None]), np.sin(theta[:, k, None])
                x, y = rotation[:, :, 0], rotation[:, :, 1]
                rotation = np.stack([c * x + s * y, c * y - s * x, rotation[:, :, 2]], axis=2)
            rotations[k], origins[k] = rotation, origin
            if link is not None and k in link:
                origin = origin + np.einsum("nij,nj->ni", rotation, link[k][:, :3])
                if link[k][:, 3:].any():
                    rotation = rotation @ exp_so3(link[k][:, 3:])
        return Frames(
            rotations, origins, rotation @ self.end.rotation, origin + rotation @ self.end.translation
        )
