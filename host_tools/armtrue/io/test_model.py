from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.io import load_model
from armtrue.io.catalogue import catalogue
from armtrue.io.model import check_effect, coordinate_names, refusal_words, state_names


def load(tmp_path: Path, robot, text: str):
    path = tmp_path / "model.yaml"
    path.write_text(text)
    return load_model(path, robot)


CUSTOM = "{effect: custom, name: mine, coordinate: motor1, expression: sin(q1)"


def test_entries_are_normalised_and_defaults_added(tmp_path, two_joints):
    model = load(
        tmp_path,
        two_joints,
        "effects:\n- base_frame\n- {effect: joint_offset, joints: [2]}\n"
        "- {effect: gear_mesh, joints: [1], orders: [1, 2.5]}\n",
    )
    assert model.effects == [
        {"effect": "base_frame"},
        {"effect": "joint_offset", "joints": [2]},
        {"effect": "gear_mesh", "joints": [1], "orders": [1.0, 2.5]},
    ]
    assert model.priors == {"angle_deg": 0.3, "length_mm": 2.0}
    assert model.parameters == {}
    assert model.instrument is None


def test_fixed_parameters_and_priors_are_read(tmp_path, two_joints):
    model = load(
        tmp_path,
        two_joints,
        "effects: [joint_offset]\n"
        "parameters: {'joint_offset[1]': {fixed: 1e-3}, 'joint_offset[2]': {prior: 0, sigma: 1e-4}}\n"
        "priors: {angle_deg: 1}\n",
    )
    assert model.parameters == {
        "joint_offset[1]": {"fixed": 1e-3},
        "joint_offset[2]": {"prior": 0.0, "sigma": 1e-4},
    }
    assert model.priors == {"angle_deg": 1.0, "length_mm": 2.0}


def test_custom_effect_is_read(tmp_path, two_joints):
    model = load(tmp_path, two_joints, f"effects: [{CUSTOM}*k, parameters: {{k: 2}}, unit: rad}}]\n")
    assert model.effects == [
        {
            "effect": "custom",
            "name": "mine",
            "coordinate": "motor1",
            "expression": "sin(q1)*k",
            "parameters": {"k": 2.0},
            "unit": "rad",
        }
    ]


def test_effect_may_repeat_with_other_joints_or_options(tmp_path, two_joints):
    text = """effects:
- {effect: joint_offset, joints: [1]}
- {effect: joint_offset, joints: [2]}
- {effect: gear_mesh, joints: [1], orders: [1]}
- {effect: gear_mesh, joints: [1], orders: [3]}
"""
    assert len(load(tmp_path, two_joints, text).effects) == 4


def test_pairs_may_share_a_joint_but_not_both(tmp_path, two_joints):
    pair = "{effect: joint_coupling, joints: [%s]}"
    text = f"effects: [{pair % '1, 2'}, {pair % '2, 1'}]"
    assert [entry["joints"] for entry in load(tmp_path, two_joints, text).effects] == [[1, 2], [2, 1]]
    with pytest.raises(InputError, match="found joint_coupling a second time"):
        load(tmp_path, two_joints, f"effects: [{pair % '1, 2'}, {pair % '1, 2'}]")


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("effects: joint_offset", "effects: found 'joint_offset', expected a list of effects"),
        ("effects: []", "at least one effect"),
        ("effects: [3]", "effects[1]"),
        ("effects: [joint_ofset]", "did you mean 'joint_offset'"),
        (
            "effects: [joint_offset, joint_offset]",
            "effects[2]: found joint_offset a second time (first as effects[1])",
        ),
        ("effects: [{effect: base_frame, joints: [1]}]", "expected no joints"),
        ("effects: [{effect: joint_offset, joints: [3]}]", "different joint numbers from 1 to 2"),
        ("effects: [{effect: joint_offset, joints: [1, 1]}]", "different joint numbers"),
        ("effects: [{effect: joint_offset, joints: 1}]", "a list of different joint numbers"),
        ("effects: [{effect: joint_coupling, joints: [1]}]", "a list of 2 different"),
        ("effects: [{effect: gear_mesh, orders: 1}]", "orders: found 1, expected a list of numbers"),
        ("effects: [{effect: gear_mesh, find: 1}]", "find: found 1, expected true or false"),
        ("effects: [{effect: gear_harmonics, orders: [1.5]}]", "whole numbers"),
        (f"effects: [{CUSTOM}, joint: 1}}]", "a key that does not belong here"),
        (f"effects: [{CUSTOM.replace('sin(q1)', 'sin(')}}}]", "effects[1].expression: found 'sin('"),
        (f"effects: [{CUSTOM.replace('sin(q1)', 'dT_oil')}}}]", "dT_oil"),
        (f"effects: [{CUSTOM.replace('motor1', 'motor3')}}}]", "did you mean 'motor"),
        ("effects: [joint_offset]\nparameters: {a: {prior: 1}}", "parameters.a.sigma: found nothing"),
        ("effects: [joint_offset]\nparameters: {a: {fixed: 1, prior: 1}}", "does not belong here"),
        ("effects: [joint_offset]\npriors: {angle_deg: 0}", "above 0"),
        ("effects: [joint_offset]\npriors: {angle: 1}", "did you mean 'angle_deg'"),
        ("effects: [joint_offset]\ninstrument: {radial: {a: 1e-5}}", "instrument.angular: found nothing"),
        (
            "effects: [joint_offset]\ninstrument: {radial: {a: 0}, angular: {a: 1}}",
            "instrument.radial.a: found 0",
        ),
    ],
)
def test_bad_model_is_refused_with_its_key(tmp_path, two_joints, text, names):
    with pytest.raises(InputError) as error:
        load(tmp_path, two_joints, text)
    assert names in str(error.value)
    assert "model.yaml" in str(error.value)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (
            "model: parameters names 'joint_complianc[2]', which no effect of the model has",
            "parameters: found 'joint_complianc[2]', expected the name of a parameter of its effects (did you mean "
            "'joint_compliance[2]'?)",
        ),
        (
            "model: term '1/(q1 - q1)' of custom.c is not finite at measurement 2",
            "effects[2].expression: found '1/(q1-q1)', expected an expression with a finite value at every pose: that "
            "of row 7 has none",
        ),
        ("effect backlash: no", "effect backlash: no"),
    ],
)
def test_message_of_the_fitter_is_translated_to_the_model_key(message, words):
    effects = [{"effect": "base_frame"}, {"effect": "custom", "name": "c", "expression": "1/(q1-q1)"}]
    names = ["joint_compliance[2]", "joint_offset[2]", "custom.c"]
    assert refusal_words(message, effects, names, np.array([4, 7])) == words


