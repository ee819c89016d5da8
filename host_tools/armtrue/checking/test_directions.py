"""Columns `dir` against the order of the rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import armtrue_sim
import numpy as np
import pytest

from armtrue.checking import Finding
from armtrue.checking.directions import find
from armtrue.checking.run import refuse_what_cannot_be_an_arm
from armtrue.io import Dataset, Robot, load_data, load_robot

Change = Callable[[np.ndarray], np.ndarray]


@pytest.fixture
def campaign(tmp_path: Path) -> Callable[..., tuple[Dataset, Robot]]:
    def simulated(arm: str = "kr30", seed: int = 131, **more: object) -> tuple[Dataset, Robot]:
        armtrue_sim.simulate({"arm": arm, "seed": seed, "hidden": [], **more}).write(tmp_path)
        robot = load_robot(tmp_path / "robot.yaml")
        return load_data(tmp_path / "data.csv", robot), robot

    return simulated


def with_directions(data: Dataset, change: Change, joints: range = range(1, 7)) -> Dataset:
    changed = {f"dir{k}": change(data.columns[f"dir{k}"]) for k in joints}
    return replace(data, columns={**data.columns, **changed})


def late(side: np.ndarray) -> np.ndarray:
    return np.concatenate([side[:1], side[:-1]])


def early(side: np.ndarray) -> np.ndarray:
    return np.concatenate([side[1:], side[-1:]])


def only(findings: list[Finding]) -> Finding:
    (found,) = findings
    return found


@pytest.mark.parametrize(("arm", "seed"), [("kr30", 131), ("cobot", 132), ("kr30", 133)])
@pytest.mark.parametrize(
    ("change", "words"), [(late, "moved up by one row"), (early, "moved down by one row")]
)
def test_directions_one_row_off_are_a_warning(campaign, arm, seed, change, words):
    data, robot = campaign(arm, seed, directions="order")
    wrong = with_directions(data, change)
    found = only(find(wrong))
    assert found.severity == "warning"
    assert "dir1…dir6" in found.message
    assert f"and in 100% if {words}" in found.message
    assert "derive: {dir: from_order}" in found.remedy
    assert any(words in doubt for doubt in refuse_what_cannot_be_an_arm(wrong, robot))


def test_directions_of_the_other_sign_are_named(campaign):
    data, _ = campaign(directions="order")
    found = only(find(with_directions(data, np.negative, range(2, 4))))
    assert "dir2, dir3" in found.message
    assert "taken with the other sign" in found.message
    assert "'dir2: {column: dir2, scale: -1}'" in found.remedy


def test_rows_are_taken_in_order_of_time(campaign):
    data, _ = campaign(directions="order")
    mixed = np.random.default_rng(3).permutation(data.count)
    assert find(data.take(mixed)) == []
    assert find(with_directions(data, late).take(mixed))


def test_directions_that_agree_or_tell_nothing_raise_nothing(campaign):
    data, _ = campaign(directions="order")
    assert find(data) == []
    # The arm came by way of other points; too few motions to tell.
    assert find(campaign(directions="random")[0]) == []
    assert find(with_directions(data, late).take(np.arange(20))) == []
    # A joint that goes one way for long agrees as it stands and moved.
    one_way = np.arange(float(data.count))
    long_way = replace(data, columns={**data.columns, "q1": one_way, "dir1": np.ones(data.count)})
    assert find(with_directions(long_way, late, range(1, 2))) == []
