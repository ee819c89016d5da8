"""Fits to arms whose truth is known exactly, and that truth in the fit's own parameters.

A fit holds parameters that the data cannot tell apart (docs/model.md), and the kept ones stand in for them: their true
values are not those of the simulated arm. They are found here by projection: the kept parameters, as terms of the
simulator's own arm, are changed until that arm stands where the real one stands, pose by pose. The fitter's kinematics
is not used.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from armtrue import _core
from armtrue_sim import simulate
from armtrue_sim.arm import LOADS, Arm, Term
from armtrue_sim.campaign import Campaign, joints_of
from armtrue_sim.mechanics.expression import variables
from armtrue_sim.mechanics.transforms import Pose
from armtrue_sim.sensitivity import sensitivity
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIGMA = 10e-6  # m per axis; drives repeat exactly, so that the noise is what the theory assumes
GEOMETRY = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]


@dataclass
class KnownArm:
    """An arm with exact truth, and a model that can carry all of it."""

    campaign: Campaign
    model: dict[str, Any]
    _columns: dict[str, Array] = field(init=False)

    def __post_init__(self) -> None:
        self._columns = {name: np.ascontiguousarray(v, dtype=float) for name, v in self.campaign.data.items()}

    @classmethod
    def of(
        cls, scenario: Mapping[str, Any], model: list[Any] | None = None, poses: int = 240, **more: Any
    ) -> KnownArm:
        """From a scenario; `model`: effects of model.yaml, default: all that the arm has."""
        campaign = simulate(
            {
                "poses": poses,
                "test_poses": 200,
                "repeats": {"poses": 0, "times": 0},
                "instrument": {"sigma": 0.0},
                "repeatability": {"drive": 0.0},
                **scenario,
                **more,
            }
        )
        return cls(campaign, {"effects": model} if model else campaign.true_model)

    @property
    def joints(self) -> Array:
        """Commanded joints (N, n) of the measured poses."""
        return joints_of(self.campaign.data, self.campaign.arm.chain.n)

    def sag(self) -> Array:
        """Displacement of the tool by the arm's loads (N,) [m]."""
        arm, data = self.campaign.arm, self.campaign.data
        stiff = [t for t in arm.terms if not any(v.startswith(LOADS) for v in variables(t.expression))]
        moved = arm.true_position(self.joints, data) - arm.with_terms(stiff).true_position(self.joints, data)
        result: Array = np.linalg.norm(moved, axis=1)
        return result

    def fit(self, seed: int | None, sigma: float = SIGMA, **options: Any) -> KnownFit:
        """Fit to positions with fresh noise; `seed` None: without any."""
        columns = dict(self._columns)
        noise = np.zeros_like(self.campaign.exact)
        if seed is not None:
            noise = sigma * np.random.default_rng([4711, seed]).standard_normal(noise.shape)
        for i, axis in enumerate("xyz"):
            columns[axis] = np.ascontiguousarray(self.campaign.exact[:, i] + noise[:, i])
        settings = {"assumed_sigma_m": sigma, "cross_validate": False, **options}
        core = _core.fit(
            json.dumps(self.campaign.robot), columns, json.dumps(self.model), json.dumps(settings)
        )
        return KnownFit(self, {**json.loads(core.document()), "robot": self.campaign.robot}, core)


