"""URDFs: the chain that is read is compared with the forward kinematics of the URDF worked out joint by joint."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.io import load_robot
from armtrue.io.rotation import matrix_about, matrix_from_rpy

# Axes along -z, y and a tilted direction; fixed joints before, between and after the moving ones.
URDF = """<?xml version="1.0"?>
<robot name="odd">
  <link name="world"/>
  <link name="stand"><inertial><mass value="50"/></inertial></link>
  <link name="l1"><inertial><origin xyz="0 0 0.1"/><mass value="4"/></inertial></link>
  <link name="l2"/>
  <link name="l2_cover"><inertial><origin xyz="0 0 0"/><mass value="2"/></inertial></link>
  <link name="l3"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="1"/></inertial></link>
  <link name="flange"/>
  <joint name="bolt" type="fixed"><parent link="world"/><child link="stand"/>
    <origin xyz="0 0 0.5" rpy="0 0 0.3"/></joint>
  <joint name="j1" type="continuous"><parent link="stand"/><child link="l1"/><axis xyz="0 0 -1"/></joint>
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.1 0 0.3" rpy="0.2 0.1 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="1.5" effort="1" velocity="1"/></joint>
  <joint name="cover" type="fixed"><parent link="l2"/><child link="l2_cover"/><origin xyz="0 0 0.2"/></joint>
  <joint name="j3" type="prismatic"><parent link="l2_cover"/><child link="l3"/><origin xyz="0 0 0.1"/>
    <axis xyz="1 0 1"/><limit lower="0" upper="0.5" effort="1" velocity="1"/></joint>
  <joint name="end" type="fixed"><parent link="l3"/><child link="flange"/>
    <origin xyz="0 0 0.1" rpy="0 1.5707963267948966 0"/></joint>
</robot>
"""
ROBOT = "kinematics: {urdf: arm.urdf, base: world, tip: flange}\n"


def load(tmp_path: Path, urdf: str = URDF, robot: str = ROBOT):
    (tmp_path / "arm.urdf").write_text(urdf)
    path = tmp_path / "robot.yaml"
    path.write_text(robot)
    return load_robot(path)


def move(xyz, rpy=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, 3] = xyz
    matrix[:3, :3] = matrix_from_rpy(rpy)
    return matrix


def turn(axis, angle):
    """Rodrigues' formula, independent of the code under test."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return matrix


def frames_of_chain(spec, q):
    """Frames after each joint, and the end, by docs/model.md."""
    pose, frames = np.eye(4), []
    for joint, value in zip(spec["kinematics"]["joints"], q, strict=True):
        pose = pose @ move(joint["xyz"], joint["rpy"])
        if joint["type"] == "revolute":
            pose = pose @ np.block([[matrix_about("z", value), np.zeros((3, 1))], [np.zeros((1, 3)), 1]])
        else:
            pose = pose @ move([0, 0, value])
        frames.append(pose)
    end = spec["kinematics"]["end"]
    return frames, pose @ move(end["xyz"], end["rpy"])


def by_hand(q):
    """Poses of the three links and of the flange of the URDF above, joint by joint."""
    l1 = move([0, 0, 0.5], [0, 0, 0.3]) @ turn([0, 0, -1], q[0])
    l2 = l1 @ move([0.1, 0, 0.3], [0.2, 0.1, 0]) @ turn([0, 1, 0], q[1])
    l3 = l2 @ move([0, 0, 0.3]) @ move(np.array([1, 0, 1]) / math.sqrt(2) * q[2])
    return (l1, l2, l3), l3 @ move([0, 0, 0.1], [0, math.pi / 2, 0])


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0), (0.7, -1.1, 0.2), (-2.9, 1.4, 0.5)])
def test_chain_has_the_forward_kinematics_of_the_urdf(tmp_path, q):
    spec = load(tmp_path).spec
    frames, end = frames_of_chain(spec, q)
    links, end_by_hand = by_hand(q)
    np.testing.assert_allclose(end, end_by_hand, atol=1e-12)
    centres = [[0, 0, 0.1], [0, 0, 0.2], [0.1, 0.2, 0.3]]
    for frame, link, given, centre in zip(frames, links, spec["links"], centres, strict=True):
        np.testing.assert_allclose(
            frame @ np.append(given["com"], 1),
            link @ np.append(centre, 1),
            atol=1e-12,
            err_msg="centre of mass",
        )
    assert [link["mass"] for link in spec["links"]] == [4.0, 2.0, 1.0]


