"""Names of effects on the page and in the terminal."""

from __future__ import annotations

import pytest

from armtrue import candidates
from armtrue.candidates import label as called
from armtrue.candidates import name as named


@pytest.mark.parametrize(
    ("candidate", "name"),
    [
        (
            {"effect": "bending_compliance", "joints": [1], "options": {"shape": "beam"}},
            "bending_compliance 1 (shape beam)",
        ),
        (
            {"effect": "gear_mesh", "joints": [6], "options": {"cycles": [171.3119657]}},
            "gear_mesh 6 (171.31 cycles a turn)",
        ),
        (
            {"effect": "stiffness_nonlinear", "joints": [2], "options": {"soft": True, "soft_torque": 12.5}},
            "stiffness_nonlinear 2 (soft, soft_torque 12.5 Nm)",
        ),
        ({"effect": "gear_mesh", "joints": [3], "options": {"orders": [13.0]}}, "gear_mesh 3 (order 13)"),
        (
            {"effect": "gear_mesh", "joints": [2], "options": {"wavelengths": [0.06, 0.0123]}},
            "gear_mesh 2 (waves of 60, 12.3 mm)",
        ),
        (
            {"effect": "self_heating", "joints": [3], "options": {"tau": 500.0, "sensor": "arm"}},
            "self_heating 3 (tau 500 s, sensor arm)",
        ),
        ({"effect": "custom", "joints": [2], "name": "odd", "expression": "sin(q2)"}, "custom 2 (odd)"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_name_has_the_options_of_the_variant_in_short_figures(candidate, name):
    assert named(candidate) == name


def test_labels_of_diagnose_are_found_and_spelled():
    mesh = {"effect": "gear_mesh", "joints": [6], "cycles": [171.3119657, 24.0]}
    assert called(mesh) == "gear_mesh 6 cycles [171.312,24]"
    assert named(candidates.entry_of(called(mesh))) == "gear_mesh 6 (171.31, 24 cycles a turn)"
    sentence = "backlash 3 or gear_mesh 6 cycles [24]: the data do not decide"
    assert (
        candidates.spelled(sentence) == "backlash 3 or gear_mesh 6 (24 cycles a turn): the data do not decide"
    )
    command = "armtrue add FIT gear_mesh --joints 6 --option 'cycles=[24]' --out FIT2"
    assert candidates.spelled(command) == command