@dataclass
class KnownFit:
    """A fit to a KnownArm's measurements. `document`: as fit.json has it."""

    arm: KnownArm
    document: dict[str, Any]
    core: _core.Fit
    _projected: tuple[Array, Array] | None = None

    @property
    def kept(self) -> list[dict[str, Any]]:
        """Parameters that were solved for."""
        return [p for p in self.document["parameters"] if p["sigma"] is not None]

    def fresh_errors(self) -> Array:
        """Distances (M,) [m] between prediction and exact position at fresh poses."""
        test = {
            name: np.ascontiguousarray(v, dtype=float)
            for name, v in self.arm.campaign.test.items()
            if name != "target"
        }
        exact = np.stack([test[axis] for axis in "xyz"], axis=1)
        result: Array = np.linalg.norm(self.predicted(test) - exact, axis=1)
        return result

    def predicted(self, columns: Mapping[str, Array]) -> Array:
        """Predicted positions (M, 3) [m]."""
        return np.asarray(_core.predict(json.dumps(self.document), dict(columns)))

    def own_arm(self, values: Array) -> Arm:
        """The simulator's arm with this fit's kept parameters at `values`, and with its base and tool."""
        real = self.arm.campaign.arm
        tool = self.document["flange_from_tool"][""]
        return Arm(
            real.robot,
            self._terms(values),
            _pose(self.document["measuring_from_base"]),
            {"": _pose(tool)},
            statics=real.statics,
        )

    def projected_truth(self) -> tuple[Array, Array]:
        """True values of the kept parameters, in their order, and the distances (N,) [m] that remain with them.

        Base and tool are relative to the poses that the fit found, as in the fit.
        """
        if self._projected is not None:
            return self._projected
        q, data, exact = self.arm.joints, self.arm.campaign.data, self.arm.campaign.exact
        values = np.array([p["value"] for p in self.kept])
        for _ in range(3):
            arm = self.own_arm(values)
            left = exact - arm.true_position(q, data)
            slopes = self._slopes(arm, q, data)
            scale = np.linalg.norm(slopes, axis=0)
            values = values + np.linalg.lstsq(slopes / scale, left.ravel(), rcond=1e-13)[0] / scale
        left = exact - self.own_arm(values).true_position(q, data)
        self._projected = values, np.linalg.norm(left, axis=1)
        return self._projected

    def deviations(self) -> Array:
        """Estimate minus truth of every kept parameter, in its own standard deviations."""
        truth, _ = self.projected_truth()
        estimate = np.array([p["value"] for p in self.kept])
        sigma = np.array([p["sigma"] for p in self.kept])
        result: Array = (estimate - truth) / sigma
        return result

    def predicted_rms(self, sigma: float = SIGMA) -> Array:
        """Cramer-Rao bound (M,) [m] on the RMS error at fresh poses, for the kept parameters at the real arm.

        From the simulator's derivatives alone. The kept parameters span the same motions as all of the model's, so that
        this is the bound of the whole model.
        """
        values, _ = self.projected_truth()
        arm = self.own_arm(values)
        seen = self._slopes(arm, self.arm.joints, self.arm.campaign.data)
        test = self.arm.campaign.test
        ahead = self._slopes(arm, joints_of(test, arm.chain.n), test)
        scale = np.linalg.norm(seen, axis=0)
        _, s, vt = np.linalg.svd(seen / scale, full_matrices=False)
        spread = (ahead / scale) @ (vt.T / s)
        result: Array = sigma * np.sqrt(np.sum(spread.reshape(-1, 3, len(s)) ** 2, axis=(1, 2)))
        return result

    def _terms(self, values: Array) -> list[Term]:
        return [
            Term(
                p["effect"],
                tuple(p["joints"]),
                t["coordinate"],
                t["expression"],
                float(v) * t["weight"],
                p["unit"],
            )
            for p, v in zip(self.kept, values, strict=True)
            for t in p["terms"]
        ]

    def _slopes(self, arm: Arm, q: Array, columns: Mapping[str, Array]) -> Array:
        """d position / d kept parameter, (3N, m); one parameter may drive several terms."""
        columns = dict(columns)
        terms = [
            Term(p["effect"], (), t["coordinate"], t["expression"], 0.0, "")
            for p in self.kept
            for t in p["terms"]
        ]
        slopes = sensitivity(arm, q, columns, terms)
        result = np.zeros((len(slopes), len(self.kept)))
        j = 0
        for i, p in enumerate(self.kept):
            for t in p["terms"]:
                result[:, i] += t["weight"] * slopes[:, j]
                j += 1
        return result


def _pose(content: Mapping[str, list[float]]) -> Pose:
    return Pose.from_xyz_rpy(content["xyz"], content["rpy"])
