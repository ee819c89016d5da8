"""Errors of the instrument: fitted beside those of the arm, and included in predicted readings."""

from __future__ import annotations

import dataclasses

import armtrue
import numpy as np
import pytest
from armtrue.errors import InputError
from armtrue.uncertainty import position_covariance
from fitting_given import GEOMETRY


@pytest.mark.parametrize("effect", ["tracker_angles", "tracker_scale"])
def test_prediction_includes_the_errors_of_the_instrument(campaign, effect: str) -> None:
    given = campaign(poses=240)
    # A distance scale is identifiable only if the arm's own lengths are known.
    known = GEOMETRY if effect == "tracker_angles" else ["base_frame", "tool_offset", "joint_offset"]
    given = given.with_columns(**dict(zip("xyz", given.fit(known).predict(given.data).T, strict=True)))
    exact = given.data.positions_m
    x, y, z = exact.T
    wrong = 6e-5 * exact
    if effect == "tracker_angles":  # the elevation circle is eccentric
        across, distance = np.hypot(x, y), np.linalg.norm(exact, axis=1)
        turn = 6e-5 * across / distance
        wrong = turn[:, None] * np.stack([-z * x / across, -z * y / across, across], axis=1)
    fit = given.with_columns(**dict(zip("xyz", (exact + wrong).T, strict=True))).fit([*known, effect])
    unseen = dataclasses.replace(
        given.data, columns={name: v for name, v in given.data.columns.items() if name not in ("x", "y", "z")}
    )
    assert np.linalg.norm(fit.predict(unseen) - exact - wrong, axis=1).max() < 1e-6
    assert np.array_equal(fit.predict(unseen), fit.predict(given.data)), "what was measured plays no part"
    assert position_covariance(fit, unseen).shape == (len(exact), 3, 3)


def test_oval_azimuth_circle_is_found_by_order_2(campaign) -> None:
    given = campaign(poses=240)
    x, y, _z = given.data.positions_m.T
    turn = 3e-5 * np.sin(2.0 * np.arctan2(y, x))
    moved = given.with_columns(x=x - turn * y, y=y + turn * x)
    document = moved.fit([*GEOMETRY, {"effect": "tracker_angles", "orders": [2]}]).document
    found = {p["name"]: p for p in document["parameters"] if p["effect"] == "tracker_angles"}
    assert len(found) == 4
    oval = found.pop("tracker_angles.azimuth_sin2")
    assert abs(oval["value"] - 3e-5) < 4.0 * oval["sigma"] < 3e-5
    assert all(abs(other["value"]) < 4.0 * other["sigma"] for other in found.values())


def test_tracker_angles_of_order_3_are_refused(campaign) -> None:
    with pytest.raises(InputError, match="tracker_angles: found order 3, expected 1 or 2"):
        campaign(poses=30).fit([*GEOMETRY, {"effect": "tracker_angles", "orders": [3]}])


@pytest.mark.full
def test_constant_distance_error_is_named_tracker_scale(campaign) -> None:
    # The zero error of a distance meter was named as eccentric circles, with more than 99 %.
    given = campaign(poses=200)
    exact = given.data.positions_m
    along = 8e-5 * exact / np.linalg.norm(exact, axis=1)[:, None]
    longer = given.with_columns(**dict(zip("xyz", (exact + along).T, strict=True)))
    refined, story = armtrue.refine(longer.fit(GEOMETRY))
    added = [step["added"]["effect"] for step in story["steps"] if step["added"]]
    assert added == ["tracker_scale"]
    constant = next(p for p in refined.document["parameters"] if p["effect"] == "tracker_scale")
    assert abs(constant["value"] - 8e-5) < 4.0 * constant["sigma"] < 4e-5
