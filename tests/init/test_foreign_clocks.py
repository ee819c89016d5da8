"""Clock formats of programs and spreadsheets: each is read, or the reason is stated why not."""

from __future__ import annotations

import datetime

import numpy as np
import openpyxl
import pytest
from armtrue.errors import InputError
from foreign_files import Campaign, named, read, write

BEGIN = datetime.datetime(2020, 7, 14, 16, 39, 4)
# Times of the rows of a two-day session [s], at irregular intervals.
SECONDS = np.cumsum(np.random.default_rng(5).integers(600, 3500, 80)).astype(float)
STAMPS = [BEGIN + datetime.timedelta(seconds=second) for second in SECONDS]


def file_of(campaign: Campaign, where, **columns):
    table = campaign.joint_columns() | named(["X", "Y", "Z"], 1e3 * campaign.points)
    return write(where / "m.csv", {name: list(cells) for name, cells in (columns | table).items()})


def times(found) -> np.ndarray:
    assert "time" in found.data.columns, found.said
    return found.data.columns["time"] - found.data.columns["time"].min()


def excel(stamp: datetime.datetime) -> float:
    return (stamp - datetime.datetime(1899, 12, 30)).total_seconds() / 86400.0


FORMS = {
    "UTC": ("Timestamp", lambda s: f"{s:%Y-%m-%dT%H:%M:%S}Z", 0.0),
    "zone": ("time", lambda s: f"{s:%Y-%m-%dT%H:%M:%S}+02:00", 0.0),
    "summer time ends": ("time", lambda s: f"{s:%Y-%m-%d %H:%M:%S.%f} +0200", 0.0),
    "no seconds": ("Uhrzeit", lambda s: f"{s:%d.%m.%Y %H:%M}", 60.0),
    "half days": ("Time", lambda s: f"{s:%m/%d/%Y %I:%M %p}", 60.0),
    "two digits of the year": ("Zeit", lambda s: f"{s:%d.%m.%y %H:%M:%S}", 0.0),
    "whole seconds bare": (
        "Stamp",
        lambda s: str(s + datetime.timedelta(seconds=0.25 * (s.minute % 2))),
        0.26,
    ),
    "100 ns": ("Stamp", lambda s: f"{s:%Y-%m-%dT%H:%M:%S.%f}7Z", 0.0),
    "Unix": ("timestamp", lambda s: int(s.replace(tzinfo=datetime.UTC).timestamp()), 0.0),
    "Unix ms": ("timestamp", lambda s: int(1e3 * s.replace(tzinfo=datetime.UTC).timestamp()), 0.0),
    "Unix ms stated": (
        "timestamp [ms]",
        lambda s: int(1e3 * s.replace(tzinfo=datetime.UTC).timestamp()),
        0.0,
    ),
    "Unix ns": ("t", lambda s: int(s.replace(tzinfo=datetime.UTC).timestamp()) * 10**9, 1e-5),
    "Excel": ("Time", lambda s: f"{excel(s):.9f}", 1e-3),
    "elapsed": ("elapsed", lambda s: (s - BEGIN).total_seconds(), 0.0),
}


QUICK = ("zone", "half days", "Unix ms", "Excel")


@pytest.mark.parametrize(
    "form", [form if form in QUICK else pytest.param(form, marks=pytest.mark.full) for form in FORMS]
)
def test_clock_of_every_format_is_read(tmp_path, campaign: Campaign, form):
    header, written, within = FORMS[form]
    found = read(campaign, tmp_path, file_of(campaign, tmp_path, **{header: map(written, STAMPS)}))
    np.testing.assert_allclose(times(found), SECONDS - SECONDS[0], atol=within + 1e-6)
    assert f"{header}: time " in found.said
    assert found.dataset["file"].endswith("m.csv")


@pytest.mark.parametrize(
    "begin",
    [
        datetime.datetime(2020, 7, 1, 16, 0),
        pytest.param(datetime.datetime(2020, 3, 2, 8, 0), marks=pytest.mark.full),
    ],
)
@pytest.mark.parametrize("form", ["%m/%d/%Y %H:%M:%S", "%d/%m/%Y %H:%M:%S", "%m-%d-%Y %H:%M"])
def test_day_month_order_of_the_shorter_session_is_taken(tmp_path, campaign, begin, form):
    stamps = [begin + datetime.timedelta(minutes=int(60 * at)) for at in range(80)]
    found = read(campaign, tmp_path, file_of(campaign, tmp_path, Stamp=[f"{s:{form}}" for s in stamps]))
    np.testing.assert_allclose(times(found), 3600.0 * np.arange(80))
    order = "month before day" if form.startswith("%m") else "day before month"
    assert (
        f"Stamp: time as {form}, {order}, as the rows then last 3.29 days, with the other order" in found.said
    )


