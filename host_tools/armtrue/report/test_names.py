"""Names of effects on the page, on the workbench and in the terminal."""

import pytest

from armtrue import candidates
from armtrue.candidates import entry_of
from armtrue.candidates import name as called
from armtrue.report.gathered.steps import _names


def test_joints_of_one_effect_are_merged_but_pairs_are_not():
    effects = [("gear_mesh", (k,)) for k in (1, 2, 3)] + [("joint_coupling", (5, 4)), ("base_compliance", ())]
    assert _names(effects) == ["gear_mesh 1,2,3", "joint_coupling 5,4", "base_compliance"]


def test_name_of_a_candidate_includes_its_options():
    candidate = {"effect": "gear_mesh", "joints": [2], "options": {"cycles": [20.0]}}
    assert called(candidate) == "gear_mesh 2 (20 cycles a turn)"
    assert called({**candidate, "options": {"orders": [1, 2]}}) == "gear_mesh 2 (orders 1, 2)"


def test_labels_of_diagnose_are_written_like_the_page():
    assert called(entry_of("thermal_expansion 1,2,3,4,5,6")) == "thermal_expansion 1,2,3,4,5,6"
    assert called(entry_of("warm_up")) == "warm_up"
    assert called(entry_of("gear_mesh 1 cycles [192.55173045837515]")) == "gear_mesh 1 (192.55 cycles a turn)"
    assert called(entry_of("gear_mesh 2 orders [1.0,2.0]")) == "gear_mesh 2 (orders 1, 2)"


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
    assert called(candidate) == name


def test_labels_of_diagnose_are_found_and_spelled():
    mesh = {"effect": "gear_mesh", "joints": [6], "cycles": [171.3119657, 24.0]}
    assert candidates.label(mesh) == "gear_mesh 6 cycles [171.312,24]"
    assert called(candidates.entry_of(candidates.label(mesh))) == "gear_mesh 6 (171.31, 24 cycles a turn)"
    sentence = "backlash 3 or gear_mesh 6 cycles [24]: the data do not decide"
    assert (
        candidates.spelled(sentence) == "backlash 3 or gear_mesh 6 (24 cycles a turn): the data do not decide"
    )
    command = "armtrue add FIT gear_mesh --joints 6 --option 'cycles=[24]' --out FIT2"
    assert candidates.spelled(command) == command
