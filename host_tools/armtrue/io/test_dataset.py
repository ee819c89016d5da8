from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armtrue.errors import InputError, RowError
from armtrue.io import load_data

PLAIN = """\
q1,q2,x,y,z,temp_arm,target,time
0.0,0.1,1.0,2.0,3.0,20.5,A,0
0.5,-0.1,1.1,2.1,3.1,20.6,B,10
1.0,0.3,1.2,2.2,3.2,20.7,A,20
"""


def written(tmp_path: Path, text: str | bytes, name: str = "data.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_plain_csv_file_is_read(tmp_path, two_joints):
    data = load_data(written(tmp_path, PLAIN), two_joints)
    assert data.count == 3
    np.testing.assert_array_equal(data.rows, [2, 3, 4])
    np.testing.assert_array_equal(data.columns["q2"], [0.1, -0.1, 0.3])
    np.testing.assert_array_equal(data.columns["target"], [0, 1, 0])
    assert data.labels["target"] == ["A", "B"]
    np.testing.assert_array_equal(data.positions_m[1], [1.1, 2.1, 3.1])
    np.testing.assert_array_equal(data.joints[2], [1.0, 0.3])


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\n\n"),
        PLAIN.replace("\n", ",\n"),
        PLAIN.replace(",", " , "),
        PLAIN + "  \n,,,,,,,\n",
        PLAIN.rstrip("\n"),
    ],
    ids=[
        "byte-order mark",
        "CRLF",
        "blank lines",
        "trailing separators",
        "spaces",
        "empty rows",
        "no last newline",
    ],
)
def test_csv_variants_of_spreadsheets_read_alike(tmp_path, two_joints, text):
    plain = load_data(written(tmp_path, PLAIN), two_joints)
    data = load_data(written(tmp_path, text, "other.csv"), two_joints)
    assert data.columns.keys() == plain.columns.keys()
    for name, values in plain.columns.items():
        np.testing.assert_array_equal(data.columns[name], values)


def test_row_numbers_are_line_numbers_of_the_file(tmp_path, two_joints):
    data = load_data(written(tmp_path, PLAIN.replace("\n", "\n\n")), two_joints)
    np.testing.assert_array_equal(data.rows, [3, 5, 7])


def test_poses_to_predict_need_no_position(tmp_path, two_joints):
    path = written(tmp_path, "q1,q2\n0,1\n")
    assert load_data(path, two_joints, need_position=False).count == 1
    with pytest.raises(InputError, match="found no column 'x'"):
        load_data(path, two_joints)


def test_measured_columns_of_poses_to_predict_are_not_read(tmp_path, two_joints):
    text = PLAIN.replace("3.1,20.6", ",20.6").replace("x,y,z", "x,y,sigma")
    data = load_data(written(tmp_path, text), two_joints, need_position=False)
    assert sorted(data.columns) == ["q1", "q2", "target", "temp_arm", "time"]


def test_unknown_numeric_column_is_kept_as_a_variable_with_note(tmp_path, two_joints):
    data = load_data(written(tmp_path, PLAIN.replace("temp_arm", "tmp_arm")), two_joints)
    assert data.columns["tmp_arm"].size == data.count
    assert data.notes == [
        "data.csv: column 'tmp_arm' is not one of the contract's and is a variable for custom effects and the search "
        "(did you mean 'temp_arm'?)"
    ]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("two words", "expressions have no such name, expected letters, digits and underscores"),
        ("th1", "'th1' is a state variable, expected a name of its own"),
        ("dT", "'dT' is a state variable, expected a name of its own"),
        ("sin", "'sin' is a word of expressions, expected a name of its own"),
        ("pi", "'pi' is a word of expressions, expected a name of its own"),
    ],
)
def test_column_unusable_in_expressions_is_dropped_with_reason(name, why, tmp_path, two_joints):
    data = load_data(written(tmp_path, PLAIN.replace("temp_arm", name)), two_joints)
    assert name not in data.columns
    assert data.notes == [f"data.csv: column '{name}' is not one of the contract's and is not used: {why}"]


@pytest.mark.parametrize("name", ["weather", "travel1", "duty2", "station"])
def test_column_with_an_empty_cell_is_dropped_and_row_named(name, tmp_path, two_joints):
    text = PLAIN.replace("20.6", "").replace("temp_arm", name)
    data = load_data(written(tmp_path, text), two_joints)
    assert name not in data.columns
    assert "not used: row 3 holds nothing" in data.notes[0]