def test_day_month_order_that_sorts_the_rows_is_taken(tmp_path, campaign):
    """12 November, 1 and 2 December; with the day first they would be 11 December, 12 January and 12 February."""
    stamps = ["11/12/2020 10:00", "12/01/2020 10:00", "12/02/2020 10:00"]
    cells = [f"{stamp}:{at:02d}" for stamp in stamps for at in range(27)][:80]
    found = read(campaign, tmp_path, file_of(campaign, tmp_path, Stamp=cells))
    assert found.dataset["time"]["format"] == "%m/%d/%Y %H:%M:%S"
    assert "as the rows are then in order of time, which goes back 1 time with" in found.said


def test_undecidable_day_month_order_is_noted(tmp_path, campaign):
    found = read(
        campaign,
        tmp_path,
        file_of(
            campaign, tmp_path, Stamp=[f"07/01/2020 10:{at // 60:02d}:{at % 60:02d}" for at in range(80)]
        ),
    )
    np.testing.assert_array_equal(times(found), np.arange(80))
    assert (
        "day before month, the common order: the rows do not decide, and both orders give the same seconds"
        in found.said
    )


@pytest.mark.parametrize(
    ("date", "time"),
    [
        (lambda s: f"{s:%Y-%m-%d}", lambda s: f"{s:%H:%M:%S}"),
        (lambda s: f"{s:%d.%m.%Y}", lambda s: f"{s:%H:%M}"),
        (lambda s: f"{s:%m/%d/%Y}", lambda s: f"{s:%I:%M:%S %p}"),
        (lambda s: f"{s:%Y-%m-%d} 00:00:00", lambda s: f"{s:%H:%M:%S}"),
        (lambda s: int(excel(s)), lambda s: f"{excel(s) % 1.0:.9f}"),
    ],
)
def test_date_and_time_in_two_columns_are_joined(tmp_path, campaign, date, time):
    found = read(
        campaign, tmp_path, file_of(campaign, tmp_path, Date=map(date, STAMPS), Time=map(time, STAMPS))
    )
    np.testing.assert_allclose(times(found), SECONDS - SECONDS[0], atol=60.0)
    assert "Date, Time: date and time of day are joined" in found.said


def test_date_and_time_of_the_joints_file_keep_the_row_order(tmp_path, campaign):
    numbers = range(len(STAMPS))
    joints = write(
        tmp_path / "joints.csv",
        {
            "Pose": numbers,
            "Datum": [f"{s:%d.%m.%Y}" for s in STAMPS],
            "Uhrzeit": [f"{s:%H:%M:%S}" for s in STAMPS],
            **campaign.joint_columns(),
        },
    )
    points = write(
        tmp_path / "points.csv", {"Pose": numbers, **named(["X", "Y", "Z"], 1e3 * campaign.points)}
    )
    found = read(campaign, tmp_path, joints, points)
    np.testing.assert_allclose(found.data.positions_m, campaign.points, atol=1e-8)
    np.testing.assert_allclose(times(found), SECONDS - SECONDS[0])


def test_spreadsheet_dates_with_fractional_seconds_are_read(tmp_path, campaign):
    book = openpyxl.Workbook()
    table = campaign.joint_columns() | named(["X", "Y", "Z"], 1e3 * campaign.points)
    book.active.append(["Stamp", *table])
    for at, cells in enumerate(zip(*table.values(), strict=True)):
        book.active.append([STAMPS[at] + datetime.timedelta(seconds=0.25 * (at % 4)), *map(float, cells)])
    book.save(tmp_path / "m.xlsx")
    found = read(campaign, tmp_path, tmp_path / "m.xlsx")
    np.testing.assert_allclose(times(found), SECONDS - SECONDS[0] + 0.25 * (np.arange(80) % 4), atol=1e-3)


