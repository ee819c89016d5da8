"""Names of effects."""

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
