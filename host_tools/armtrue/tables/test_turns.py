"""Joints that turn further than once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.tables import FixedEngine, Reference, Surroundings, export, fitted_arm, layout
from armtrue.tables.conftest import Document, document
from armtrue.tables.export import ExportOptions

HELD_BEYOND_RAD = 7.88


def with_last_joint(text: str, **changes: Any) -> Document:
    """A fit with `text` on the last joint's motor side, that joint's row changed (None: the key left out)."""
    fit = document([("motor3", text, 1e-4)])
    row = fit["robot"]["kinematics"]["joints"][2]
    row |= changes
    for key in [key for key, value in row.items() if value is None]:
        del row[key]
    return fit


def difference_rad(fit: Document, q3: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Motor-side deflection of the last joint: the firmware's less the model's."""
    arm = fitted_arm(fit, "fit")
    joints = np.column_stack([np.zeros_like(q3), np.zeros_like(q3), q3])
    around = Surroundings({sensor: np.full(q3.size, 20.0) for sensor in arm.chain.sensors})
    reference = Reference(arm, "")
    exact = reference.coordinates(reference.state(joints, around))["motor3"]
    engine = FixedEngine(
        export(arm, ExportOptions()).image,
        arm.chain.prismatic,
        arm.chain.sensors,
        arm.chain.temperature_reference,
    )
    return np.asarray(engine.coordinates(joints, around)[:, layout.coordinate_number("motor3")] - exact)


@pytest.mark.parametrize("text", ["q3", "q3*q3", "atan2(q3, 2)"])
def test_without_limits_a_whole_turn_either_way_is_as_fitted(text: str) -> None:
    q3 = np.linspace(-2 * np.pi, 2 * np.pi, 41)
    assert np.abs(difference_rad(with_last_joint(text, limits=None), q3)).max() < 1e-8


def test_beyond_what_an_angle_can_be_only_what_grows_with_it_is_held() -> None:
    limits = [-3.0 * np.pi, 3.0 * np.pi]
    q3 = np.linspace(*limits, 61)
    assert np.abs(difference_rad(with_last_joint("sin(q3)", limits=limits), q3)).max() < 2e-9
    fit = with_last_joint("q3", limits=limits)
    difference = difference_rad(fit, q3)
    inside = np.abs(q3) <= HELD_BEYOND_RAD
    assert np.abs(difference[inside]).max() < 2e-9
    beyond = 1e-4 * (np.abs(q3[~inside]) - HELD_BEYOND_RAD)
    assert (np.abs(difference[~inside]) <= beyond + 2e-9).all()
    notes = export(fitted_arm(fit, "fit"), ExportOptions()).notes
    assert any("joint 3 turns from -9.42478 to 9.42478 rad" in note for note in notes)


def test_a_rail_that_is_too_long_is_refused() -> None:
    fit = with_last_joint("q3", type="prismatic", limits=[0.0, 9.0])
    with pytest.raises(InputError, match="joint 3 has limits 0 to 9 m, expected within ±7.88 m"):
        export(fitted_arm(fit, "fit"), ExportOptions())


@pytest.mark.parametrize(("lead_m", "travel_m"), [(0.005, 3.0), (0.02, 0.5), (0.002, 7.8)])
def test_waves_of_a_screw_are_as_fitted_all_along_a_rail(lead_m: float, travel_m: float) -> None:
    fit = with_last_joint(f"sin(2*pi*q3/{lead_m})", type="prismatic", limits=[0.0, travel_m])
    positions = np.linspace(0.0, travel_m, 4001)
    assert np.abs(difference_rad(fit, positions)).max() < 1e-8  # [m], of 1e-4
