"""Foreign files read through dataset.yaml: units, signs, order of rows, rotations, time, variables."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.io import load_data

FOREIGN = """\
Stamp;J1;J2;PX;PY;PZ;RX;RY;RZ;Air;Who
20200714163924;90,0;-10,5;1000,5;2000;3000,25;0;0;90;293,15;a
20200714163904;45,0;10,5;1001,5;2001;3001,25;90;0;0;294,15;b
20200714163944;45,0;20,5;1002,5;2002;3002,25;0;90;0;295,15;a
"""
DATASET = """\
file: foreign.csv
separator: ";"
decimal: ","
columns:
  q1: {column: J1, unit: deg}
  q2: {column: J2, unit: deg, scale: -1, offset: 0.5}
  x: {column: PX, unit: mm}
  y: {column: PY, unit: mm}
  z: {column: PZ, unit: mm}
  temp_arm: {column: Air, unit: K}
  payload: {constant: 2500, unit: g}
rotation: {form: euler, columns: [RX, RY, RZ], sequence: XYZ, axes: intrinsic, unit: deg}
time: {column: Stamp, format: "%Y%m%d%H%M%S"}
sort_by: time
derive: {dir: from_order}
"""


def load(tmp_path: Path, robot, dataset: str = DATASET, foreign: str = FOREIGN):
    (tmp_path / "foreign.csv").write_text(foreign)
    path = tmp_path / "dataset.yaml"
    path.write_text(dataset)
    return load_data(path, robot)


def test_units_signs_order_and_rotations_are_read(tmp_path, two_joints):
    data = load(tmp_path, two_joints)
    columns = data.columns
    np.testing.assert_array_equal(data.rows, [3, 2, 4])
    np.testing.assert_allclose(columns["q1"], np.radians([45, 90, 45]))
    np.testing.assert_allclose(columns["q2"], np.radians([-10.5, 10.5, -20.5]) + 0.5)
    np.testing.assert_allclose(columns["x"], [1.0015, 1.0005, 1.0025])
    np.testing.assert_allclose(columns["temp_arm"], [21.0, 20.0, 22.0])
    np.testing.assert_array_equal(columns["payload"], [2.5, 2.5, 2.5])
    np.testing.assert_array_equal(columns["time"], [0.0, 20.0, 40.0])
    half = math.sqrt(0.5)
    quaternions = np.column_stack([columns[name] for name in ("qw", "qx", "qy", "qz")])
    np.testing.assert_allclose(
        quaternions, [[half, half, 0, 0], [half, 0, 0, half], [half, 0, half, 0]], atol=1e-12
    )
    np.testing.assert_array_equal(columns["dir1"], [0, 1, -1])
    np.testing.assert_array_equal(columns["dir2"], [0, 1, -1])
    assert len(data.notes) == 2


def test_poses_to_predict_keep_the_order_of_the_file(tmp_path, two_joints):
    in_time = load(tmp_path, two_joints)
    to_predict = load_data(tmp_path / "dataset.yaml", two_joints, need_position=False)
    np.testing.assert_array_equal(to_predict.rows, [2, 3, 4])
    assert "x" not in to_predict.columns
    for name in ("q1", "dir1", "time"):
        np.testing.assert_array_equal(to_predict.columns[name], in_time.columns[name][[1, 0, 2]])


def test_joint_at_rest_keeps_its_last_direction(tmp_path, two_joints):
    foreign = "J1,J2,X\n0,0,1\n1,0,2\n1,0,3\n0.5,0,4\n0.5,1,5\n"
    dataset = """\
