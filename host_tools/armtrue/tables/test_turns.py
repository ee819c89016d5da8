"""Joints with ranges of several turns, and prismatic joints with long travel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.tables import FixedEngine, Reference, Surroundings, export, fitted_arm, layout
from armtrue.tables.conftest import Document, document
from armtrue.tables.export import ExportOptions
from armtrue.tables.image import Image, describe


def with_last_joint(text: str, **changes: Any) -> Document:
    """A fit with `text` on the last joint's motor side; `changes` replace keys of its row (None removes a key)."""
    fit = document([("motor3", text, 1e-4)])
    row = fit["robot"]["kinematics"]["joints"][2]
    row |= changes
    for key in [key for key, value in row.items() if value is None]:
        del row[key]
    return fit


def with_table(nodes: list[float], **changes: Any) -> Document:
    """A fit with a table over q3 on the last joint's motor side, its values alternating."""
    fit = with_last_joint("q3", **changes)
    padded = [2.0 * nodes[0] - nodes[1], *nodes, 2.0 * nodes[-1] - nodes[-2]]
    fit["parameters"] = [
        {
            "name": f"transmission_pwl[3].node{i + 1}",
            "effect": "transmission_pwl",
            "value": 1e-4 * (-1.0) ** i,
            "terms": [
                {
                    "coordinate": "motor3",
                    "expression": f"hat(q3, {padded[i]!r}, {node!r}, {padded[i + 2]!r})",
                    "weight": 1.0,
                    "table": {
                        "id": "transmission_pwl[3]",
                        "index": [i],
                        "axes": [{"variable": "q3", "nodes": nodes}],
                    },
                }
            ],
        }
        for i, node in enumerate(nodes)
    ]
    return fit


def difference_rad(
    fit: Document, q3: np.ndarray[Any, Any], q2: np.ndarray[Any, Any] | None = None
) -> np.ndarray[Any, Any]:
    """Motor-side deflection of the last joint: the firmware's less the model's. `q2`: zero if not given."""
    arm = fitted_arm(fit, "fit")
    joints = np.column_stack([np.zeros_like(q3), np.zeros_like(q3) if q2 is None else q2, q3])
    around = Surroundings({sensor: np.full(q3.size, 20.0) for sensor in arm.chain.sensors})
    reference = Reference(arm, "")
    exact = reference.coordinates(reference.state(joints, around))["motor3"]
    engine = FixedEngine(export(arm, ExportOptions()).image, arm.chain)
    return np.asarray(engine.coordinates(joints, around)[:, layout.coordinate_number("motor3")] - exact)


@pytest.mark.parametrize("text", ["q3", "q3*q3", "atan2(q3, 2)"])
def test_joint_without_limits_matches_the_fit_within_one_turn(text: str) -> None:
    q3 = np.linspace(-2 * np.pi, 2 * np.pi, 41)
    assert np.abs(difference_rad(with_last_joint(text, limits=None), q3)).max() < 1e-8


@pytest.mark.quick("2.006-q3", "6.0-sin(th3/8) + th3", "6.0-atan2(q3, 2)")
@pytest.mark.parametrize(
    "text", ["sin(q3)", "q3", "q3*q3/10", "th3", "cos(q3/8)", "sin(th3/8) + th3", "atan2(q3, 2)"]
)
@pytest.mark.parametrize("turns", [1.5, 2.006, 6.0])
def test_angles_of_several_turns_match_the_fit(text: str, turns: float) -> None:
    end = 2.0 * np.pi * turns
    fit = with_last_joint(text, limits=[-end, end], offset=0.3)
    made = export(fitted_arm(fit, "fit"), ExportOptions())
    assert made.notes == []
    assert np.abs(difference_rad(fit, np.linspace(-end, end, 241))).max() < 2e-8  # [rad], of 1e-4 a radian


def test_table_over_several_turns_matches_the_fit() -> None:
    nodes = [-9.386874656979586, -3.0, 1.0, 5.0, 12.5]
    fit = with_table(nodes, limits=[-12.6, 12.6])
    assert np.abs(difference_rad(fit, np.linspace(-12.6, 12.6, 241))).max() < 1e-8
    (table,) = describe(Image(export(fitted_arm(fit, "fit"), ExportOptions()).image))["tables"]
    (axis,) = table["axes"]
    assert (axis["variable"], axis["nodes"]) == ("q3", 5)
    assert [axis["from"], axis["to"]] == pytest.approx([nodes[0], nodes[-1]], abs=1e-6)


def test_link_angle_beyond_its_motor_by_coupling_matches_the_fit() -> None:
    fit = with_last_joint("th3", limits=[-6.0, 6.0])
    fit["robot"]["kinematics"]["joints"][1]["limits"] = [-6.0, 6.0]
    fit["robot"]["coupling"] = [{"joint": 3, "driving": 2, "ratio": -1.0}]
    turns = np.linspace(-6.0, 6.0, 41)
    assert np.abs(difference_rad(fit, turns, q2=-turns)).max() < 2e-8


def test_table_beyond_the_limits_names_effect_angle_and_remedy() -> None:
    arm = fitted_arm(with_table([-9.5, 0.0, 9.0], limits=[-2.0, 2.0]), "fit")
    with pytest.raises(InputError) as caught:
        export(arm, ExportOptions(), "fit.json")
    assert str(caught.value).startswith(
        "fit.json: cannot be exported: table transmission_pwl[3] over q3: a table node at -9.5, expected within ±8 "
        "(wider limits of the joint in robot.yaml, and a new fit, allow more); take the effect out with"
    )


def test_prismatic_joint_with_too_long_travel_is_refused() -> None:
    fit = with_last_joint("q3", type="prismatic", limits=[0.0, 9.0])
    message = (
        "joint 3 has limits 0 to 9 m, expected within ±7.88 m, .*; give robot.yaml the limits of the part"
    )
    with pytest.raises(InputError, match=message):
        export(fitted_arm(fit, "fit"), ExportOptions())


@pytest.mark.parametrize(("lead_m", "travel_m"), [(0.005, 3.0), (0.02, 0.5), (0.002, 7.8)])
def test_screw_waves_match_the_fit_along_the_whole_travel(lead_m: float, travel_m: float) -> None:
    fit = with_last_joint(f"sin(2*pi*q3/{lead_m})", type="prismatic", limits=[0.0, travel_m])
    positions = np.linspace(0.0, travel_m, 4001)
    assert np.abs(difference_rad(fit, positions)).max() < 1e-8  # [m]; the wave is 1e-4
