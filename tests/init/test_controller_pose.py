"""A controller's own pose beside the points of an instrument is left out: it is not a second reflector."""

from __future__ import annotations

import numpy as np
import pytest
from armtrue.cli.test_check import angles_of
from armtrue.errors import InputError
from armtrue.io import load_data, load_robot
from armtrue.tables.chain import chain_from_robot, pose
from foreign_files import Campaign, named, read, write

# Column names of controllers and instruments; where they do not tell, the numbers decide.
HEADERS = [
    (["TCP X", "TCP Y", "TCP Z"], ["Leica X", "Leica Y", "Leica Z"]),
    (["robot_x", "robot_y", "robot_z"], ["tracker_x", "tracker_y", "tracker_z"]),
    (["X", "Y", "Z"], ["X_LT", "Y_LT", "Z_LT"]),
    (["X_cmd", "Y_cmd", "Z_cmd"], ["X_laser", "Y_laser", "Z_laser"]),
    (["X_act", "Y_act", "Z_act"], ["X_laser", "Y_laser", "Z_laser"]),
    (["Cart X", "Cart Y", "Cart Z"], ["X", "Y", "Z"]),
    (["Tool pose X", "Tool pose Y", "Tool pose Z"], ["SMR X", "SMR Y", "SMR Z"]),
    (["P X", "P Y", "P Z"], ["M X", "M Y", "M Z"]),
]


def euler(poses: np.ndarray, sequence: str) -> np.ndarray:
    return np.array([angles_of(turned[:3, :3], sequence, True) for turned in poses])


def tracker_alone(found, points: np.ndarray) -> None:
    assert "target" not in found.data.columns, found.said
    np.testing.assert_allclose(found.data.positions_m, points, atol=1e-8)
    assert not [finding for finding in found.findings if finding.severity == "error"], found.findings


@pytest.mark.parametrize(("own", "measured"), HEADERS)
@pytest.mark.parametrize("aligned", [False, pytest.param(True, marks=pytest.mark.full)])
def test_pose_of_nominal_kinematics_is_left_out(tmp_path, campaign: Campaign, own, measured, aligned):
    points = campaign.in_base() if aligned else campaign.points
    sets = [named(own, np.round(1e3 * campaign.own[:, :3, 3], 3)), named(measured, 1e3 * points)]
    # Each of the two comes first in one of the files.
    columns = sets[aligned] | sets[not aligned]
    found = read(campaign, tmp_path, write(tmp_path / "m.csv", campaign.joint_columns() | columns))
    tracker_alone(found, points)
    assert f"{', '.join(own)}: not taken, as they are the controller's own pose" in found.said
    assert "nominal kinematics of the joints within" in found.said
    assert ", ".join(measured) in found.said


def test_rounded_joints_do_not_hide_the_controller_pose(tmp_path, campaign: Campaign):
    """Rounded to 0.01° and 0.01 mm, as on a pendant, under names that do not tell."""
    file = write(
        tmp_path / "m.csv",
        campaign.joint_columns(digits=2)
        | named(["P X", "P Y", "P Z"], np.round(1e3 * campaign.own[:, :3, 3], 2))
        | named(["M X", "M Y", "M Z"], 1e3 * campaign.in_base()),
    )
    tracker_alone(read(campaign, tmp_path, file), campaign.in_base())


def calibrated(campaign: Campaign) -> np.ndarray:
    """The position by a calibrated controller, which corrects half of the deviation that the tracker finds."""
    return (campaign.own[:, :3, 3] + campaign.in_base()) / 2.0


def test_calibrated_controller_pose_is_recognised_by_name(tmp_path, campaign: Campaign):
    file = write(
        tmp_path / "m.csv",
        campaign.joint_columns()
        | named(["TCP X", "TCP Y", "TCP Z"], 1e3 * calibrated(campaign))
        | named(["Leica X", "Leica Y", "Leica Z"], 1e3 * campaign.in_base()),
    )
    found = read(campaign, tmp_path, file)
    tracker_alone(found, campaign.in_base())
    assert "TCP X, TCP Y, TCP Z: not taken, as they are the controller's own pose by their name" in found.said


def test_ambiguous_second_point_is_a_reflector_with_a_hint(tmp_path, campaign: Campaign):
    file = write(
        tmp_path / "m.csv",
        campaign.joint_columns()
        | named(["Flange X", "Flange Y", "Flange Z"], 1e3 * calibrated(campaign))
        | named(["B X", "B Y", "B Z"], 1e3 * campaign.in_base()),
    )
    found = read(campaign, tmp_path, file)
    assert found.data.labels["target"] == ["Flange", "B"]
    assert "2 reflectors, one below the other: Flange, B" in found.said
    assert "if 'Flange' is the controller's own pose" in found.said
    assert "rows: {where: {target: B}}" in found.said
    with (tmp_path / "arm" / "dataset.yaml").open("a") as stream:
        stream.write("rows: {where: {target: B}}\n")
    arm = load_robot(tmp_path / "arm" / "robot.yaml")
    data = load_data(tmp_path / "arm" / "dataset.yaml", arm)
    np.testing.assert_allclose(data.positions_m, campaign.in_base(), atol=1e-8)