file: foreign.csv
columns: {q1: J1, q2: J2, x: X, y: X, z: X}
derive: {dir: from_order}
"""
    columns = load(tmp_path, two_joints, dataset, foreign).columns
    np.testing.assert_array_equal(columns["dir1"], [0, 1, 1, -1, -1])
    np.testing.assert_array_equal(columns["dir2"], [0, 0, 0, 0, 1])


@pytest.mark.parametrize(
    ("rotation", "cells"),
    [
        ("form: quaternion, columns: [A, B, C, D], order: wxyz", (math.sqrt(0.5), 0, 0, math.sqrt(0.5))),
        ("form: quaternion, columns: [A, B, C, D], order: xyzw", (0, 0, math.sqrt(0.5), math.sqrt(0.5))),
        ("form: euler, columns: [A, B, C], sequence: zyx, axes: intrinsic, unit: deg", (90, 0, 0, 0)),
        ("form: euler, columns: [A, B, C], sequence: zyx, axes: extrinsic", (math.pi / 2, 0, 0, 0)),
        ("form: rotation_vector, columns: [A, B, C], unit: deg", (0, 0, 90, 0)),
        ("form: matrix, columns: [A, E, A, B, A, A, A, A, B]", (0, 1, 0, 0, -1)),
    ],
)
def test_quarter_turn_about_z_is_read_in_every_form(tmp_path, two_joints, rotation, cells):
    cells = (*cells, *[0] * (5 - len(cells)))
    foreign = "J,X,A,B,C,D,E\n" + ",".join(map(str, (0.1, 1.0, *cells))) + "\n"
    dataset = f"file: foreign.csv\ncolumns: {{q1: J, q2: J, x: X, y: X, z: X}}\nrotation: {{{rotation}}}\n"
    columns = load(tmp_path, two_joints, dataset, foreign).columns
    found = [columns[name][0] for name in ("qw", "qx", "qy", "qz")]
    np.testing.assert_allclose(found, [math.sqrt(0.5), 0, 0, math.sqrt(0.5)], atol=1e-12)


def test_rows_are_selected_by_range_skip_and_value(tmp_path, two_joints):
    dataset = DATASET.replace("sort_by: time\n", "rows: {from: 2, to: 4, skip: [2], where: {Who: a}}\n")
    np.testing.assert_array_equal(load(tmp_path, two_joints, dataset).rows, [4])


def test_time_is_derived_from_the_order_of_rows(tmp_path, two_joints):
    dataset = DATASET.replace(
        'time: {column: Stamp, format: "%Y%m%d%H%M%S"}', "time: {from: rows, seconds_per_row: 5}"
    )
    np.testing.assert_array_equal(load(tmp_path, two_joints, dataset).columns["time"], [0, 5, 10])


def test_time_is_counted_from_a_given_origin(tmp_path, two_joints):
    dataset = DATASET.replace('%S"}', '%S", origin: "20200714163900"}')
    np.testing.assert_array_equal(load(tmp_path, two_joints, dataset).columns["time"], [4, 24, 44])


@pytest.mark.parametrize("written", ["16:39:14", "16:39:14.0000000"])
def test_time_without_or_with_long_fraction_of_a_second_is_read(tmp_path, two_joints, written):
    """Some programs omit `.000`, and some write more than six decimals."""
    cells = {"20200714163924": "16:39:24.25", "20200714163904": written, "20200714163944": "16:39:44.50"}
    foreign = FOREIGN
    for stamp, clock in cells.items():
        foreign = foreign.replace(stamp, clock)
    data = load(tmp_path, two_joints, DATASET.replace("%Y%m%d%H%M%S", "%H:%M:%S.%f"), foreign)
    np.testing.assert_array_equal(data.columns["time"], [0.0, 10.25, 30.5])


def test_columns_of_a_file_without_header_are_given_by_number(tmp_path, two_joints):
    dataset = "file: foreign.csv\nheader_row: 0\ncolumns: {q1: 1, q2: 2, x: 3, y: 4, z: 5}\n"
    data = load(tmp_path, two_joints, dataset, "0,1,2,3,4\n1,0,3,3,4\n")
    np.testing.assert_array_equal(data.columns["x"], [2, 3])
    np.testing.assert_array_equal(data.rows, [1, 2])


def test_lines_before_the_header_are_ignored(tmp_path, two_joints):
    dataset = "file: foreign.csv\nheader_row: 3\ncolumns: {q1: J, q2: J, x: J, y: J, z: J}\n"
    data = load(tmp_path, two_joints, dataset, "Leica;1;2\n# by hand\nJ\n0.5\n")
    np.testing.assert_array_equal(data.rows, [4])


@pytest.mark.parametrize(
    ("found", "put", "names"),
    [
        ("file: foreign.csv\n", "", "file: found nothing, expected the name of a CSV file"),
        ("file: foreign.csv", "file: gone.csv", "gone.csv: found no such file"),
        ("column: J1", "column: J9", "found no column 'J9' (did you mean 'J"),
        ("unit: deg}", "unit: grad}", "columns.q1.unit: found 'grad', expected rad or"),
        ("unit: deg}", "unit: mm}", "columns.q1.unit: found 'mm', expected rad"),
        (
            "unit: deg}",
            "units: deg}",
            "columns.q1.units: found a key that does not belong here (did you mean 'unit'?)",
        ),
        ("  q1:", "  q4:", "columns.q4: found a joint that the arm has not"),
        ("  temp_arm:", "  tmp_arm:", "did you mean 'temp_arm'"),
        ('decimal: ","', 'decimal: ";"', "decimal: found ';'"),
        ('decimal: ","', 'decimal: "."', "row 2 column J1: found '90,0', expected a number"),
        ('separator: ";"', "separator: ';;'", "one character"),
        ("sequence: XYZ", "sequence: XXY", "no two neighbours alike"),
        ("axes: intrinsic, ", "", "rotation.axes: found nothing, expected intrinsic or extrinsic"),
        ("[RX, RY, RZ]", "[RX, RY]", "a list of 3 headers"),
        (
            "%Y%m%d%H%M%S",
            "%d.%m.%Y",
            "row 2 column Stamp: found '20200714163924', expected a time in the format",
        ),
        ("%Y%m%d%H%M%S", "%Y%Y", "expected a strptime pattern"),
        ("sort_by: time", "sort_by: clock", "sort_by: found 'clock', expected time or row"),
        ("from_order", "from_time", "derive.dir: found 'from_time', expected from_order"),
        ("constant: 2500", "constant: heavy", "columns.payload.constant: found 'heavy'"),
    ],
)
def test_bad_dataset_yaml_is_refused_with_its_key(tmp_path, two_joints, found, put, names):
    assert found in DATASET
    with pytest.raises(InputError) as error:
        load(tmp_path, two_joints, DATASET.replace(found, put, 1))
    assert names in str(error.value)


def test_point_in_a_number_with_decimal_comma_is_refused(tmp_path, two_joints):
    with pytest.raises(
        InputError, match=r"row 2 column PX: found '1\.000,5', expected a number with a decimal comma"
    ):
        load(tmp_path, two_joints, foreign=FOREIGN.replace("1000,5", "1.000,5"))


def test_file_name_with_a_tilde_is_not_a_home_folder(tmp_path, two_joints):
    (tmp_path / "~nobody.csv").write_text(FOREIGN)
    assert load(tmp_path, two_joints, DATASET.replace("foreign.csv", "~nobody.csv")).count == 3


VARIABLES = "variables: {{{name}: J2}}\n"


def test_user_variables_are_read_under_their_names(tmp_path, two_joints):
    data = load(tmp_path, two_joints, DATASET + VARIABLES.format(name="speed"))
    np.testing.assert_allclose(data.columns["speed"], [10.5, -10.5, 20.5])


@pytest.mark.parametrize("name", ["q1", "payload", "sin", "two words", "tau1", "station"])
def test_variable_with_a_reserved_name_is_refused(tmp_path, two_joints, name):
    with pytest.raises(InputError, match=f"variables.*found '{name}', expected a name of letters"):
        load(tmp_path, two_joints, DATASET + VARIABLES.format(name=name))


def test_skipped_rows_may_be_malformed(tmp_path, two_joints):
    data = load(tmp_path, two_joints, DATASET + "rows: {skip: [3]}\n", FOREIGN.replace("294,15", ""))
    np.testing.assert_array_equal(data.rows, [2, 4])
