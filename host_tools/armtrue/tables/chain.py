"""The nominal arm in double precision: the chain of docs/model.md, its frames and its gravity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.io.columns import commanded_joints
from armtrue.io.robot import STANDARD_GRAVITY, Robot
from armtrue.io.rotation import matrix_about, matrix_from_rpy

# Least sine of a parallelogram's angle: its bars meet before the angle comes closer to 0 or 180 degrees.
_LEAST_SINE_OF_LINKAGE = 0.4


def transform(xyz: Any, rotation: Array) -> Array:
    """4 × 4 transform from a position [m] and a 3 × 3 rotation."""
    result = np.eye(4)
    result[:3, :3] = rotation
    result[:3, 3] = xyz
    return result


def pose(entry: dict[str, Any] | None) -> Array:
    """4 × 4 transform of `{xyz, rpy}` (rpy: fixed axes x, y, z); the identity for None."""
    entry = entry or {}
    rotation = matrix_from_rpy(entry.get("rpy") or (0.0, 0.0, 0.0))
    return transform(entry.get("xyz") or (0.0, 0.0, 0.0), rotation)


@dataclass(frozen=True)
class Chain:
    """The nominal arm. Transforms are 4 × 4; joints are counted from 0 here."""

    prismatic: list[bool]
    fixed: list[Array]  # F_k
    end: Array  # F_end
    offset: Array  # (n,)
    coupling: Array  # C, (n, n)
    limits: Array  # (n, 2), rad or m
    gear_ratio: list[float | None]
    gravity: Array  # (3,) in the base frame, m/s²
    masses: Array | None  # (n,), kg; None where robot.yaml gives none
    coms: Array | None  # (n, 3), in frame k, m
    sensors: list[str]
    temperature_reference: float
    linkage: tuple[int, float] | None = None  # parallelogram: 0-based arm joint, β where its angle is zero
    passive: frozenset[int] = frozenset()  # joints without a motor

    @property
    def joint_count(self) -> int:
        """Number of joints."""
        return len(self.fixed)

    def link_variables(self, motor: Array) -> Array:
        """Link variables C q + offset of motor-side joints (N, n)."""
        return motor @ self.coupling.T + self.offset

    def joint_transforms(self, k: int, link: Array) -> Array:
        """J_k for link variables `link` (N,): (N, 4, 4)."""
        result = np.tile(np.eye(4), (link.size, 1, 1))
        if self.prismatic[k]:
            result[:, 2, 3] = link
            return result
        c, s = np.cos(link), np.sin(link)
        result[:, 0, 0], result[:, 0, 1] = c, -s
        result[:, 1, 0], result[:, 1, 1] = s, c
        return result

    def frames(self, motor: Array) -> list[Array]:
        """Nominal base_from_frame_k after each joint, each (N, 4, 4), at motor-side joints (N, n)."""
        link = self.link_variables(motor)
        current = np.tile(np.eye(4), (motor.shape[0], 1, 1))
        result = []
        for k in range(self.joint_count):
            current = current @ self.fixed[k] @ self.joint_transforms(k, link[:, k])
            result.append(current)
        return result

    def tool_poses(self, motor: Array, flange_from_tool: Array) -> Array:
        """Nominal base_from_tool, (N, 4, 4), at motor-side joints (N, n)."""
        return self.frames(motor)[-1] @ self.end @ flange_from_tool

    def can_stand(self, motor: Array) -> NDArray[np.bool_]:
        """Mask (N,) of the motor-side joints (N, n) that the parallelogram allows, because they do not fold it."""
        if self.linkage is None:
            return np.ones(len(motor), dtype=np.bool_)
        joint, angle = self.linkage
        return np.asarray(
            np.abs(np.sin(angle + self.link_variables(motor)[:, joint])) > _LEAST_SINE_OF_LINKAGE
        )

    @property
    def reach_m(self) -> float:
        """Sum of the lengths of the links, in metres."""
        lengths = [float(np.linalg.norm(fixed[:3, 3])) for fixed in [*self.fixed, self.end]]
        strokes = np.abs(self.limits[np.array(self.prismatic)]).max(axis=1, initial=0.0)
        return float(sum(lengths) + strokes.sum())


def _listed_frames(kinematics: dict[str, Any]) -> tuple[list[Array], Array, list[Array]]:
    """F_k, F_end, and frame_k_from_listed_frame, in which robot.yaml gives centres of mass."""
    fixed: list[Array] = []
    listed: list[Array] = []
    carried = np.eye(4)
    for row in kinematics["joints"]:
        if kinematics["convention"] == "chain":
            fixed.append(pose(row))
            listed.append(np.eye(4))
            continue
        twist = transform((0.0, 0.0, 0.0), matrix_about("x", row.get("alpha") or 0.0))
        length = transform((row.get("a") or 0.0, 0.0, row.get("d") or 0.0), np.eye(3))
        turned = transform((0.0, 0.0, 0.0), matrix_about("z", row.get("theta") or 0.0))
        if kinematics["convention"] == "mdh":
            fixed.append(twist @ length @ turned)
            listed.append(np.eye(4))
        else:
            fixed.append(carried @ turned)
            carried = length @ twist
            listed.append(carried)
    end = pose(kinematics["end"]) if kinematics.get("end") else carried
    return fixed, end, listed


def flanges(columns: Mapping[str, Array], spec: dict[str, Any]) -> Array:
    """Nominal base_from_flange (N, 4, 4) at the commanded joints of `columns`; spec: a normalised robot.yaml."""
    chain = chain_from_robot(spec)
    joints = np.column_stack([columns[name] for name in commanded_joints(columns)])
    return chain.frames(joints)[-1] @ chain.end


def chain_from_robot(spec: dict[str, Any]) -> Chain:
    """The chain of a normalised robot.yaml (mdh, dh or chain; joint limits default to ±360° and ±1 m)."""
    kinematics = spec["kinematics"]
    rows = kinematics["joints"]
    fixed, end, listed = _listed_frames(kinematics)
    prismatic = [row.get("type", "revolute") == "prismatic" for row in rows]
    links = spec.get("links") or []
    temperature = spec.get("temperature") or {}
    linkage = spec.get("linkage")
    limits: list[list[float]] = []
    for row, slides in zip(rows, prismatic, strict=True):
        default = [-1.0, 1.0] if slides else [-2.0 * np.pi, 2.0 * np.pi]
        limits.append([0.0, 0.0] if row.get("passive") else row.get("limits") or default)
    return Chain(
        prismatic=prismatic,
        fixed=fixed,
        end=end,
        offset=np.array([row.get("offset") or 0.0 for row in rows]),
        # The rows of kind controller concern reported angles only: io.dataset converts them to the drives' angles.
        coupling=Robot(spec).mechanical_coupling,
        limits=np.array(limits, dtype=np.float64),
        gear_ratio=[row.get("gear_ratio") for row in rows],
        gravity=np.array(spec.get("gravity") or STANDARD_GRAVITY, dtype=np.float64),
        masses=np.array([link["mass"] for link in links], dtype=np.float64) if links else None,
        coms=np.array([(frame @ [*link["com"], 1.0])[:3] for frame, link in zip(listed, links, strict=True)])
        if links
        else None,
        sensors=list(temperature.get("sensors") or []),
        temperature_reference=float(temperature.get("reference", 20.0)),
        linkage=(linkage["joints"][1] - 1, float(linkage["angle"])) if linkage else None,
        passive=frozenset(k for k, row in enumerate(rows) if row.get("passive")),
    )