@pytest.mark.parametrize(
    ("columns", "why"),
    [
        (
            {"Stamp": ["soon"] * 79 + ["later"]},
            "Stamp: not used as time, found no time in 'soon', expected a date",
        ),
        ({"Date": [f"{s:%d.%m.%Y}" for s in STAMPS]}, "found dates without a time of day"),
        ({"Stamp": ["2020-07-14 16:00:00"] * 80}, "Stamp: not used as time, the same in all rows"),
        (
            {"Stamp": [*(f"2020-07-14 16:00:{at % 60:02d}" for at in range(79)), "---"]},
            "found '---' in row 81, expected a time as in the other rows, %Y-%m-%d %H:%M:%S",
        ),
    ],
)
def test_unused_clock_column_is_named_with_the_reason(tmp_path, campaign, columns, why):
    found = read(campaign, tmp_path, file_of(campaign, tmp_path, **columns))
    assert "time" not in found.data.columns
    assert why in found.said


def two_files(campaign, where, kept, ahead=0.0, seconds=SECONDS, form="{:%Y-%m-%d %H:%M:%S}"):
    """A file of the joints of all rows, and one of the points of the rows `kept`, its clock `ahead` by seconds."""
    begin = [BEGIN + datetime.timedelta(seconds=float(second)) for second in seconds]
    joints = write(where / "joints.csv", {"time": map(form.format, begin), **campaign.joint_columns()})
    shifted = [begin[at] + datetime.timedelta(seconds=ahead) for at in kept]
    points = named(["X", "Y", "Z"], 1e3 * campaign.points[kept])
    return joints, write(where / "tracker.csv", {"clock time": map(form.format, shifted), **points})


MISSING = [at for at in range(80) if at not in (17, 40, 41)]


@pytest.mark.parametrize(
    ("kept", "ahead", "words"),
    [
        (MISSING, 0.0, "by their clocks time and clock time; pairs are up to 0 s apart"),
        (MISSING, -7217.0, "that of tracker.csv taken as 2.005 h behind"),
        (list(range(79, -1, -1)), 37.0, "that of tracker.csv taken as 37 s ahead"),
        (list(range(80)), 37.0, "row by row, and by their clocks"),
    ],
)
def test_two_files_are_paired_by_their_clocks(tmp_path, campaign, kept, ahead, words):
    found = read(campaign, tmp_path, *two_files(campaign, tmp_path, kept, ahead))
    assert words in found.said
    order = np.array(sorted(kept))
    np.testing.assert_allclose(found.data.positions_m, campaign.points[order], atol=1e-8)
    np.testing.assert_allclose(found.data.joints, campaign.joints[order], atol=1e-8)
    if kept is MISSING:
        assert "left out: row 19, 42, 43 of joints.csv, without a partner" in found.said


def test_even_clocks_with_an_offset_do_not_pair_rows(tmp_path, campaign):
    even = 10.0 * np.arange(80)
    files = two_files(campaign, tmp_path, list(range(79)), 37.0, even)
    with pytest.raises(InputError, match=r"tracker.csv: found 79 rows where .* in more than one way"):
        read(campaign, tmp_path, *files)
    found = read(campaign, tmp_path, *two_files(campaign, tmp_path, list(range(80)), 37.0, even))
    assert "row by row, as their clocks fit one another in more than one way" in found.said


def test_points_are_paired_with_a_log_of_the_whole_motion(tmp_path, campaign):
    every = 0.5 * np.arange(20 * 80)
    at = np.minimum((every / 10.0).astype(int), 79)
    stamps = [BEGIN + datetime.timedelta(seconds=float(second)) for second in every]
    columns = {name: np.asarray(cells)[at] for name, cells in campaign.joint_columns().items()}
    log = write(tmp_path / "log.csv", {"time": [f"{s:%Y-%m-%d %H:%M:%S.%f}" for s in stamps], **columns})
    when = [BEGIN + datetime.timedelta(seconds=10.0 * k + 5.1) for k in range(80)]
    points = {"time": [f"{s:%Y-%m-%d %H:%M:%S.%f}" for s in when], **named(["X", "Y", "Z"], campaign.points)}
    found = read(campaign, tmp_path, log, write(tmp_path / "tracker.csv", points))
    np.testing.assert_allclose(found.data.joints, campaign.joints, atol=1e-8)
    assert "pairs are up to 0.1 s apart" in found.said