def test_limits_and_joint_types_are_read(tmp_path):
    joints = load(tmp_path).joints
    assert [joint["type"] for joint in joints] == ["revolute", "revolute", "prismatic"]
    assert "limits" not in joints[0]
    assert joints[1]["limits"] == [-2.0, 1.5]


def test_gear_ratios_are_given_beside_the_urdf(tmp_path):
    robot = load(tmp_path, robot=ROBOT.replace("}", ", gear_ratios: [100, 121, 50]}"))
    assert [joint["gear_ratio"] for joint in robot.joints] == [100.0, 121.0, 50.0]


def test_lead_of_a_prismatic_joint_is_given_beside_the_urdf(tmp_path):
    text = ROBOT.replace("}", ", gear_ratios: [100, 121, 50], leads: {j3: 0.02}}")
    robot = load(tmp_path, robot=text)
    assert robot.joints[2]["lead"] == 0.02
    assert "gear_ratio" not in robot.joints[2]
    for wrong, names in (
        ("j2: 0.02", "leads.j2: found 0.02"),
        ("j4: 0.02", "leads.j4"),
        ("j3: 20", "millimetres"),
    ):
        with pytest.raises(InputError, match=names):
            load(tmp_path, robot=text.replace("j3: 0.02", wrong))


@pytest.mark.parametrize(
    ("urdf", "robot", "names"),
    [
        (URDF, ROBOT.replace("flange", "flnge"), "did you mean 'flange'"),
        (URDF, ROBOT.replace("base: world, tip: flange", "base: flange, tip: world"), "no chain of joints"),
        (URDF, ROBOT.replace("tip: flange", "tip: stand"), "no moving joint"),
        (URDF, ROBOT.replace("arm.urdf", "other.urdf"), "other.urdf: found no such file"),
        (URDF.replace('type="prismatic"', 'type="floating"'), ROBOT, "found type 'floating'"),
        (URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'), ROBOT, "joint 'j2' axis"),
        (
            URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="j2"/>'),
            ROBOT,
            "joint 'j2' mimic: found 'j2', expected another joint",
        ),
        (
            URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="j3" offset="a"/>'),
            ROBOT,
            "joint 'j2' mimic offset: found 'a'",
        ),
        (
            URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="bolt"/>'),
            ROBOT,
            "joint 'j2' mimic: found 'bolt', expected a joint of the chain",
        ),
        (URDF.replace('mass value="4"', 'mass value="-4"'), ROBOT, "found mass -4"),
        (
            URDF.replace('mass value="4"', 'mass value="four"'),
            ROBOT,
            "link 'l1' inertial mass value: found 'four'",
        ),
        (URDF.replace('value="4"', 'value="inf"'), ROBOT, "link 'l1' inertial mass value: found 'inf'"),
        (
            URDF.replace('xyz="0.1 0 0.3"', 'xyz="nan 0 0.3"'),
            ROBOT,
            "joint 'j2' origin xyz: found 'nan 0 0.3'",
        ),
        (
            URDF.replace('rpy="0.2 0.1 0"', 'rpy="0.2 0.1"'),
            ROBOT,
            "joint 'j2' origin rpy: .*three finite numbers",
        ),
        (URDF.replace('rpy="0.2 0.1 0"', 'rpy="0 ${pi} 0"'), ROBOT, "become a URDF by 'xacro"),
        (URDF.replace('xyz="0 1 0"', 'xyz="0 inf 0"'), ROBOT, "joint 'j2' axis xyz: found '0 inf 0'"),
        (URDF.replace('upper="1.5"', 'upper="1.5 2"'), ROBOT, "joint 'j2' limit upper: .*one finite number"),
        (
            URDF.replace('upper="1.5"', 'upper="150"'),
            ROBOT,
            r"arm.urdf: joint 'j2' limit: found lower .*, upper 150, expected radians \(these look like degrees\)",
        ),
        (URDF.replace('xyz="0.1 0.2 0.3"', 'xyz="0.1 0.2"'), ROBOT, "link 'l3' inertial origin xyz"),
        (URDF.replace('<link name="l2"/>', '<link name="l1"/>'), ROBOT, "link 'l1': found a second time"),
        (URDF.replace('<joint name="j2"', '<joint name="j1"'), ROBOT, "joint 'j1': found a second time"),
        (URDF.replace('<link name="l2"/>', ""), ROBOT, "joint 'j2' child: found 'l2', expected a link"),
        (URDF.replace('parent link="l1"', 'parent link="l9"'), ROBOT, "joint 'j2' parent: found 'l9'"),
        (
            URDF.replace('child link="l2_cover"', 'child link="l2"'),
            ROBOT,
            "is the child of joint 'j2' already",
        ),
        (URDF.replace("</robot>", ""), ROBOT, "no URDF that can be read"),
        ("not xml", ROBOT, "no URDF that can be read"),
        (URDF, ROBOT + "links: [{mass: 1}, {mass: 1}, {mass: 1}]\n", "expected them in one place"),
        (URDF, ROBOT.replace("}", ", gear_ratios: [100]}"), "a list of 3 ratios"),
    ],
)
def test_bad_urdf_is_refused_with_its_element(tmp_path, urdf, robot, names):
    with pytest.raises(InputError, match=names):
        load(tmp_path, urdf, robot)


def test_tags_of_xacro_and_simulators_are_ignored_silently(tmp_path, capfd):
    tags = '<xacro:property name="x" value="1"/><gazebo reference="l1"/><odd/></robot>'
    urdf = URDF.replace('name="odd"', 'name="odd" xmlns:xacro="http://www.ros.org/wiki/xacro"')
    assert load(tmp_path, urdf.replace("</robot>", tags)).joint_count == 3
    assert capfd.readouterr().err == ""


# j2 mimics j1, and j3 mimics j2: both follow j1.
MIMIC = URDF.replace(
    '<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="j1" multiplier="-0.5" offset="0.2"/>'
).replace('<axis xyz="1 0 1"/>', '<axis xyz="1 0 1"/><mimic joint="j2" multiplier="0.1" offset="0.05"/>')


def test_mimic_joints_are_passive_and_follow_the_urdf(tmp_path):
    robot = load(tmp_path, MIMIC)
    assert (robot.passive, robot.motors) == ([2, 3], [1])
    j1 = 0.7
    j2 = -0.5 * j1 + 0.2
    j3 = 0.1 * j2 + 0.05
    offsets = [joint["offset"] for joint in robot.joints]
    angles = robot.mechanical_coupling @ [j1, 0.0, 0.0] + offsets
    assert angles == pytest.approx([j1, j2, j3])
    # Limits apply to the angle that the couplings give, without the offset.
    assert robot.joints[1]["limits"] == pytest.approx([-2.2, 1.3])


def test_mimic_multiplier_applies_to_the_link_angle(tmp_path):
    robot = load(
        tmp_path,
        URDF.replace('<axis xyz="1 0 1"/>', '<axis xyz="1 0 1"/><mimic joint="j2" multiplier="0.1"/>'),
        ROBOT + "coupling: [{joint: 2, driving: 1, ratio: -1}]\n",
    )
    motors = np.array([0.4, 0.3, 0.0])
    links = robot.mechanical_coupling @ motors
    assert links == pytest.approx([0.4, -0.1, -0.01])


def test_mimic_repeated_as_coupling_in_robot_yaml_is_refused(tmp_path):
    with pytest.raises(InputError, match="found joint 2 driven by 1, which the URDF says by 'mimic'"):
        load(tmp_path, MIMIC, ROBOT + "coupling: [{joint: 2, driving: 1, ratio: -0.5}]\n")


def test_passive_joint_of_a_urdf_is_given_in_robot_yaml(tmp_path):
    robot = load(
        tmp_path,
        robot=ROBOT.replace("}", ", passive: [2], gear_ratios: [100, 50]}")
        + "coupling: [{joint: 2, driving: 1, ratio: -1}]\n",
    )
    assert robot.passive == [2]
    assert [joint.get("gear_ratio") for joint in robot.joints] == [100.0, None, 50.0]
