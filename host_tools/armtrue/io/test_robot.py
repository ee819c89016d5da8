import re
from pathlib import Path

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.io import load_robot
from armtrue.io.conftest import LEVEL, TWO_JOINTS


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    return path


def test_defaults_are_added_and_given_values_kept(tmp_path):
    robot = load_robot(written(tmp_path, TWO_JOINTS))
    first, second = robot.joints
    assert first == {
        "name": "A1",
        "type": "revolute",
        "a": 0.0,
        "alpha": 0.0,
        "d": 0.4,
        "offset": 0.0,
        "gear_ratio": 100.0,
        "limits": [-3.0, 3.0],
    }
    assert "gear_ratio" not in second
    assert robot.spec["gravity"] == [0.0, 0.0, -9.81]
    assert robot.spec["coupling"] == []
    assert robot.sensors == ["arm"]
    assert robot.joint_count == 2
    assert robot.reach_m == pytest.approx(0.5)


def test_robot_without_a_name_is_named_after_its_file(tmp_path):
    assert load_robot(written(tmp_path, TWO_JOINTS.replace("name: two\n", ""))).spec["name"] == "robot"


def test_yaml_scalars_follow_version_1_2(tmp_path):
    text = TWO_JOINTS.replace("d: 0.4", "d: 4e-1").replace("name: A1", "name: no")
    robot = load_robot(written(tmp_path, text))
    assert robot.joints[0]["d"] == 0.4
    assert robot.joints[0]["name"] == "no"


def test_surrogate_pair_in_yaml_is_read_as_one_character(tmp_path):
    assert load_robot(written(tmp_path, TWO_JOINTS.replace("two", '"\\ud83d\\ude00"'))).spec["name"] == "😀"


def test_chain_robot_written_as_json_reads_back_alike(tmp_path):
    import json

    text = """\
kinematics:
  convention: chain
  joints:
  - {xyz: [0, 0, 0.4]}
  - {xyz: [0.1, 0, 0], rpy: [-1.5707963, 0, 0], type: prismatic, limits: [0, 0.5]}
  end: {xyz: [0, 0, 0.2]}
"""
    robot = load_robot(written(tmp_path, text))
    again = load_robot(written(tmp_path, robot.json()))
    assert again.spec == robot.spec == json.loads(robot.json())
    assert robot.reach_m == pytest.approx(0.4 + 0.1 + 0.5 + 0.2)


