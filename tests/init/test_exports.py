"""Exports of trackers and controllers: headers in comments or none, names of points, units in cells, polar readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from armtrue.errors import InputError
from foreign_files import Campaign, read, write

SA_HEADER = "Collection, Group, Target, X, Y, Z, U95"


def joint_file(campaign: Campaign, path: Path, **more: list[str]) -> Path:
    """Joints in degrees after the columns `more`."""
    return write(path, {**more, **campaign.joint_columns()})


def sa_file(path: Path, points: np.ndarray, above: list[str], names: list[str] | None = None) -> Path:
    """Points as SpatialAnalyzer exports them, below the lines `above`; `names`: column Target, default p1 … pn."""
    names = names or [f"p{k}" for k in range(1, len(points) + 1)]
    lines = [
        f"A, cal, {name}, {', '.join(f'{value:.7f}' for value in point)}, 0.03{k % 5}"
        for k, (name, point) in enumerate(zip(names, points, strict=True))
    ]
    path.write_text("\n".join([*above, *lines]) + "\n")
    return path


@pytest.mark.parametrize(
    "above",
    [
        [f"// {SA_HEADER}"],
        ["// SpatialAnalyzer 2024.1", "// Units: Millimeters", f"// {SA_HEADER}", "//"],
        [SA_HEADER],
    ],
)
def test_header_in_a_comment_names_the_columns(tmp_path, campaign, above):
    points = sa_file(tmp_path / "points.txt", 1e3 * campaign.points, above)
    found = read(campaign, tmp_path, points, joint_file(campaign, tmp_path / "log.csv"))
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)
    assert "points.txt: X, Y, Z: mm" in found.said
    assert ("is read from a comment" in found.said) is (above != [SA_HEADER])


def test_header_after_a_hash_as_numpy_writes_it_names_the_columns(tmp_path, campaign):
    file = tmp_path / "m.csv"
    names = ",".join([f"J{k} [rad]" for k in range(1, 7)] + ["X [mm]", "Y [mm]", "Z [mm]"])
    table = np.column_stack([campaign.joints, 1e3 * campaign.points])
    np.savetxt(file, table, delimiter=",", header=names, fmt="%.9f")
    found = read(campaign, tmp_path, file)
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)
    np.testing.assert_allclose(found.data.joints, campaign.joints, atol=1e-8)


def test_unit_in_a_comment_is_that_of_points_without_their_own(tmp_path, campaign):
    points = sa_file(tmp_path / "p.txt", campaign.points / 0.0254, ["// Units: Inches", f"// {SA_HEADER}"])
    found = read(campaign, tmp_path, points, joint_file(campaign, tmp_path / "log.csv"))
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)
    assert "X, Y, Z: in, as a comment says" in found.said


def test_points_of_spatialanalyzer_need_no_header(tmp_path, campaign):
    points = sa_file(tmp_path / "points.txt", 1e3 * campaign.points, [])
    found = read(campaign, tmp_path, points, joint_file(campaign, tmp_path / "log.csv"))
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)
    assert "points.txt: no header: columns are taken as Collection, Group, Target, X, Y, Z" in found.said
    assert "points.txt: 7: not taken, as it has no name" in found.said


def test_points_without_a_header_are_refused_by_their_own_file(tmp_path, campaign):
    points = tmp_path / "points.txt"
    np.savetxt(points, 1e3 * campaign.points, delimiter=",")
    with pytest.raises(InputError) as refused:
        read(campaign, tmp_path, points, joint_file(campaign, tmp_path / "log.csv"))
    assert str(refused.value) == (
        "points.txt, log.csv: found no columns of points, expected x, y and z in one of the files; points.txt has no "
        "header: write a first line that names its columns, such as Name,X,Y,Z"
    )


def test_names_of_single_points_are_no_reflectors(tmp_path, campaign):
    points = sa_file(tmp_path / "points.txt", 1e3 * campaign.points, [SA_HEADER])
    found = read(campaign, tmp_path, points, joint_file(campaign, tmp_path / "log.csv"))
    assert "Target: target" not in found.said
    assert "Target: not taken, as it names single points, which is used to match files" in found.said
    assert "target" not in found.data.columns


def test_names_of_single_points_match_the_rows_of_a_shorter_file(tmp_path, campaign):
    points = sa_file(tmp_path / "points.txt", 1e3 * campaign.points, [SA_HEADER])
    lines = points.read_text().splitlines()
    points.write_text("\n".join([lines[0], *lines[:0:-2]]) + "\n")
    names = [f"p{k}" for k in range(1, len(campaign.points) + 1)]
    found = read(campaign, tmp_path, points, joint_file(campaign, tmp_path / "log.csv", Point=names))
    np.testing.assert_allclose(found.data.positions_m, campaign.points[::-2], atol=1e-8)
    np.testing.assert_allclose(found.data.joints, campaign.joints[::-2], atol=1e-8)


def test_reflectors_named_in_the_file_of_points_are_written(tmp_path, campaign):
    names = ["near" if k % 3 else "far" for k in range(len(campaign.points))]
    points = sa_file(tmp_path / "points.txt", 1e3 * campaign.points, [SA_HEADER], names)
    found = read(campaign, tmp_path, points, joint_file(campaign, tmp_path / "log.csv"))
    assert "points.txt: Target: target, by its header" in found.said
    assert sorted(found.data.labels["target"]) == ["far", "near"]


def test_constant_reflector_column_is_left_out_with_a_note(tmp_path, campaign):
    points = sa_file(
        tmp_path / "points.txt", 1e3 * campaign.points, [SA_HEADER], ["ball"] * len(campaign.points)
    )
    found = read(campaign, tmp_path, points, joint_file(campaign, tmp_path / "log.csv"))
    assert "points.txt: Target: not taken, as it is the same in all rows" in found.said
    assert "target" not in found.data.columns


@pytest.mark.parametrize("name", ["dMag", "Mag", "dMag [mm]", "d3D"])
def test_length_of_a_deviation_is_left_out(tmp_path, campaign, name):
    planned = np.round(1e3 * campaign.points, 1)
    off = 1e3 * campaign.points - planned
    columns = {
        **{f"Actual {axis}": 1e3 * campaign.points[:, k] for k, axis in enumerate("XYZ")},
        **{f"d{axis}": off[:, k] for k, axis in enumerate("XYZ")},
        name: np.linalg.norm(off, axis=1),
    }
    found = read(campaign, tmp_path, write(tmp_path / "m.csv", campaign.joint_columns() | columns))
    assert f"{name}: not taken, as it is the length of a deviation by its name" in found.said


@pytest.mark.parametrize("decimal", [".", ","])
def test_units_written_in_cells_are_taken_out(tmp_path, campaign, decimal):
    columns = {name: [f"{cell:.9f}deg" for cell in cells] for name, cells in campaign.joint_columns().items()}
    columns |= {
        axis: [f"{1e3 * cell:.7f} mm" for cell in campaign.points[:, k]] for k, axis in enumerate("XYZ")
    }
    lines = [";".join(columns), *(";".join(cells) for cells in zip(*columns.values(), strict=True))]
    (tmp_path / "pr.csv").write_text("\n".join(lines).replace(".", decimal) + "\n")
    found = read(campaign, tmp_path, tmp_path / "pr.csv")
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)
    np.testing.assert_allclose(found.data.joints, campaign.joints, atol=1e-8)
    assert "joints in deg, as its cells say" in found.said
    assert "X, Y, Z: mm, as its cells say" in found.said


POLAR = [
    ("Az[deg]", "El[deg]", "Dist[mm]", False, np.degrees(1.0), 1e3),
    ("Azimuth", "Elevation", "Distance", False, np.degrees(1.0), 1e3),
    ("azimuth [rad]", "zenith [rad]", "range [m]", True, 1.0, 1.0),
]


@pytest.mark.parametrize(("around", "up", "far", "from_zenith", "angle", "length"), POLAR)
def test_polar_readings_are_converted(tmp_path, campaign, around, up, far, from_zenith, angle, length):
    x, y, z = campaign.points.T
    distance = np.linalg.norm(campaign.points, axis=1)
    elevation = np.arcsin(z / distance)
    columns = {
        around: angle * np.arctan2(y, x),
        up: angle * (np.pi / 2 - elevation if from_zenith else elevation),
        far: length * distance,
    }
    found = read(campaign, tmp_path, write(tmp_path / "m.csv", campaign.joint_columns() | columns))
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)
    assert f"m.csv: {around}, {up}, {far}: polar readings are converted to x, y, z" in found.said


def test_polar_readings_of_unknown_sense_are_refused(tmp_path, campaign):
    columns = {"Hz": [10.0] * 80, "V": [80.0] * 80, "D": [3000.0] * 80}
    with pytest.raises(InputError, match=r"m.csv has Hz, V, D") as refused:
        read(campaign, tmp_path, write(tmp_path / "m.csv", campaign.joint_columns() | columns))
    assert "export the points as Cartesian x, y, z" in str(refused.value)


@pytest.mark.parametrize("headers", [("PR", "PR"), ("PR", "Register"), ("Pose-Nr.", "pose-nr.")])
def test_files_are_joined_by_any_column_of_names_in_both(tmp_path, campaign, headers):
    order = np.random.default_rng(1).permutation(len(campaign.points))[:70]
    names = [f"PR[{k + 1}]" for k in range(len(campaign.points))]
    joints = joint_file(campaign, tmp_path / "joints.csv", **{headers[0]: names})
    columns = {axis: 1e3 * campaign.points[order, k] for k, axis in enumerate("XYZ")}
    points = write(tmp_path / "points.csv", {headers[1]: [names[at] for at in order], **columns})
    found = read(campaign, tmp_path, joints, points)
    np.testing.assert_allclose(found.data.positions_m, campaign.points[order], atol=1e-8)
    np.testing.assert_allclose(found.data.joints, campaign.joints[order], atol=1e-8)
    assert f"points.csv belongs to joints.csv by {headers[0]} and {headers[1]}" in found.said
    assert (
        f"joints.csv: {headers[0]}: not taken, as it names rows, which is used to match files" in found.said
    )


def test_numbers_under_one_header_join_files(tmp_path, campaign):
    numbers = list(range(101, 101 + len(campaign.points)))
    joints = joint_file(campaign, tmp_path / "joints.csv", PR=numbers)
    columns = {axis: 1e3 * campaign.points[:70, k] for k, axis in enumerate("XYZ")}
    points = write(tmp_path / "points.csv", {"PR": numbers[:70], **columns})
    found = read(campaign, tmp_path, joints, points)
    np.testing.assert_allclose(found.data.joints, campaign.joints[:70], atol=1e-8)
    assert "PR" not in found.data.columns


def test_refusal_without_a_common_column_lists_accepted_headers(tmp_path, campaign):
    columns = {axis: 1e3 * campaign.points[:70, k] for k, axis in enumerate("XYZ")}
    points = write(tmp_path / "points.csv", columns)
    with pytest.raises(InputError) as refused:
        read(campaign, tmp_path, joint_file(campaign, tmp_path / "joints.csv"), points)
    assert "a column in both that names each row (Point, Name, Nr, ID, or any header that is the same" in str(
        refused.value
    )