@pytest.mark.parametrize(
    ("name", "hint"), [("status", ""), ("dri1", " (did you mean 'dir1'?)"), ("fault", "")]
)
def test_unknown_column_suggests_only_a_similar_name(name, hint, tmp_path, two_joints):
    data = load_data(written(tmp_path, PLAIN.replace("temp_arm", name)), two_joints)
    assert data.notes[0].endswith(f"the search{hint}")


def test_column_with_text_is_not_used(tmp_path, two_joints):
    text = PLAIN.replace("20.6", "warm")
    data = load_data(written(tmp_path, text.replace("temp_arm", "weather")), two_joints)
    assert "weather" not in data.columns
    assert data.notes == [
        "data.csv: column 'weather' is not one of the contract's and is not used: row 3 holds 'warm', expected numbers "
        "in all rows"
    ]


def test_duplicate_rows_are_left_out_with_a_note(tmp_path, two_joints):
    again = PLAIN.splitlines()[2]
    path = written(tmp_path, PLAIN + again + "\n" + again.replace(",10", ",30") + "\n")
    data = load_data(path, two_joints)
    assert data.rows.tolist() == [2, 3, 4, 6]
    assert data.notes == [
        "data.csv: left out 1 row that equals an earlier one in every column: copies are no measurements"
    ]
    assert load_data(path, two_joints, strict=False).count == 5
    assert load_data(path, two_joints, need_position=False).count == 5


def test_a_fixed_reflector_is_left_out_with_a_note(tmp_path, two_joints):
    rows = "".join(f"{0.1 * k},{0.2 * k},1.0,2.0,3.000{k},20,base,{k}\n" for k in range(5))
    path = written(tmp_path, PLAIN.replace(",A,", ",arm,").replace(",B,", ",arm,") + rows)
    data = load_data(path, two_joints)
    assert data.count == 3
    assert data.labels["target"] == ["arm"]
    assert "target 'base' does not move with the arm; its 5 rows are left out" in data.notes[0]
    assert load_data(path, two_joints, strict=False).count == 8


@pytest.mark.parametrize(
    ("found", "put", "names"),
    [
        ("0.5,-0.1", "0.5,abc", "row 3 column q2: found 'abc', expected a number"),
        ("0.5,-0.1", "0.5,", "row 3 column q2: found nothing, expected a number"),
        ("0.5,-0.1", "0.5,nan", "row 3 column q2: found 'nan'"),
        ("0.5,-0.1", "0.5,inf", "row 3 column q2: found 'inf'"),
        ("0.5,-0.1", "0.5,1_0", "row 3 column q2: found '1_0'"),
        ("0.5,-0.1", "0.5,-0.1,7,8", "row 3: found 10 cells, expected 8"),
        ("0.5,-0.1,", "0.5,", "row 3: found 7 cells, expected 8"),
        ("q1,q2", "q1,Q2", "found no column 'q2', expected it (did you mean 'Q2'?)"),
        ("q1,q2", "q1,q1", "column 'q1' a second time"),
        ("time", "q3", "found column 'q3', expected joints 1 to 2"),
        ("x,y,z", "x,y,zz", "found no column 'z'"),
        ("0.5,-0.1", "57.3,-0.1", "row 3 column q1: found 57.3, expected radians"),
        ("20.6", "293.6", "kelvin"),
        (PLAIN, "q1;q2;x;y;z\n", "dataset.yaml"),
        (PLAIN, "q1,q2,x,y,z\n", "no rows of measurements"),
        (PLAIN, "", "no header row"),
        ("0.5,-0.1", '0.5,"-0.1', "found 2 cells, expected 8"),
    ],
)
def test_bad_file_is_refused_with_row_and_column(tmp_path, two_joints, found, put, names):
    assert found in PLAIN
    path = written(tmp_path, PLAIN.replace(found, put, 1))
    with pytest.raises(InputError) as error:
        load_data(path, two_joints)
    assert names in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("column", "cells", "names"),
    [
        ("sigma", "1e-5 0 1e-5", "row 3 column sigma: found 0, expected a standard deviation above 0"),
        ("sigma", "1e-5 10 1e-5", "metres"),
        ("dir1", "1 2 0", "row 3 column dir1: found 2, expected -1, 0 or 1"),
        ("payload", "0 -1 0", "row 3 column payload: found -1, expected kilograms, not negative"),
        ("qw", "1 1 1", "found no column 'qx'"),
        ("qr1", "0 90 0", "degrees"),
    ],
)
def test_values_that_a_column_cannot_hold_are_refused(tmp_path, two_joints, column, cells, names):
    lines = PLAIN.splitlines()
    added = [f"{line},{cell}" for line, cell in zip(lines, [column, *cells.split()], strict=True)]
    with pytest.raises(InputError) as error:
        load_data(written(tmp_path, "\n".join(added)), two_joints)
    assert names in str(error.value)


