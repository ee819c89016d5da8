"""Sequence number of an export, and increments of the drives."""

from __future__ import annotations

import re

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.tables import Exported, ExportOptions, export, fitted_arm, layout
from armtrue.tables.conftest import document
from armtrue.tables.export import _Exporter
from armtrue.tables.image import Image


def exported(ratios: tuple[float | None, ...] = (None, None, None), **options: object) -> Exported:
    """A small fit, exported; `ratios` are the `gear_ratio` of its joints in robot.yaml."""
    fit = document([("motor2", "sin(q2)", 1e-4)])
    for row, ratio in zip(fit["robot"]["kinematics"]["joints"], ratios, strict=True):
        if ratio is not None:
            row["gear_ratio"] = ratio
    return export(fitted_arm(fit, "fit"), ExportOptions(**options))  # type: ignore[arg-type]


def increments_per_turn(made: Exported) -> list[float]:
    """Increments per turn of the joints in the image."""
    return [joint.increments * 2.0 * np.pi for joint in Image(made.image).joints()]


@pytest.mark.parametrize(("measured_kg", "held_kg"), [(200.0, 200.0), (3.0, 50.0)])
def test_largest_payload_is_at_least_that_of_the_measurements(measured_kg: float, held_kg: float) -> None:
    # Tables of a fit with 200 kg took 50 kg as the largest payload: poses with more were corrected wrongly.
    fit = document([("motor2", "1e-3*payload", 1e-4)])
    fit["data"] = {"ranges": {"payload": [0.0, measured_kg]}}
    fit["robot"].pop("links", None)
    assert _Exporter(fitted_arm(fit, "fit"), ExportOptions(), "fit").payload_max_kg == held_kg


def test_sequence_changes_only_its_field_and_the_checksum() -> None:
    first, again, later = exported(), exported(), exported(sequence=layout.MAX_SEQUENCE)
    assert first.image == again.image
    assert Image(first.image).header["sequence"] == 0
    assert Image(later.image).header["sequence"] == 4294967295
    assert first.image[:16] == later.image[:16]
    assert first.image[20:-4] == later.image[20:-4]


def test_negative_gear_ratio_gives_positive_increments_and_note() -> None:
    made = exported((100.0, -50.0, None))
    assert increments_per_turn(made) == pytest.approx([100 * 2**20, 50 * 2**20, 2**24], rel=1e-8)
    (note,) = made.notes
    assert re.search(r"^joint 2 has gear_ratio -50: .*--increments and a minus", note)


def test_negative_increments_are_written_without_a_note() -> None:
    made = exported((100.0, -50.0, None), increments=(1e6, -2e6, 3e6))
    assert increments_per_turn(made) == pytest.approx([1e6, -2e6, 3e6], rel=1e-8)
    assert made.notes == []


@pytest.mark.parametrize("increments", [(-15.9,), (-(2.0**31) - 1.0,), (1e6, -1e6), ()])
def test_increments_of_bad_size_or_number_are_refused(
    increments: tuple[float, ...],
) -> None:
    words = "expected 1 or 3 numbers from 16 to 2147483648, negative where a drive counts against its joint"
    with pytest.raises(InputError, match=words):
        exported(increments=increments)
