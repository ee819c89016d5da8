"""What an export says and writes of its number and of the drives' counting."""

from __future__ import annotations

import re

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.tables import Exported, ExportOptions, export, fitted_arm, layout
from armtrue.tables.conftest import document
from armtrue.tables.image import Image


def exported(ratios: tuple[float | None, ...] = (None, None, None), **options: object) -> Exported:
    """A small fit, exported; `ratios` are the `gear_ratio` of its joints in robot.yaml."""
    fit = document([("motor2", "sin(q2)", 1e-4)])
    for row, ratio in zip(fit["robot"]["kinematics"]["joints"], ratios, strict=True):
        if ratio is not None:
            row["gear_ratio"] = ratio
    return export(fitted_arm(fit, "fit"), ExportOptions(**options))  # type: ignore[arg-type]


def increments_per_turn(made: Exported) -> list[float]:
    """Those of the joints in the image."""
    return [joint.increments * 2.0 * np.pi for joint in Image(made.image).joints()]


def test_two_exports_are_equal_and_a_sequence_changes_nothing_but_itself_and_the_checksum() -> None:
    first, again, later = exported(), exported(), exported(sequence=layout.MAX_SEQUENCE)
    assert first.image == again.image
    assert Image(first.image).header["sequence"] == 0
    assert Image(later.image).header["sequence"] == 4294967295
    assert first.image[:16] == later.image[:16]
    assert first.image[20:-4] == later.image[20:-4]


def test_negative_gear_ratio_without_increments_is_taken_to_count_with_the_joint_and_said() -> None:
    made = exported((100.0, -50.0, None))
    assert increments_per_turn(made) == pytest.approx([100 * 2**20, 50 * 2**20, 2**24], rel=1e-8)
    (note,) = made.notes
    assert re.search(r"^joint 2 has gear_ratio -50: .*--increments and a minus", note)


def test_increments_with_a_minus_are_written_and_nothing_is_guessed() -> None:
    made = exported((100.0, -50.0, None), increments=(1e6, -2e6, 3e6))
    assert increments_per_turn(made) == pytest.approx([1e6, -2e6, 3e6], rel=1e-8)
    assert made.notes == []


@pytest.mark.parametrize("increments", [(-15.9,), (-(2.0**31) - 1.0,), (1e6, -1e6), ()])
def test_increments_that_no_table_holds_are_refused_with_what_a_minus_means(
    increments: tuple[float, ...],
) -> None:
    words = "expected 1 or 3 numbers from 16 to 2147483648, negative where a drive counts against its joint"
    with pytest.raises(InputError, match=words):
        exported(increments=increments)
