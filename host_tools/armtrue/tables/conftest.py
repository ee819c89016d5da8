"""A small fit to compile expressions into, for the tests of this folder."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from armtrue.tables import FixedEngine, Reference, Surroundings, export, fitted_arm, layout, validate
from armtrue.tables.export import ExportOptions

Document = dict[str, Any]


def document(terms: list[tuple[str, str, float]], **robot: Any) -> Document:
    """A fit of a three-joint arm with `terms` (coordinate, expression, value)."""
    rows = ((0.0, 0.0, 0.4, 0.1, 3.0), (0.1, -1.5, 0.0, -1.5, 2.0), (0.6, 0.2, 0.1, 0.0, 2.5))
    joints = [
        dict(zip(("a", "alpha", "d", "offset"), row, strict=False))
        | {"name": str(k), "type": "revolute", "limits": [-row[-1], row[-1]]}
        for k, row in enumerate(rows, 1)
    ]
    masses = [{"mass": m, "com": [0.1, 0.02, 0.05]} for m in (30.0, 20.0, 10.0)]
    return {
        "robot": {
            "name": "small",
            "kinematics": {"convention": "mdh", "joints": joints},
            "links": masses,
            "temperature": {"reference": 20.0, "sensors": ["arm", "air"]},
            **robot,
        },
        "measuring_from_base": {"xyz": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]},
        "flange_from_tool": {"": {"xyz": [0.3, 0.0, 0.1], "rpy": [0.1, 0.2, 0.3]}},
        "payload_point": [0.3, 0.0, 0.1],
        "parameters": [
            {
                "name": f"p{i}",
                "effect": "custom",
                "value": value,
                "terms": [{"coordinate": coordinate, "expression": text, "weight": 1.0, "table": None}],
            }
            for i, (coordinate, text, value) in enumerate(terms)
        ],
    }


Worst = Callable[..., float]


@pytest.fixture
def worst_error() -> Worst:
    """Largest difference of a coordinate between the firmware's evaluation and NumPy's, over random states."""

    def worst(
        terms: list[tuple[str, str, float]],
        coordinate: str = "motor2",
        limits: tuple[float, float] | None = None,
        **robot: Any,
    ) -> float:
        fit = document(terms, **robot)
        for joint in fit["robot"]["kinematics"]["joints"] if limits else []:
            joint["limits"] = limits
        arm = fitted_arm(fit, "test")
        image = export(arm, ExportOptions()).image
        assert validate(image).accepted
        rng = np.random.default_rng(1)
        rows = 2000
        low, high = arm.chain.limits.T
        joints = rng.uniform(low, high, (rows, 3))
        around = Surroundings(
            {sensor: rng.uniform(5.0, 50.0, rows) for sensor in arm.chain.sensors},
            payload=rng.uniform(0.0, 25.0, rows),
            time=rng.uniform(0.0, 3e4, rows),
            direction=rng.choice([-1.0, 0.0, 1.0], (rows, 3)),
        )
        reference = Reference(arm, "")
        exact = reference.coordinates(reference.state(joints, around))[coordinate]
        engine = FixedEngine(image, arm.chain)
        found = engine.coordinates(joints, around)[:, layout.coordinate_number(coordinate)]
        assert np.abs(exact).max() > 1e-6
        return float(np.abs(found - exact).max())

    return worst
