"""Implausible data: too few poses, positions in another unit, temperatures that no arm has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.io.plausible import refuse_too_few_poses, too_few_poses, wrong_units
from armtrue.io.robot import Robot

JOINTS = [{"name": "1", "a": 0.0, "alpha": 0.0, "d": 1.0, "offset": 0.0, "type": "revolute"}]
ARM = Robot({"name": "one", "kinematics": {"convention": "mdh", "joints": JOINTS}})
POINTS = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))


@pytest.mark.parametrize(
    ("count", "travel", "words"),
    [
        (1, 0.0, "found 1 different pose, expected at least 10"),
        (9, 1.0, "found 9 different poses, expected at least 10"),
        (10, 0.04, "found no joint that moves more than 0.04, expected 0.05 at least"),
    ],
)
def test_too_few_poses_or_too_little_travel_is_reported(count: int, travel: float, words: str) -> None:
    assert too_few_poses(np.column_stack([np.linspace(0.0, travel, count), np.zeros(count)])) == words


def test_ten_poses_of_one_moving_joint_are_enough() -> None:
    joints = np.column_stack([np.linspace(0.0, 0.06, 10), np.zeros(10)])
    assert too_few_poses(joints) is None
    refuse_too_few_poses(Path("a.csv"), joints)
    with pytest.raises(InputError, match=r"^a\.csv: found 9 different poses"):
        refuse_too_few_poses(Path("a.csv"), joints[1:])


@pytest.mark.parametrize(("per_metre", "likely"), [(1000.0, "millimetres"), (39.37, "inches or centimetres")])
def test_positions_in_another_unit_name_the_likely_unit(per_metre: float, likely: str) -> None:
    columns = dict(zip("xyz", per_metre * POINTS.T, strict=True))
    ((_, _, expected),) = wrong_units(columns, ARM)
    assert f"these look like {likely})" in expected


def test_positions_in_metres_are_plausible() -> None:
    assert wrong_units(dict(zip("xyz", POINTS.T, strict=True)), ARM) == []


@pytest.mark.parametrize(
    ("cell", "meant"),
    [
        (-999.0, "below absolute zero it is a mark for a missing value"),
        (-100.0, "°C, not below -80"),
        (294.0, "these look like kelvin"),
    ],
)
def test_implausible_temperature_names_its_likely_meaning(cell: float, meant: str) -> None:
    ((name, at, expected),) = wrong_units({"temp_arm": np.array([20.0, 21.0, cell])}, ARM)
    assert (name, at) == ("temp_arm", 2)
    assert meant in expected