def test_quaternion_is_normalised_or_refused(tmp_path, two_joints):
    text = "q1,q2,x,y,z,qw,qx,qy,qz\n0,0,1,1,1,{},0,0,0\n1,1,2,1,1,1,0,0,0\n"
    data = load_data(written(tmp_path, text.format(0.9999)), two_joints)
    assert data.columns["qw"][0] == 1.0
    with pytest.raises(InputError, match=r"row 2 columns qw, qx, qy, qz: found length 0\.9"):
        load_data(written(tmp_path, text.format(0.9)), two_joints)


def test_millimetres_are_refused_but_not_a_single_gross_error(tmp_path, two_joints):
    rows = [(0.1 * k, 0.0, 1000 + 40.0 * k, 20.0 * k * k, 30.0) for k in range(9)]
    text = "q1,q2,x,y,z\n" + "\n".join(",".join(map(str, row)) for row in rows)
    with pytest.raises(InputError, match="millimetres"):
        load_data(written(tmp_path, text), two_joints)
    metres = [(a, b, x / 1000, y / 1000, z / 1000) for a, b, x, y, z in rows]
    metres[4] = (*metres[4][:2], 55.0, 0.0, 0.0)
    text = "q1,q2,x,y,z\n" + "\n".join(",".join(map(str, row)) for row in metres)
    assert load_data(written(tmp_path, text), two_joints).count == 9


def test_text_that_is_not_utf8_is_named(tmp_path, two_joints):
    with pytest.raises(InputError, match="expected utf-8 text"):
        load_data(written(tmp_path, PLAIN.encode() + b"\xff\xfe,1\n"), two_joints)


@pytest.mark.parametrize(("place", "row"), [("header", 1), ("rows", 1 + len(PLAIN.splitlines()))])
def test_latin_1_file_is_refused_with_the_way_to_read_it(place, row, tmp_path, two_joints):
    text = (
        PLAIN.replace("temp_arm", "temp_arm (°C)") if place == "header" else PLAIN + "0.5,0.1,1,2,3,20°,A,7\n"
    )
    with pytest.raises(
        InputError,
        match=rf"row {row}: found byte 0xb0, expected utf-8 text: .*'encoding: latin-1', or let 'armtrue init'",
    ):
        load_data(written(tmp_path, text.encode("latin-1")), two_joints)
    description = "file: data.csv\nencoding: latin-1\ncolumns: {q1: q1, q2: q2, x: x, y: y, z: z}\n"
    assert load_data(written(tmp_path, description, "dataset.yaml"), two_joints).count >= 3


@pytest.mark.full
def test_a_hundred_thousand_rows_are_read(tmp_path, two_joints):
    numbers = np.random.default_rng(1).uniform(-1, 1, (100_000, 25))
    header = "q1,q2,x,y,z," + ",".join(f"extra{k}" for k in range(20))
    rows = "\n".join(",".join(f"{value:.9f}" for value in row) for row in numbers)
    path = written(tmp_path, f"{header}\n{rows}\n")
    data = load_data(path, two_joints)
    assert data.count == 100_000
    assert np.abs(data.joints - numbers[:, :2]).max() < 1e-9


def test_each_row_with_empty_repeat_is_a_pose_of_its_own(tmp_path, two_joints):
    rows = ["7", "7", "", ""]
    text = "q1,q2,x,y,z,repeat\n" + "".join(f"0.{k},0,1,2,3,{name}\n" for k, name in enumerate(rows))
    data = load_data(written(tmp_path, text), two_joints)
    np.testing.assert_array_equal(data.columns["repeat"], [0, 0, 1, 2])
    unnamed = load_data(written(tmp_path, text.replace(",7\n", ",\n"), "other.csv"), two_joints)
    assert "repeat" not in unnamed.columns


def test_empty_target_is_refused_unless_the_column_is_empty(tmp_path, two_joints):
    with pytest.raises(InputError, match="row 3 column target: found nothing"):
        load_data(written(tmp_path, PLAIN.replace(",B,", ",,")), two_joints)
    unnamed = PLAIN.replace(",A,", ",,").replace(",B,", ",,")
    assert "target" not in load_data(written(tmp_path, unnamed, "other.csv"), two_joints).columns


