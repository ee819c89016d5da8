"""The instrument's own errors: fitted, so that they spoil nothing, and left out of what is predicted of the arm."""

from __future__ import annotations

import numpy as np
import pytest
from armtrue.errors import InputError
from fitting_given import GEOMETRY


def test_prediction_beside_errors_of_the_instrument_is_where_the_arm_is(campaign) -> None:
    given = campaign(poses=240)
    points = given.data.positions_m
    x, y, z = points.T
    across, distance = np.hypot(x, y), np.linalg.norm(points, axis=1)
    turn = 6e-5 * across / distance  # the circle of elevation sits off its axis
    wrong = turn[:, None] * np.stack([-z * x / across, -z * y / across, across], axis=1)
    moved = dict(zip("xyz", np.ascontiguousarray((points + wrong).T), strict=True))
    exact = given.fit(GEOMETRY).predict(given.data)
    fit = given.with_columns(**moved).fit([*GEOMETRY, "tracker_angles"])
    off = fit.predict(given.data) - exact
    # A motion of all points as one body is the base frame's, which no campaign tells from the instrument's.
    bodily = np.concatenate(
        [
            np.stack([np.cross(axis, points).ravel() for axis in np.eye(3)], axis=1),
            np.tile(np.eye(3), (len(points), 1)),
        ],
        axis=1,
    )
    motion = np.linalg.lstsq(bodily, off.ravel(), rcond=None)[0]
    assert np.linalg.norm(off.ravel() - bodily @ motion) / np.sqrt(len(points)) < 2e-6
    # Prediction, which has the base frame alone, follows what was measured but for the rest that is no such motion.
    assert np.linalg.norm(off - wrong, axis=1).mean() < 0.2 * np.linalg.norm(wrong, axis=1).mean()


def test_oval_circle_of_azimuth_is_found_by_its_second_order(campaign) -> None:
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


def test_circle_of_a_third_order_is_refused(campaign) -> None:
    with pytest.raises(InputError, match="tracker_angles: found order 3, expected 1 or 2"):
        campaign(poses=30).fit([*GEOMETRY, {"effect": "tracker_angles", "orders": [3]}])
