"""Names of effects on the page and in the terminal."""

from __future__ import annotations

import pytest

from armtrue import candidates
from armtrue.workbench.showing.names import called, named


@pytest.mark.parametrize(
    ("candidate", "name"),
    [
        (
            {"effect": "bending_compliance", "joints": [1], "options": {"shape": "beam"}},
            "bending_compliance 1, shape beam",
        ),
        (
            {"effect": "gear_mesh", "joints": [6], "options": {"cycles": [171.3119657]}},
            "gear_mesh 6, 171.312 cycles a turn",
        ),
        (
            {"effect": "stiffness_nonlinear", "joints": [2], "options": {"soft": True, "soft_torque": 12.5}},
            "stiffness_nonlinear 2, soft",
        ),
        ({"effect": "gear_mesh", "joints": [3], "options": {"orders": [13.0]}}, "gear_mesh 3, order 13"),
        ({"effect": "gear_mesh", "joints": [1], "wavelengths": [0.06]}, "gear_mesh 1, waves of 60 mm"),
        ({"effect": "joint_compliance", "joints": [2]}, "joint_compliance 2"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_named_has_the_options_of_the_variant_in_short_figures(candidate, name):
    assert named(candidate) == name


def test_terminal_name_has_the_variant_and_the_sensor_if_needed():
    soft = {"effect": "stiffness_nonlinear", "joints": [2], "options": {"soft": True, "soft_torque": 12.5}}
    assert candidates.called(soft) == "stiffness_nonlinear [2], soft"
    warm = [{"effect": "thermal_expansion", "joints": [], "options": {"sensor": name}} for name in ("a", "b")]
    assert candidates.called(warm[0]) == "thermal_expansion"
    assert candidates.called(warm[0], warm) == "thermal_expansion, sensor a"


def test_called_keeps_all_figures_as_the_diagnosis_does():
    assert (
        called({"effect": "gear_mesh", "joints": [6], "cycles": [171.3119657]})
        == "gear_mesh 6 cycles [171.3119657]"
    )