def test_skip_bad_leaves_out_bad_rows_and_names_them(tmp_path, two_joints):
    rows = [
        "0.0,0.1,1.0,2.0,3.0,20.5,A,0",
        "oops,0.1,1.0,2.0,3.0,20.5,A,1",
        "0.5,-0.1,1.1,2.1,3.1,20.6,B",
        "0.7,0.2,1e300,2.1,3.1,20.6,B,3",
        "0.9,0.3,1.2,2.2,3.2,20.7,,4",
        "1.0,0.3,1.2,2.2,3.2,20.7,A,20",
    ]
    path = written(tmp_path, "\n".join([PLAIN.splitlines()[0], *rows]) + "\n")
    with pytest.raises(InputError, match="row 4: found 7 cells"):
        load_data(path, two_joints)
    data = load_data(path, two_joints, skip_bad=True)
    np.testing.assert_array_equal(data.rows, [2, 7])
    assert list(data.skipped) == [4, 3, 6, 5]
    assert "found 7 cells" in data.skipped[4]
    assert any("left out" in note and "'oops'" in note for note in data.notes)


def test_skip_bad_does_not_accept_a_column_without_numbers(tmp_path, two_joints):
    path = written(tmp_path, "q1,q2,x,y,z,time\n" + "0,0,1,2,3,2024-01-01T10:00:00\n" * 3)
    for skip_bad in (False, True):
        with pytest.raises(InputError, match="row 2 column time: .* no other row has one.*'format'") as error:
            load_data(path, two_joints, skip_bad=skip_bad)
        assert not isinstance(error.value, RowError)


def test_skip_bad_refuses_more_than_100_bad_rows(tmp_path, two_joints):
    path = written(tmp_path, PLAIN + "x,0,0,0,0,20,A,0\n" * 101)
    with pytest.raises(InputError, match="no more than 100"):
        load_data(path, two_joints, skip_bad=True)


@pytest.mark.parametrize(
    "text",
    [
        PLAIN.replace("q1,", "q1 (°),"),
        "# our tracker\n" + PLAIN,
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", "\t"),
        b"PK\x03\x04 a spreadsheet",
    ],
)
def test_foreign_files_are_refused_with_the_command_that_reads_them(tmp_path, two_joints, text):
    path = written(tmp_path, text, "my data.csv")
    with pytest.raises(InputError) as refusal:
        load_data(path, two_joints)
    command = f"armtrue init '{path}' --robot {two_joints.path} --out '{tmp_path / 'my data'}'"
    assert str(refusal.value).endswith(command)


@pytest.mark.parametrize("name", ["station", "nest", "travel2", "duty1"])
def test_columns_read_by_a_single_effect_are_known(tmp_path, two_joints, name):
    (tmp_path / "data.csv").write_text(f"q1,q2,x,y,z,{name}\n0.1,0.2,1,2,3,1\n0.3,0.1,1,2,4,2\n")
    data = load_data(tmp_path / "data.csv", two_joints)
    assert data.notes == []
    np.testing.assert_array_equal(data.columns[name], [1.0, 2.0])
    (tmp_path / "data.csv").write_text(f"q1,q2,x,y,z,{name}\n0.1,0.2,1,2,3,A\n0.3,0.1,1,2,4,2\n")
    (note,) = load_data(tmp_path / "data.csv", two_joints).notes
    assert f"column '{name}' holds more than numbers" in note
    (tmp_path / "data.csv").write_text("q1,q2,x,y,z,Own\n0.1,0.2,1,2,3,1\n0.3,0.1,1,2,4,2\n")
    columns = ", ".join(f"{own}: {own}" for own in ("q1", "q2", "x", "y", "z"))
    (tmp_path / "d.yaml").write_text(f"file: data.csv\ncolumns: {{{columns}, {name}: Own}}\n")
    np.testing.assert_array_equal(load_data(tmp_path / "d.yaml", two_joints).columns[name], [1.0, 2.0])


def with_directions(cells: list[tuple[str, str]]) -> str:
    header, *rows = PLAIN.splitlines()
    return "\n".join(
        [f"{header},dir1,dir2", *(f"{row},{','.join(own)}" for row, own in zip(rows, cells, strict=True))]
    )


