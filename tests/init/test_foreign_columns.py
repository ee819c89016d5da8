"""Each column is read by its own header and figures; each omitted column is named with its meaning."""

from __future__ import annotations

import numpy as np
import pytest
from armtrue.cli.test_check import angles_of
from armtrue.errors import InputError
from armtrue.io import load_robot
from armtrue.tables.chain import chain_from_robot, pose
from foreign_files import Campaign, named, read, write

FACTOR = {"mm": 1e3, "cm": 1e2, "m": 1.0, "deg": 180.0 / np.pi, "rad": 1.0}


def turned(campaign: Campaign) -> np.ndarray:
    """Tool poses in the measuring frame by nominal kinematics, with every joint 1 mrad off."""
    spec = load_robot(campaign.robot).spec
    chain = chain_from_robot(spec)
    return pose(spec["base"]) @ chain.tool_poses(campaign.joints + 1e-3, pose(spec["tool"]))


@pytest.mark.parametrize("units", [("mm", "mm", "m"), ("mm", "mm", "cm"), ("m", "cm", "mm")])
@pytest.mark.parametrize("with_comment", [False, pytest.param(True, marks=pytest.mark.full)])
def test_each_axis_of_a_point_has_the_unit_of_its_own_header(tmp_path, campaign, units, with_comment):
    columns = {
        f"{axis} [{unit}]": campaign.points[:, k] * FACTOR[unit]
        for k, (axis, unit) in enumerate(zip("XYZ", units, strict=True))
    }
    file = write(tmp_path / "m.csv", campaign.joint_columns() | columns)
    if with_comment:
        # init then rewrites the table, because no dataset.yaml can describe the file.
        file.write_text("# of an instrument\n" + file.read_text())
    found = read(campaign, tmp_path, file)
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)
    assert f"{', '.join(columns)}: {', '.join(units)}, each by its own, as its header says" in found.said


@pytest.mark.parametrize("units", [("rad", "deg", "deg"), ("deg", "deg", "rad")])
def test_each_angle_has_the_unit_of_its_own_header(tmp_path, campaign, units):
    wanted = np.array([angles_of(one[:3, :3], "xyz", True) for one in turned(campaign)])
    columns = {
        f"{name} [{unit}]": wanted[:, k] * FACTOR[unit]
        for k, (name, unit) in enumerate(zip(("Rx", "Ry", "Rz"), units, strict=True))
    }
    points = named(["X", "Y", "Z"], 1e3 * campaign.points)
    found = read(campaign, tmp_path, write(tmp_path / "m.csv", campaign.joint_columns() | points | columns))
    assert f"{', '.join(columns)}: {', '.join(units)}, each by its own, as its header says" in found.said
    np.testing.assert_allclose(found.data.turns, wanted, atol=1e-8)
    assert "as they then follow the arm within" in found.said


def test_point_column_in_degrees_is_refused_by_name(tmp_path, campaign):
    columns = named(["X [mm]", "Y [mm]", "Z [deg]"], 1e3 * campaign.points)
    file = write(tmp_path / "m.csv", campaign.joint_columns() | columns)
    with pytest.raises(InputError, match=r"found column 'Z \[deg\]' in deg, expected a unit of length"):
        read(campaign, tmp_path, file)


def quaternions(campaign: Campaign) -> np.ndarray:
    found = []
    for one in turned(campaign)[:, :3, :3]:
        values, vectors = np.linalg.eigh(
            np.array(
                [
                    [np.trace(one), *_skew(one)],
                    *(
                        [s, *row]
                        for s, row in zip(_skew(one), one + one.T - np.trace(one) * np.eye(3), strict=True)
                    ),
                ]
            )
        )
        found.append(vectors[:, np.argmax(values)])
    return np.array(found)


def _skew(one: np.ndarray) -> list[float]:
    return [one[2, 1] - one[1, 2], one[0, 2] - one[2, 0], one[1, 0] - one[0, 1]]


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("before", [False, pytest.param(True, marks=pytest.mark.full)])
def test_quaternion_named_like_joints_is_not_read_as_joints(tmp_path, campaign, first, before):
    names = [f"q{k}" for k in range(first, first + 4)]
    sets = [named(names, quaternions(campaign)), campaign.joint_columns()]
    columns = sets[not before] | sets[before] | named(["x", "y", "z"], campaign.points)
    found = read(campaign, tmp_path, write(tmp_path / "m.csv", columns))
    np.testing.assert_allclose(found.data.joints, campaign.joints, atol=1e-8)
    assert found.dataset["rotation"] == {"form": "quaternion", "columns": names, "order": "wxyz"}