def test_points_in_two_frames_with_neutral_names_are_refused(tmp_path, campaign: Campaign):
    file = write(
        tmp_path / "m.csv",
        campaign.joint_columns()
        | named(["A X", "A Y", "A Z"], 1e3 * calibrated(campaign))
        | named(["B X", "B Y", "B Z"], 1e3 * campaign.points),
    )
    with pytest.raises(
        InputError, match=r"m.csv header: found points 'A' and 'B', whose distance .* expected"
    ):
        read(campaign, tmp_path, file)
    assert not (tmp_path / "arm").exists()


def test_error_free_reflectors_stay_reflectors(tmp_path, campaign: Campaign):
    """Simulated reflectors: both follow nominal kinematics exactly, so neither is the controller's pose."""
    other = campaign.own[:, :3, :3] @ [0.1, 0.0, 0.05] + campaign.own[:, :3, 3]
    file = write(
        tmp_path / "m.csv",
        campaign.joint_columns()
        | named(["SMR1_x", "SMR1_y", "SMR1_z"], campaign.own[:, :3, 3])
        | named(["SMR2_x", "SMR2_y", "SMR2_z"], other),
    )
    assert read(campaign, tmp_path, file).data.labels["target"] == ["SMR1", "SMR2"]


def test_controller_pose_in_the_joints_file_is_left_out(tmp_path, campaign: Campaign):
    log = write(
        tmp_path / "log.csv",
        campaign.joint_columns() | named(["X", "Y", "Z"], np.round(1e3 * campaign.own[:, :3, 3], 3)),
    )
    tracker = write(tmp_path / "tracker.csv", named(["X", "Y", "Z"], 1e3 * campaign.points))
    found = read(campaign, tmp_path, log, tracker)
    tracker_alone(found, campaign.points)
    assert "log.csv: X, Y, Z: not taken, as they are the controller's own pose" in found.said


@pytest.mark.parametrize(
    ("point", "angles"),
    [(["TCP X", "TCP Y", "TCP Z"], ["TCP RX", "TCP RY", "TCP RZ"]), (["X", "Y", "Z"], ["A", "B", "C"])],
)
def test_orientation_of_the_controller_pose_is_left_out(tmp_path, campaign: Campaign, point, angles):
    turned = np.degrees(euler(campaign.own, "zyx"))
    file = write(
        tmp_path / "m.csv",
        campaign.joint_columns()
        | named(point, np.round(1e3 * campaign.own[:, :3, 3], 3))
        | named(angles, turned)
        | named(["Leica X", "Leica Y", "Leica Z"], 1e3 * campaign.in_base()),
    )
    found = read(campaign, tmp_path, file)
    assert "qw" not in found.data.columns, found.said
    assert f"{', '.join(angles)}: not taken, as they are the controller's own pose" in found.said


def test_instrument_orientation_is_taken_not_the_controllers(tmp_path, campaign: Campaign):
    spec = load_robot(campaign.robot).spec
    chain = chain_from_robot(spec)
    turned = pose(spec["base"]) @ chain.tool_poses(campaign.joints + 1e-3, pose(spec["tool"]))
    file = write(
        tmp_path / "m.csv",
        campaign.joint_columns()
        | named(["TCP X", "TCP Y", "TCP Z"], np.round(1e3 * campaign.own[:, :3, 3], 3))
        | named(["TCP RX", "TCP RY", "TCP RZ"], euler(campaign.own, "xyz"))
        | named(["X", "Y", "Z"], 1e3 * campaign.points)
        | named(["RX", "RY", "RZ"], euler(turned, "xyz")),
    )
    found = read(campaign, tmp_path, file)
    assert found.dataset["rotation"]["columns"] == ["RX", "RY", "RZ"], found.said


def test_nominal_points_alone_are_taken_with_a_note(tmp_path, campaign: Campaign):
    file = write(
        tmp_path / "m.csv",
        campaign.joint_columns() | named(["X", "Y", "Z"], np.round(1e3 * campaign.own[:, :3, 3], 3)),
    )
    found = read(campaign, tmp_path, file)
    np.testing.assert_allclose(found.data.positions_m, campaign.own[:, :3, 3], atol=1e-6)
    assert "as a controller's own pose does and no measured arm" in found.said


def test_numbered_tcp_pose_columns_are_left_out(tmp_path, campaign: Campaign):
    file = write(
        tmp_path / "m.csv",
        {f"actual_q_{k}": column for k, column in enumerate(campaign.joints.T)}
        | {f"target_TCP_pose_{k}": campaign.own[:, k, 3] for k in range(3)}
        | named(["x", "y", "z"], campaign.points),
    )
    found = read(campaign, tmp_path, file)
    tracker_alone(found, campaign.points)
    assert "target_TCP_pose_0: not taken, as by its name it is the controller's own pose" in found.said
    assert not found.dataset.get("variables")
