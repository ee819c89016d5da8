"""Rules of a fit: stated poses are absolute, a prediction depends on its row alone, parameters in expressions move."""

from __future__ import annotations

import copy

import armtrue
import numpy as np
import pytest
from armtrue.errors import InputError
from fitting_given import GEOMETRY


def test_stated_tool_offset_is_the_absolute_tool_position(campaign):
    given = campaign()
    free = given.fit(GEOMETRY)
    x = free.document["flange_from_tool"][""]["xyz"][0]
    assert abs(x) > 0.02
    stated = given.fit(GEOMETRY, parameters={"tool_offset.tx": {"fixed": x + 1e-4}})
    assert stated.document["flange_from_tool"][""]["xyz"][0] == pytest.approx(x + 1e-4, abs=1e-12)
    held = given.fit(GEOMETRY, parameters={"tool_offset.tx": {"prior": x, "sigma": 1e-9}})
    assert held.document["flange_from_tool"][""]["xyz"][0] == pytest.approx(x, abs=1e-8)
    assert held.document["error"]["train"]["mean_um"] == pytest.approx(
        free.document["error"]["train"]["mean_um"], rel=0.02
    )


def test_stated_base_frame_is_the_absolute_base_pose(campaign):
    given = campaign()
    base = given.fit(GEOMETRY).document["measuring_from_base"]
    moved = [base["xyz"][0], base["xyz"][1], base["xyz"][2] + 1e-3]
    stated = dict(zip(("tx", "ty", "tz"), moved, strict=True)) | dict(
        zip(("rx", "ry", "rz"), base["rpy"], strict=True)
    )
    fit = given.fit(GEOMETRY, parameters={f"base_frame.{c}": {"fixed": v} for c, v in stated.items()})
    assert fit.document["measuring_from_base"]["xyz"] == pytest.approx(moved, abs=1e-12)
    assert fit.document["measuring_from_base"]["rpy"] == pytest.approx(base["rpy"], abs=1e-12)


@pytest.mark.parametrize("weak", [("tx",), ("ty",), ("tz",), ("tx", "ty")])
def test_partly_stated_position_of_a_turned_base_is_refused(campaign, weak):
    held = {"fixed": 0.1}
    known = {"prior": 0.1, "sigma": 1e-3}
    stated = {f"base_frame.{c}": known if c in weak else held for c in ("tx", "ty", "tz")}
    with pytest.raises(InputError, match="expected tx, ty and tz together"):
        campaign().fit(GEOMETRY, parameters=stated)
    with pytest.raises(InputError, match="expected tx, ty and tz together"):
        campaign().fit(GEOMETRY, parameters={f"base_frame.{c}": held for c in weak})


def test_every_argument_of_hat_can_be_fitted(campaign):
    given = campaign()
    free = given.fit(GEOMETRY)
    places = np.quantile(given.data.columns["q2"], [0.1, 0.4, 0.8])
    bump = dict(zip(("left", "centre", "right"), map(float, places), strict=True))
    document = copy.deepcopy(free.document)
    truth = f"hat(q2, {bump['left']}, {bump['centre']}, {bump['right']})"
    document["parameters"].append(
        {
            "name": "custom.bump",
            "effect": "custom",
            "joints": [],
            "value": 2e-3,
            "unit": "rad",
            "terms": [{"coordinate": "motor3", "expression": truth, "weight": 1.0, "table": None}],
        }
    )
    exact = armtrue.Fit(document).predict(given.data)
    noise = np.random.default_rng(3).normal(0.0, 2e-6, exact.shape)
    with_bump = given.with_columns(**dict(zip("xyz", (exact + noise).T, strict=True)))
    effect = {
        "effect": "custom",
        "name": "bump",
        "coordinate": "motor3",
        "expression": "hat(q2, left, centre, right)",
        "parameters": {name: value + 0.1 for name, value in bump.items()},
    }
    found = {p["name"]: p["value"] for p in with_bump.fit([*GEOMETRY, effect]).document["nonlinear"]}
    assert found == {name: pytest.approx(value, abs=0.01) for name, value in bump.items()}


def test_prediction_of_a_row_does_not_depend_on_the_other_rows(campaign):
    """A prediction takes the torques of its row as measured, although a fit smooths them."""
    given = campaign(hidden=["joint_compliance"])
    rng = np.random.default_rng(5)
    torque = {
        f"tau{k}": 300.0 * np.cos(given.data.columns[f"q{k}"]) + rng.normal(0.0, 5.0, given.data.count)
        for k in (2, 3)
    }
    given = given.with_columns(**torque)
    given.robot.spec.pop("links", None)
    fit = given.fit([*GEOMETRY, *custom_springs()])
    whole = fit.predict(given.data)
    assert fit.predict(given.rows(slice(10, 20))) == pytest.approx(whole[10:20], abs=1e-12)


def custom_springs() -> list[dict[str, object]]:
    return [
        {
            "effect": "custom",
            "name": f"s{k}",
            "coordinate": f"motor{k}",
            "expression": f"tau{k}",
            "bound": 1e-4,
        }
        for k in (2, 3)
    ]


def test_prediction_reads_the_thermometer_of_the_fit(campaign):
    given = campaign(hidden=["thermal_expansion"])
    fit = given.fit([*GEOMETRY, "thermal_expansion"])
    whole = fit.predict(given.data)
    another = given.with_columns(temp_aaa=np.full(given.data.count, 80.0))
    assert fit.predict(another.data) == pytest.approx(whole, abs=1e-12)
    assert "temp_arm" in fit.document["columns"]


def test_prediction_without_a_needed_column_names_it(campaign):
    given = campaign(hidden=["thermal_expansion"])
    fit = given.fit([*GEOMETRY, "thermal_expansion"])
    given.data.columns.pop("temp_arm")
    with pytest.raises(InputError, match="column temp_arm is missing"):
        fit.predict(given.data)


def test_clock_offset_changes_neither_fit_nor_predictions(campaign):
    given = campaign(hidden=[{"effect": "warm_up"}])
    model = [*GEOMETRY, "warm_up"]
    fit = given.fit(model)
    later = given.with_columns(time=given.data.columns["time"] + 1.7e9)
    again = later.fit(model)
    assert again.document["error"]["train"]["mean_um"] == pytest.approx(
        fit.document["error"]["train"]["mean_um"], rel=1e-3
    )
    tail = later.rows(slice(60, 120))
    assert again.predict(tail) == pytest.approx(fit.predict(given.rows(slice(60, 120))), abs=1e-7)


def test_finer_table_predicts_a_gap_as_well_as_a_coarse_one(campaign):
    # Later poses of a real arm lay between the fitted angles, where its finer tables had fallen back to zero.
    slow = {"effect": "gear_harmonics", "joints": [2], "scale": 4.0}
    given = campaign(arm="cobot", poses=900, hidden=[slow], test_poses=0)
    q2 = given.data.columns["q2"]
    gap = np.abs(q2 - np.median(q2)) < 0.09
    errors = []
    for spacing in (0.026, 0.0116):
        table = {"effect": "transmission_pwl", "joints": [2], "spacing": spacing}
        seen, unseen = given.data.take(~gap), given.data.take(gap)
        fit = armtrue.fit(seen, given.robot, given.model([*GEOMETRY, "joint_compliance", table]))
        errors.append(np.linalg.norm(fit.predict(unseen) - unseen.positions_m, axis=1).mean())
    assert errors[1] < 1.1 * errors[0]