@pytest.mark.parametrize(
    ("cell", "words"), [("0", "0 in all rows"), ("", "empty in all rows"), ("0.0", "0 in all rows")]
)
def test_all_zero_or_empty_directions_are_left_out_with_a_note(tmp_path, two_joints, cell, words):
    path = written(tmp_path, with_directions([(cell, cell)] * 3))
    for strict in (True, False):
        data = load_data(path, two_joints, strict=strict)
        assert not {"dir1", "dir2"} & set(data.columns)
        assert f"data.csv: dir1, dir2 are {words}: taken as not recorded" in data.notes


def test_all_zero_direction_of_one_joint_does_not_drop_others(tmp_path, two_joints):
    data = load_data(written(tmp_path, with_directions([("1", "0"), ("1", "0"), ("-1", "0")])), two_joints)
    assert "dir1" in data.columns
    assert "dir2" not in data.columns
    assert "data.csv: dir2 is 0 in all rows: taken as not recorded" in data.notes


def test_direction_0_is_kept_for_a_resting_joint_and_to_predict(tmp_path, two_joints):
    text = with_directions([("0", "0")] * 3)
    poses = load_data(written(tmp_path, text), two_joints, need_position=False)
    assert {"dir1", "dir2"} <= set(poses.columns)
    still = text.replace("0.5,-0.1", "0.5,0.1").replace("1.0,0.3", "1.0,0.1")
    data = load_data(written(tmp_path, still), two_joints)
    assert "dir1" not in data.columns
    assert "dir2" in data.columns


def test_direction_that_is_empty_in_some_rows_is_refused(tmp_path, two_joints, monkeypatch):
    monkeypatch.setattr("armtrue.io.delimited._ROWS_AT_A_TIME", 2)
    for cells, row in (([("1", "1"), ("", "1"), ("1", "1")], 3), ([("", "1"), ("", "1"), ("1", "1")], 2)):
        path = written(tmp_path, with_directions(cells))
        with pytest.raises(InputError, match=f"row {row} column dir1: found nothing, expected a number"):
            load_data(path, two_joints)


def test_all_zero_travel_and_duty_are_left_out(tmp_path, two_joints):
    header, *rows = PLAIN.splitlines()
    text = "\n".join([f"{header},travel1,duty2", *(f"{row},0,0" for row in rows)])
    data = load_data(written(tmp_path, text), two_joints)
    assert not {"travel1", "duty2"} & set(data.columns)
    assert "data.csv: duty2 is 0 in all rows: taken as not recorded" in data.notes


ANGLES = np.array([[0.3, 0.1], [-0.2, 0.5], [0.6, -0.4]])


def level_csv(third: list[float] | None, more: str = "") -> str:
    head = "q1,q2" + (",q3" if third else "") + (f",{more}" if more else "")
    cells = [
        [*pair, *([third[row]] if third else []), *([1] if more else [])] for row, pair in enumerate(ANGLES)
    ]
    return "\n".join([head, *(",".join(map(str, row)) for row in cells)]) + "\n"


def test_a_passive_joint_needs_no_column(tmp_path, level):
    data = load_data(written(tmp_path, level_csv(None)), level, need_position=False)
    np.testing.assert_array_equal(data.joints, np.column_stack([ANGLES, np.zeros(3)]))
    assert data.passive == {}


@pytest.mark.parametrize(
    "third",
    [[0.0] * 3, [1.57] * 3, list(-ANGLES.sum(axis=1)), list(0.5 - ANGLES.sum(axis=1))],
    ids=["zero", "still in the world", "what the couplings give", "with an offset"],
)
def test_readings_of_a_passive_joint_are_kept_but_not_used(tmp_path, level, third):
    data = load_data(written(tmp_path, level_csv(third)), level, need_position=False)
    np.testing.assert_array_equal(data.columns["q3"], 0.0)
    np.testing.assert_allclose(data.passive["q3"], third)
    assert any("q3 is not used: joint 3 has no motor" in note for note in data.notes)


def test_passive_joint_that_contradicts_its_coupling_is_refused(tmp_path, level):
    text = level_csv(list(ANGLES.sum(axis=1)))
    with pytest.raises(InputError, match=r"column q3: found values up to 0\.2 rad from robot\.yaml"):
        load_data(written(tmp_path, text), level, need_position=False)


def test_direction_of_a_passive_joint_is_not_used(tmp_path, level):
    data = load_data(written(tmp_path, level_csv(None, "dir3")), level, need_position=False)
    assert "dir3" not in data.columns
    assert any("not used, as the joints have no motor: dir3" in note for note in data.notes)
