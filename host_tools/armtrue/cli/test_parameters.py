import math

import pytest

from armtrue.cli.fitting import present_parameters
from armtrue.cli.shared.output import Output
from armtrue.notebook import nominal_value, nominal_words

MDH = {
    "convention": "mdh",
    "joints": [
        {"type": "revolute", "a": 0.0, "alpha": 0.0, "d": 0.8, "offset": 0.5},
        {"type": "revolute", "a": 0.35, "alpha": -math.pi / 2, "d": 0.1, "offset": 0.0},
    ],
}


@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [
        ("joint_offset[1]", 0.5, "rad"),
        ("link_geometry[1].tx", 0.35, "m"),
        ("link_geometry[1].ty", 0.1, "m"),
        ("link_geometry[1].tz", 0.0, "m"),
        ("link_geometry[1].rx", -math.pi / 2, "rad"),
        ("link_geometry[2].tx", 0.0, "m"),
    ],
)
def test_nominal_of_modified_dh_is_the_next_row_in_the_link_frame(name, value, unit):
    found = nominal_value(name, {"kinematics": MDH})
    assert found is not None
    assert found[0] == pytest.approx(value, abs=1e-12)
    assert found[1] == unit


def test_nominal_of_standard_dh_is_the_links_own_row():
    robot = {"kinematics": {**MDH, "convention": "dh"}}
    assert nominal_value("link_geometry[2].tx", robot) == (0.35, "m")
    assert nominal_value("link_geometry[2].tz", robot) == (0.1, "m")


def test_nominal_of_a_chain_is_next_joint_pose_or_the_end_pose():
    joints = [{"type": "revolute", "xyz": [0, 0, 0.4], "rpy": [0, 0, 0], "offset": 0.0}] * 2
    chain = {"convention": "chain", "joints": joints, "end": {"xyz": [0.0, 0.2, 0.0], "rpy": [0.1, 0.0, 0.0]}}
    assert nominal_value("link_geometry[1].tz", {"kinematics": chain}) == (0.4, "m")
    assert nominal_value("link_geometry[2].ty", {"kinematics": chain}) == (0.2, "m")
    found = nominal_value("link_geometry[2].rx", {"kinematics": chain})
    assert found is not None
    assert found[0] == pytest.approx(0.1)


def test_nominal_of_a_compliance_is_none():
    assert nominal_value("joint_compliance[2]", {"kinematics": MDH}) is None


def test_nominal_that_rounds_to_zero_has_no_minus_sign():
    joints = [{"type": "revolute", "offset": -1e-12, "a": 0.0, "alpha": 0.0, "d": 0.0}]
    assert (
        nominal_words("joint_offset[1]", {"kinematics": {"convention": "mdh", "joints": joints}}) == "0.000°"
    )


@pytest.mark.parametrize(
    ("held", "title"),
    [
        (2, "1 parameter, and 2 held at nominal"),
        (1, "2 parameters, and 1 held at nominal"),
        (0, "3 parameters"),
    ],
)
def test_title_counts_parameters_and_those_held_at_nominal(capsys, held, title):
    names = ("link_geometry[1].tx", "link_geometry[1].ty", "link_geometry[1].tz")
    entry = {"effect": "link_geometry", "value": 1e-3, "sigma": 1e-5, "unit": "m"}
    here = {"xyz": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
    document = {
        "robot": {"kinematics": MDH}, "measuring_from_base": here, "flange_from_tool": {"": here},
        "parameters": [{**entry, "name": name, "held": k < held} for k, name in enumerate(names)],
    }  # fmt: skip
    present_parameters(document, Output(None), everything=False)
    assert title in capsys.readouterr().out.splitlines()
