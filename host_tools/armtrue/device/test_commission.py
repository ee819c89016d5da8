"""Drives in another order, with another sign or scale are found from targets and actual positions alone."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from armtrue.arrays import Array
from armtrue.device.commission import examine

JOINTS, CYCLES = 6, 3000


def one_after_the_other(amplitude: float = 50_000.0) -> Array:
    """Each axis in turn swings once while the others are at rest."""
    targets = np.zeros((CYCLES, JOINTS))
    share = CYCLES // JOINTS
    for k in range(JOINTS):
        targets[k * share : (k + 1) * share, k] = amplitude * np.sin(np.linspace(0.0, 2.0 * np.pi, share))
    return targets + 1000.0 * np.arange(JOINTS)


def all_at_once() -> Array:
    """All axes swing at once, each at its own frequency."""
    time = np.linspace(0.0, 20.0, CYCLES)
    return np.stack([40_000.0 * np.sin((0.4 + 0.23 * k) * time + k) for k in range(JOINTS)], axis=1)


def drives(targets: Array, lag: float = 0.12, noise: float = 2.0) -> Array:
    """Actual positions of position loops that lag behind the targets, with encoder noise."""
    actual = np.empty_like(targets)
    position = targets[0].copy()
    for k, target in enumerate(targets):
        actual[k] = position
        position += lag * (target - position)
    return np.round(actual + np.random.default_rng(1).normal(0.0, noise, actual.shape))


@pytest.mark.parametrize("motion", [one_after_the_other, all_at_once])
def test_correct_drives_give_no_finding(motion: Callable[[], Array]) -> None:
    targets = motion()
    report = examine(targets, drives(targets))
    assert report.is_right, (report.findings, report.unknown)
    assert [axis.follows for axis in report.axes] == [(k,) for k in range(1, JOINTS + 1)]


@pytest.mark.parametrize("motion", [one_after_the_other, all_at_once])
def test_two_exchanged_drives_are_reported_in_one_sentence(motion: Callable[[], Array]) -> None:
    targets = motion()
    actuals = drives(targets)[:, [0, 2, 1, 3, 4, 5]]
    assert examine(targets, actuals).findings == ["axes 2 and 3: their drives are exchanged"]


def test_three_cyclically_exchanged_drives_are_each_named() -> None:
    targets = one_after_the_other()
    actuals = drives(targets)[:, [1, 2, 0, 3, 4, 5]]
    assert examine(targets, actuals).findings == [
        "axis 1: its drive follows the target of axis 2",
        "axis 2: its drive follows the target of axis 3",
        "axis 3: its drive follows the target of axis 1",
    ]


def test_reversed_axis_is_named() -> None:
    targets = all_at_once()
    actuals = drives(targets) * np.array([1, 1, 1, -1, 1, 1])
    assert examine(targets, actuals).findings == ["axis 4: the drive moves backwards"]


@pytest.mark.parametrize("scale", [16.0, 0.5, 1.05])
def test_wrong_scale_is_named_with_its_size(scale: float) -> None:
    targets = one_after_the_other()
    actuals = drives(targets)
    actuals[:, 4] = scale * actuals[:, 4] + 1e6  # counted from another zero, which is no scale error
    (sentence,) = examine(targets, actuals).findings
    found = re.fullmatch(r"axis 5: the drive moves (\S+) times as far as commanded", sentence)
    assert found is not None, sentence
    assert float(found[1]) == pytest.approx(scale, rel=0.01)


def test_table_correction_is_not_reported_as_wrong_scale() -> None:
    targets = all_at_once()
    actuals = drives(targets + 300.0 * np.sin(targets / 9000.0))
    assert examine(targets, actuals).is_right


def test_exchange_is_found_with_frames_some_cycles_early_or_late() -> None:
    targets = one_after_the_other()
    moments = np.arange(CYCLES) + np.random.default_rng(2).integers(-6, 7, CYCLES)
    actuals = drives(targets)[np.clip(moments, 0, CYCLES - 1)][:, [0, 2, 1, 3, 4, 5]]
    assert examine(targets, actuals).findings == ["axes 2 and 3: their drives are exchanged"]


def test_frames_in_bursts_are_not_reported_as_wrong_scale() -> None:
    targets = all_at_once()
    moments = np.arange(CYCLES) - 3
    moments -= moments % 100  # a busy machine seldom reads its socket
    assert examine(targets, drives(targets)[np.clip(moments, 0, CYCLES - 1)]).findings == []


def test_lag_in_fast_motion_is_not_reported_as_wrong_scale() -> None:
    time = np.linspace(0.0, 20.0, CYCLES)
    fastest = 0.24 * CYCLES / 20.0 / 10.0  # a lag of ten cycles takes 3 % of it
    targets = np.stack(
        [40_000.0 * np.sin((1.0 - 0.13 * k) * fastest * time + k) for k in range(JOINTS)], axis=1
    )
    assert examine(targets, drives(targets, lag=0.1)).findings == []


def test_axis_that_was_not_moved_is_unknown() -> None:
    targets = one_after_the_other()
    targets[:, 5] = 7.0
    report = examine(targets, drives(targets))
    assert report.findings == []
    assert report.unknown == ["axis 6: was commanded to move 0 increments, at least 1000 are needed"]


def test_axes_with_proportional_targets_are_unknown() -> None:
    targets = all_at_once()
    targets[:, 1] = 2.0 * targets[:, 0] + 5.0
    report = examine(targets, drives(targets))
    assert report.findings == []
    assert report.unknown == [
        "axes 1 and 2 were commanded alike and cannot be told apart: move one after the other"
    ]


def test_drive_at_rest_and_silent_drive_are_named() -> None:
    targets = one_after_the_other()
    actuals = drives(targets)
    actuals[:, 1] = 5.0
    actuals[:, 2] = np.nan
    stands, silent = examine(targets, actuals).findings
    assert stands == "axis 2: commanded to move 100000 increments, and its drive does not follow"
    assert silent.startswith("axis 3: no actual position was heard: map 0x7064 in a valid RPDO")


def test_empty_recording_is_not_reported_as_correct() -> None:
    nothing = np.zeros((0, JOINTS))
    assert not examine(nothing, nothing).is_right


def test_axis_declared_without_a_drive_may_be_silent() -> None:
    targets = one_after_the_other()
    actuals = drives(targets)
    targets[:, 3], actuals[:, 3] = 0.0, np.nan
    (sentence,) = examine(targets, actuals).findings
    assert sentence.startswith("axis 4: no actual position was heard")
    assert examine(targets, actuals, frozenset({3})).is_right
