"""Blocks of rows that have the positions of other rows, or the names of other reflectors."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from armtrue.checking import CheckReport, Finding, check, pairing, refuse_what_cannot_be_an_arm
from armtrue.checking.alignment import Alignment, align
from armtrue.checking.conftest import Campaign
from armtrue.checking.residuals import nominal_positions
from armtrue.errors import InputError
from armtrue.io import Dataset, Robot


def shifted(data: Dataset, first: int, last: int, lag: int = 1) -> Dataset:
    """`data` with entries `first` to `last` given the positions `lag` rows further down; rows without one are cut."""
    own = np.arange(data.count)
    source = np.where((own >= first) & (own <= last), own + lag, own)
    kept = source < data.count
    columns = {name: data.columns[name][source[kept]] for name in "xyz"}
    return replace(data.take(kept), columns={**data.take(kept).columns, **columns})


def errors_and_warnings(data: Dataset, robot: Robot) -> list[Finding]:
    return [found for found in check(data, robot).findings if found.severity != "note"]


@pytest.mark.quick("0.12-kr30-91", "0.9-kr30-94", "0.5-cobot-194")
@pytest.mark.parametrize(("arm", "seed"), [("kr30", 91), ("kr30", 94), ("kr30", 96), ("cobot", 194)])
@pytest.mark.parametrize("share", [0.12, 0.5, 0.9])
def test_lost_reading_is_reported_with_its_row_and_fit_refused(
    campaign: Campaign, arm: str, seed: int, share: float
) -> None:
    data, robot = campaign(arm, seed)
    first = int((1.0 - share) * data.count)
    lost = shifted(data, first, data.count)
    (found,) = errors_and_warnings(lost, robot)
    assert (found.code, found.severity) == ("rows_shifted", "error")
    assert found.evidence["first_row"] == first + 2
    words = f"from row {first + 2} on, each position belongs to the joints of the next row"
    assert words in found.message
    assert "down by 1 row" in found.remedy
    with pytest.raises(InputError, match=words):
        refuse_what_cannot_be_an_arm(lost, robot)


def test_surplus_reading_is_reported_as_a_shift_not_as_a_copy(campaign: Campaign) -> None:
    data, robot = campaign()
    (found,) = errors_and_warnings(shifted(data, 100, data.count, lag=-1), robot)
    assert "from row 102 on, each position belongs to the joints of the row before" in found.message
    assert "up by 1 row" in found.remedy


def test_two_lost_readings_are_reported_as_two_blocks(campaign: Campaign) -> None:
    data, robot = campaign()
    twice = shifted(shifted(data, 60, data.count), 150, data.count)
    one, other = errors_and_warnings(twice, robot)
    assert "in rows 62 to 151, each position belongs to the joints of the next row" in one.message
    assert "from row 152 on, each position belongs to the joints 2 rows further down" in other.message


def test_shift_of_a_block_is_reported_with_both_ends(campaign: Campaign) -> None:
    data, robot = campaign()
    (found,) = errors_and_warnings(shifted(data, 60, 120), robot)
    assert "in rows 62 to 122, each position belongs to the joints of the next row" in found.message


def test_shift_of_the_whole_file_by_two_rows_is_reported(campaign: Campaign) -> None:
    data, robot = campaign()
    (found,) = errors_and_warnings(shifted(data, 0, data.count, lag=2), robot)
    assert "in all rows, each position belongs to the joints 2 rows further down" in found.message


def test_shift_is_found_with_rows_sorted_by_reflector(campaign: Campaign) -> None:
    data, robot = campaign(targets={"names": ["A", "B"], "order": "cycle"})
    without_time = {name: values for name, values in data.columns.items() if name != "time"}
    data = replace(data, columns=without_time).take(np.argsort(data.columns["target"], kind="stable"))
    (found,) = errors_and_warnings(
        shifted(replace(data, rows=np.arange(data.count) + 2), 160, data.count), robot
    )
    assert "from row 162 on" in found.message


def test_shift_and_exchange_differ_with_two_reflectors_per_pose(campaign: Campaign) -> None:
    data, robot = campaign(targets={"names": ["A", "B"], "order": "each_pose"})
    (lost,) = errors_and_warnings(shifted(data, 120, data.count), robot)
    assert (lost.code, lost.evidence["first_row"]) == ("rows_shifted", 122)
    target = data.columns["target"].copy()
    target[60:90] = 1.0 - target[60:90]
    (swapped,) = errors_and_warnings(replace(data, columns={**data.columns, "target": target}), robot)
    assert "in rows 62 to 91 the names" in swapped.message


@pytest.mark.quick("kr30-95")
@pytest.mark.parametrize(("arm", "seed"), [("kr30", 95), ("cobot", 91)])
def test_sampled_rows_without_a_reflector_give_no_finding(campaign: Campaign, arm: str, seed: int) -> None:
    # The check samples 60 of 180 rows: one has the third reflector, and with the positions shifted by a row none has.
    targets = {"names": ["A", "B", "C"], "order": "each_pose"}
    data, robot = campaign(arm, seed, poses=60, repeats={"poses": 2, "times": 3}, targets=targets)
    assert errors_and_warnings(data, robot) == []


def test_short_shift_is_a_warning_and_does_not_stop_a_fit(campaign: Campaign) -> None:
    data, robot = campaign()
    brief = shifted(data, 60, 67)
    # The shift makes the copy at its end: neither the copy nor gross errors are reported in addition.
    (found,) = errors_and_warnings(brief, robot)
    assert (found.code, found.severity) == ("rows_shifted", "warning")
    assert any("in rows 62 to 69" in doubt for doubt in refuse_what_cannot_be_an_arm(brief, robot))


def test_positions_that_follow_their_own_rows_give_no_finding(campaign: Campaign) -> None:
    for arm in ("kr30", "scara", "cobot"):
        assert not errors_and_warnings(*campaign(arm))
    data, robot = campaign(targets={"names": ["A", "B"], "order": "cycle"})
    assert not errors_and_warnings(data, robot)


def test_gross_errors_and_swapped_rows_are_no_shift(campaign: Campaign) -> None:
    data, robot = campaign()
    columns = {name: data.columns[name].copy() for name in "xyz"}
    for values in columns.values():
        values[[30, 31]] = values[[31, 30]]
        values[100:130] += 0.05
    wrong = replace(data, columns={**data.columns, **columns})
    assert "rows_shifted" not in [found.code for found in check(wrong, robot).findings]


@pytest.mark.parametrize(("count", "severity"), [(8, "warning"), (30, "error"), (105, "error")])
def test_exchanged_reflector_names_are_reported_with_their_rows(
    campaign: Campaign, count: int, severity: str
) -> None:
    data, robot = campaign(targets={"names": ["A", "B"], "order": "cycle"})
    target = data.columns["target"].copy()
    target[60 : 60 + count] = 1.0 - target[60 : 60 + count]
    (found,) = errors_and_warnings(replace(data, columns={**data.columns, "target": target}), robot)
    assert (found.code, found.severity) == ("reflectors_exchanged", severity)
    assert (
        f"in rows 62 to {61 + count} the names of the reflectors 'A' and 'B' are exchanged" in found.message
    )
    assert found.remedy.startswith("Exchange 'A' and 'B' in the column target")


def test_reflector_name_that_was_not_changed_is_reported(campaign: Campaign) -> None:
    data, robot = campaign(targets={"names": ["A", "B"], "order": "cycle"})
    target = data.columns["target"].copy()
    target[60:90] = data.labels["target"].index("A")
    (found,) = errors_and_warnings(replace(data, columns={**data.columns, "target": target}), robot)
    assert "the positions that the file assigns to reflector 'A' are those of 'B'" in found.message
    assert len(found.evidence["rows"]) == 15


def test_reflector_that_cannot_be_placed_gives_no_infinity(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the rows of one reflector follow the nominal arm exactly, the alignment gives those of the other no weight."""
    data, robot = campaign()
    exact = nominal_positions(data, robot, robot.spec["base"], robot.spec["tool"])
    near = exact + np.random.default_rng(1).normal(0.0, 4e-4, exact.shape)
    points = np.stack([exact, near], axis=1).reshape(-1, 3)
    columns = {name: np.repeat(values, 2) for name, values in data.columns.items()}
    columns |= {name: points[:, axis].copy() for axis, name in enumerate("xyz")}
    columns["target"] = np.tile([0.0, 1.0], data.count)
    rows = np.arange(2 * data.count) + 2
    both = replace(data, columns=columns, labels={"target": ["TCP", "Leica"]}, rows=rows)

    def without_the_second(*of: Any) -> Alignment:
        found = align(*of)
        return replace(found, flange_from_tool={**found.flange_from_tool, "1": {"xyz": [0.0, 0.0, 0.0]}})

    monkeypatch.setattr(pairing, "align", without_the_second)
    report = check(both, robot)
    assert "reflectors_exchanged" not in [found.code for found in report.findings]
    assert not any("inf" in found.message.split() for found in report.findings)
    json.dumps(report.document(), allow_nan=False)


def test_non_finite_evidence_is_null_in_the_document() -> None:
    found = Finding("x", "note", "y", {"a_m": math.inf, "rows": [1.0, math.nan], "b": {"c": 1}})
    (entry,) = CheckReport.of([found]).document()["findings"]
    assert entry["evidence"] == {"a_m": None, "rows": [1.0, None], "b": {"c": 1}}