@pytest.mark.parametrize(
    ("found", "put", "names"),
    [
        ("alpha: 0.0", "alhpa: 0.0", "kinematics.joints[1].alpha"),
        ("alpha: 0.0, d", "alpha: 90.0, d", "kinematics.joints[1].alpha: found 90.0"),
        ("d: 0.4", "d: 400.0", "millimetres"),
        ("d: 0.4", "d: .nan", "kinematics.joints[1].d: found nan"),
        ("d: 0.4", "d: four", "found 'four', expected a length in metres"),
        ("d: 0.4", "d: true", "found True, expected a length in metres"),
        ("[-3.0, 3.0]", "[3.0, -3.0]", "lo below hi"),
        ("[-3.0, 3.0]", "[-3.0]", "kinematics.joints[1].limits"),
        ("[-3.0, 3.0]", "[-170.0, 170.0]", "degrees"),
        ("name: A2", "name: A1", "kinematics.joints[2].name: found 'A1' a second time"),
        ("convention: mdh", "convention: mhd", "did you mean 'mdh'"),
        ("gear_ratio: 100", "gear_ratio: 0", "other than 0"),
        ("gear_ratio: 100", "gear_ration: 100", "did you mean 'gear_ratio'"),
        ("gear_ratio: 100", "lead: 0.02", "no lead of a joint that turns, but gear_ratio"),
        (
            "gear_ratio: 100",
            "type: prismatic, lead: 20",
            "found 20, expected metres per turn of the screw or pinion",
        ),
        ("gear_ratio: 100", "type: prismatic, lead: 0", "above 0"),
        ("limits: [-3.0, 3.0], gear_ratio: 100", "type: prismatic, limits: [0, 4000]", "millimetres"),
        ("name: two\n", "name: two\ntool: {xyz: [0, 0, 160]}\n", "tool.xyz: found [0, 0, 160]"),
        ("name: two\n", "name: two\nbase: {xyz: [2351, 0, 0]}\n", "none beyond 1000"),
        ("name: two\n", "name: two\npayload: {com: [0, 0, 80]}\n", "payload.com: found [0, 0, 80]"),
        ("gear_ratio: 100", "type: prismatic, lead: 0.02, gear_ratio: 314", "lead alone"),
        ("temperature:", "temprature:", "did you mean 'temperature'"),
        ("sensors: [arm]", "sensors: [arm, arm]", "'arm' a second time"),
        ("sensors: [arm]", "sensors: arm", "a list of sensor names"),
        ("reference: 20.0", "reference: -300", "temperature.reference"),
        ("name: two\n", "name: two\nurdf: x\n", "does not belong here"),
        ("  convention: mdh\n", "  convention: mdh\n  urdf: arm.urdf\n", "found beside 'urdf'"),
        ("kinematics:", "kinematcs:", "there is 'kinematcs'"),
        ("name: two\n", "name: two\nname: three\n", "the key 'name' a second time"),
        ("name: two\n", "name: two\nlinks: [{mass: 1}]\n", "found 1 link, expected 2"),
        ("name: two\n", "name: two\nlinks: [{mass: 1}, {mass: -1}]\n", "links[2].mass: found -1"),
        ("name: two\n", "name: two\ngravity: [0, 0, 0]\n", "gravity"),
        (
            "name: two\n",
            "name: two\ncoupling: [{joint: 3, driving: 2, ratio: -1}]\n",
            "joint number from 1 to 2",
        ),
        (
            "name: two\n",
            "name: two\ncoupling: [{joint: 2, driving: 2, ratio: -1}]\n",
            "other than the driven",
        ),
        ("name: two\n", "name: two\ntool: {xyz: [0, 0]}\n", "tool.xyz"),
        ("sensors: [arm]", "sensors: [link 2]", "such as 'link_2'"),
        ("sensors: [arm]", "sensors: ['°']", "such as 'arm'"),
        ("name: two\n", "name: two\nbase: {xyz: [0, 0, 0], rpy: [0, 0, 90]}\n", "degrees"),
        (
            "name: two\n",
            "name: two\nlinkage: {type: parallelogram, joints: [2, 3], angle: 1.5}\n",
            "linkage.joints: found [2, 3]",
        ),
    ],
)
def test_bad_robot_file_is_refused_with_its_key(tmp_path, found, put, names):
    assert found in TWO_JOINTS
    path = written(tmp_path, TWO_JOINTS.replace(found, put, 1))
    with pytest.raises(InputError) as error:
        load_robot(path)
    assert names in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", "found nothing"),
        ("- a\n", "expected keys"),
        ("a: [1\n", "line 2"),
        ("a: &x [*x]\n", "aliases that write out"),
        ("a: !!python/object:os.system x\n", "expected YAML"),
        ("? [1, 2]\n: 3\n", "a key that is not text"),
        ("a:\n\tb: 1\n", "line 2: found character"),
        ("[" * 5000, "nested too deep"),
        ("name: \x00\n", "no YAML"),
        ('name: "\\ud83d"\n', "line 1: found half of a pair of surrogates"),
    ],
)
def test_file_that_is_no_robot_yaml_is_refused(tmp_path, text, names):
    with pytest.raises(InputError, match=names):
        load_robot(written(tmp_path, text))


def test_missing_file_and_folder_are_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.yaml: found no such file"):
        load_robot(tmp_path / "nowhere.yaml")
    with pytest.raises(InputError, match="found a folder"):
        load_robot(tmp_path)


def test_a_passive_joint_has_no_motor_and_needs_no_limits(tmp_path):
    robot = load_robot(written(tmp_path, LEVEL))
    assert (robot.passive, robot.motors) == ([3], [1, 2])
    assert "limits" not in robot.joints[2]
    np.testing.assert_array_equal(robot.mechanical_coupling[2], [-1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "coupling: [",
            "unused: [",
            "coupling: found no row for joint 3, which is passive, expected what turns it",
        ),
        ("passive: true", "passive: yes", "passive: found 'yes', expected true or false"),
        ("passive: true", "passive: true, gear_ratio: 80", "gear_ratio: found 80, expected no gear_ratio"),
        ("ratio: -1}]", "ratio: -1, kind: controller}]", "kind: found 'controller', expected 'mechanical'"),
        ("driving: 2", "driving: 3", "driving: found 3, expected a joint"),
        ("name: A1,", "name: A1, passive: true,", "driving: found 1, expected a joint with a motor"),
    ],
)
def test_bad_passive_joint_is_refused_with_its_key(tmp_path, old, new, words):
    with pytest.raises(InputError, match=re.escape(words)):
        load_robot(written(tmp_path, LEVEL.replace(old, new)))