def test_joints_under_two_names_are_read_once(tmp_path, campaign):
    """J1 … J6 and q1 … q6 are the same joints twice; neither set is a quaternion and two joints."""
    columns = campaign.joint_columns() | named([f"q{k}" for k in range(1, 7)], campaign.joints)
    found = read(
        campaign, tmp_path, write(tmp_path / "m.csv", columns | named(["x", "y", "z"], campaign.points))
    )
    assert "J1, J2, J3, J4, J5, J6: joints in deg" in found.said
    assert "rotation" not in found.dataset


WARM = 20.0 + 0.1 * np.arange(80)


@pytest.mark.parametrize(
    ("header", "values", "name"),
    [
        ("T1", WARM, "temp_t1"),
        ("Ambient [°C]", WARM, "temp_ambient"),
        ("T_arm", WARM, "temp_arm"),
        ("Umgebung", WARM, "temp_umgebung"),
        ("Gehäuse [°C]", WARM, "temp_gehause"),
        ("Temp F", 32.0 + 1.8 * WARM, "temp_air"),
        ("T2", 273.15 + WARM, "temp_t2"),
    ],
)
def test_thermometer_is_recognised_by_other_names(tmp_path, campaign, header, values, name):
    columns = campaign.joint_columns() | named(["x", "y", "z"], campaign.points) | {header: values}
    found = read(campaign, tmp_path, write(tmp_path / "m.csv", columns))
    np.testing.assert_allclose(found.data.columns[name], WARM, atol=1e-6)


def test_column_t1_without_temperatures_is_a_variable(tmp_path, campaign):
    columns = campaign.joint_columns() | named(["x", "y", "z"], campaign.points)
    file = write(tmp_path / "m.csv", columns | {"T1": 900.0 * np.sin(np.arange(80))})
    assert read(campaign, tmp_path, file).dataset["variables"] == {"T1": "T1"}


def test_missing_value_mark_is_refused_as_a_temperature(tmp_path, campaign):
    values = [-999 if at == 7 else 20 + 0.1 * at for at in range(80)]
    columns = campaign.joint_columns() | named(["x", "y", "z"], campaign.points)
    file = write(tmp_path / "m.csv", columns | {"temp_arm": values})
    expected = "row 9 column temp_arm: found -999, a mark for a missing value, expected a temperature"
    with pytest.raises(InputError, match=expected + "; --skip-bad reads the other rows"):
        read(campaign, tmp_path, file)
    found = read(campaign, tmp_path, file, skip_bad=True)
    assert f"left out: {expected}" in found.said
    assert found.data.count == 79


def test_thermometer_with_few_values_is_left_out(tmp_path, campaign):
    columns = campaign.joint_columns() | named(["x", "y", "z"], campaign.points)
    values = [21.0 if at < 3 else -9999.0 for at in range(80)]
    found = read(campaign, tmp_path, write(tmp_path / "m.csv", columns | {"temp_arm": values}))
    assert (
        "temp_arm: not taken, as it holds -9999.0, a mark for a missing value, in 77 of 80 rows" in found.said
    )


def test_deviations_from_nominal_are_named_and_left_out(tmp_path, campaign):
    actual, nominal = 1e3 * campaign.points, np.round(1e3 * campaign.points)
    columns = (
        campaign.joint_columns()
        | named(["Actual X", "Actual Y", "Actual Z"], actual)
        | named(["Nominal X", "Nominal Y", "Nominal Z"], nominal)
        | named(["dX", "dY", "dZ"], actual - nominal)
        | {"Mag": np.linalg.norm(actual - nominal, axis=1)}
    )
    found = read(campaign, tmp_path, write(tmp_path / "m.csv", columns))
    assert "dX: not taken, as it is Actual X minus Nominal X" in found.said
    assert "Mag: not taken, as it is the length of a deviation by its name" in found.said
    assert "variables" not in found.dataset
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)


def test_deviations_without_nominal_columns_are_left_out(tmp_path, campaign):
    columns = campaign.joint_columns() | named(["x", "y", "z"], campaign.points)
    file = write(tmp_path / "m.csv", columns | named(["dX", "dY", "dZ"], campaign.points**2))
    found = read(campaign, tmp_path, file)
    assert "dX: not taken, as it is by its name a deviation from the nominal value" in found.said