def test_effect_already_in_the_model_cannot_be_added(two_joints):
    already = [{"effect": "joint_offset"}, {"effect": "backlash", "joints": [1]}]
    assert check_effect({"effect": "backlash", "joints": [2]}, two_joints, "add", already)["joints"] == [2]
    for entry in ({"effect": "joint_offset"}, {"effect": "backlash", "joints": [1, 2]}):
        with pytest.raises(InputError, match="in the model already"):
            check_effect(entry, two_joints, "add", already)


def test_catalogue_lists_exactly_the_documented_effects():
    contract = {
        "base_frame",
        "tool_offset",
        "joint_offset",
        "link_geometry",
        "joint_scale",
        "joint_compliance",
        "stiffness_nonlinear",
        "bending_compliance",
        "base_compliance",
        "gravity_balancer",
        "gear_harmonics",
        "gear_mesh",
        "transmission_pwl",
        "backlash",
        "joint_coupling",
        "parallelogram",
        "thermal_expansion",
        "thermal_joint_drift",
        "thermal_base",
        "warm_up",
        "time_drift",
        "command_readback",
        "residual_grid",
        "mass_parameters",
        "gravity_direction",
        "axis_wobble",
        "cross_compliance",
        "coupling_harmonics",
        "thermal_gradient",
        "hysteresis",
        "self_heating",
        "balancer_state",
        "axis_straightness",
        "tracker_scale",
        "tracker_angles",
        "station",
        "nest",
        "custom",
    }
    assert set(catalogue()) == contract
    of_the_measurement = {effect for effect, info in catalogue().items() if not info.exported}
    of_the_instrument = {"tracker_scale", "tracker_angles", "station", "nest"}
    of_the_session = {"base_frame", "tool_offset", "time_drift", "command_readback"}
    assert of_the_measurement == of_the_session | of_the_instrument


def test_coordinate_and_state_names_are_those_documented(two_joints):
    assert {"motor2", "base.tx", "link1.rz", "tool.ry"} <= set(coordinate_names(2))
    names = set(state_names(two_joints))
    assert {"q1", "th2", "qr1", "tau2", "gmx1", "bmy", "dT", "dT_arm", "payload", "dir2", "time"} <= names
    assert {"u_1_2_m", "ux_0_1_z", "up_2", "upx_0"} <= names
    assert "q3" not in names


@pytest.mark.parametrize("name", ["q1", "th2", "dT_arm", "pi", "sin"])
def test_custom_parameter_with_a_reserved_name_is_refused(name, tmp_path, two_joints):
    path = tmp_path / "model.yaml"
    path.write_text(f"effects:\n- {CUSTOM}, parameters: {{{name}: 0.001}}}}\n")
    with pytest.raises(
        InputError, match=rf"model\.yaml: effects\[1\]\.parameters\.{name}: found the name of a state"
    ):
        load_model(path, two_joints)
