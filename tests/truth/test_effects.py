"""Each effect alone, and all together, on arms whose truth is exact: coefficients, and errors at fresh poses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from known_arm import GEOMETRY, KnownArm

SEEDS = 40
SIGMAS = 4.0
# Relative to the Cramer-Rao bound. The mean over 40 seeds scatters by 1 to 2 %.
LARGEST_RATIO = 1.05
HELD_GEOMETRY = 1e-3  # what the data cannot tell of lengths and angles, m and rad
BELIEVED = [*GEOMETRY, "joint_compliance"]

CUSTOM: dict[str, Any] = {
    "effect": "custom",
    "name": "cable",
    "coordinate": "motor3",
    "expression": "sin(q1)*cos(q5)",
    "value": 1.5e-4,
}
CASES: dict[str, dict[str, Any]] = {
    "geometry": {"arm": "kr30"},
    "geometry in standard DH": {"arm": "cobot", "convention": "dh"},
    "geometry of seven axes": {
        "arm": "lbr",
        "believed": [*GEOMETRY, {"effect": "joint_compliance", "joints": [2, 4, 6]}],
    },
    "a linkage that is perfect": {"arm": "irb2400"},
    "a spindle": {"arm": "scara", "believed": GEOMETRY},
    "a telescopic axis under gravity": {"arm": "stanford", "convention": "dh"},
    "joint_scale": {"arm": "kr30", "hidden": ["joint_scale"]},
    "joint_compliance on every axis": {
        "arm": "cobot",
        "believed": GEOMETRY,
        "hidden": [{"effect": "joint_compliance", "joints": [2, 3, 4, 5]}],
    },
    "stiffness_nonlinear": {"arm": "cobot", "hidden": ["stiffness_nonlinear"]},
    "bending_compliance": {
        "arm": "kr30",
        "hidden": [{"effect": "bending_compliance", "joints": [2, 3, 4]}],
    },
    "base_compliance": {"arm": "kr30", "hidden": ["base_compliance"]},
    "gear_harmonics": {"arm": "kr30", "hidden": [{"effect": "gear_harmonics", "joints": [1, 3, 4, 5]}]},
    "gear_mesh": {"arm": "cobot", "hidden": ["gear_mesh"]},
    "backlash": {"arm": "kr30", "hidden": ["backlash"]},
    "joint_coupling": {"arm": "kr30", "hidden": ["joint_coupling"]},
    "parallelogram": {"arm": "irb2400", "hidden": ["parallelogram"]},
    "thermal_expansion": {"arm": "kr30", "hidden": ["thermal_expansion"]},
    "thermal_joint_drift": {"arm": "kr30", "hidden": ["thermal_joint_drift"]},
    "thermal_base": {"arm": "kr30", "hidden": ["thermal_base"]},
    "time_drift": {"arm": "kr30", "hidden": ["time_drift"]},
    "command_readback": {"arm": "kr30", "hidden": ["command_readback"], "columns": {"add": ["qr"]}},
    "custom": {"arm": "kr30", "hidden": [CUSTOM]},
}
TOGETHER: dict[str, Any] = {
    "arm": "kr30",
    "hidden": [
        *("joint_scale", "stiffness_nonlinear", "bending_compliance", "base_compliance", "gear_harmonics"),
        *(
            "gear_mesh",
            "backlash",
            "joint_coupling",
            "thermal_expansion",
            "thermal_joint_drift",
            "thermal_base",
        ),
        *("time_drift", "command_readback", CUSTOM),
    ],
    "columns": {"add": ["qr"]},
}


def model_of(arm: KnownArm) -> list[Any]:
    """The true model without the keys that state the size of an effect, which only the simulator reads."""
    return [
        e if isinstance(e, str) else {k: v for k, v in e.items() if k not in ("value", "scale")}
        for e in arm.campaign.true_model["effects"]
    ]


def known(scenario: dict[str, Any], poses: int) -> KnownArm:
    """The arm of a case, with a model of all its effects."""
    arm = KnownArm.of({"seed": 11, "believed": BELIEVED, **scenario}, poses=poses)
    arm.model = {"effects": model_of(arm)}
    return arm


def assert_known(arm: KnownArm, largest_left_m: float) -> None:
    """Coefficients within 4 sigma, and the error at fresh poses within 5 % of the bound."""
    fit = arm.fit(seed=0)
    _, left = fit.projected_truth()
    # Loads act on the true geometry: the held part of it, about 1 mm and 1 mrad, changes the sag by as much per metre.
    allowed = largest_left_m + HELD_GEOMETRY * arm.sag().max()
    assert left.max() < allowed, "the model cannot stand where the real arm stands"
    off = np.abs(fit.deviations())
    worst = int(np.argmax(off))
    assert off[worst] < SIGMAS, f"{fit.kept[worst]['name']} is {off[worst]:.1f} sigma off"
    bound = np.sqrt(np.mean(fit.predicted_rms() ** 2))
    errors = np.concatenate([arm.fit(seed).fresh_errors() for seed in range(SEEDS)])
    ratio = np.sqrt(np.mean(errors**2)) / bound
    assert ratio < LARGEST_RATIO, f"{ratio:.3f} of the bound, {1e6 * bound:.2f} um"


# Cases on the same arm with springs in the same places are alike: the quick level has one.
@pytest.mark.quick("parallelogram")
@pytest.mark.parametrize("name", CASES)
def test_each_effect_alone_is_recovered(name: str) -> None:
    # Distances that remain with the true values: second order of held parameters, and of the linkage's bars.
    linkage = name == "parallelogram"
    assert_known(known(CASES[name], poses=240), largest_left_m=1.5e-6 if linkage else 6e-7)


@pytest.mark.full
def test_all_effects_together_are_recovered() -> None:
    assert_known(known(TOGETHER, poses=600), largest_left_m=1e-6)


def test_warm_up_finds_its_time_constant() -> None:
    arm = known({"arm": "kr30", "hidden": [{"effect": "warm_up", "tau": 2000.0}]}, poses=240)
    arm.model = {"effects": [*BELIEVED, "warm_up"]}
    truth = {t["coordinate"]: t["value"] for t in arm.campaign.truth["terms"] if t["effect"] == "warm_up"}
    fit = arm.fit(seed=0)
    tau = fit.document["nonlinear"][0]
    assert abs(tau["value"] - 2000.0) < SIGMAS * tau["sigma"] < 400.0
    for p in fit.kept:
        if p["effect"] == "warm_up":
            expected = truth[p["terms"][0]["coordinate"]]
            assert abs(p["value"] - expected) < SIGMAS * p["sigma"], p["name"]


def test_gear_mesh_finds_an_unknown_ratio() -> None:
    hidden = {"effect": "gear_mesh", "joints": [3], "orders": [1], "ratio": 57.3}
    arm = known({"arm": "kr30", "hidden": [hidden]}, poses=240)
    arm.model = {
        "effects": [*BELIEVED, {"effect": "gear_mesh", "joints": [3], "cycles": [57.1], "find": True}]
    }
    cycles = arm.fit(seed=0).document["nonlinear"][0]
    assert abs(cycles["value"] - 57.3) < SIGMAS * cycles["sigma"] < 0.05


def test_gravity_balancer_is_fitted_without_initial_geometry() -> None:
    arm = known({"arm": "kr30", "hidden": ["gravity_balancer"]}, poses=240)
    arm.model = {"effects": [*BELIEVED, "gravity_balancer"]}
    fit = arm.fit(seed=0)
    values, _ = fit.projected_truth()
    without = KnownArm(arm.campaign, {"effects": BELIEVED}).fit(seed=0)
    assert fit.fresh_errors().mean() < 6e-6 < 0.5 * without.fresh_errors().mean()
    assert np.isfinite(values).all()


@pytest.mark.quick("table")
@pytest.mark.parametrize("shape", ["waves", "table"])
def test_tables_follow_errors_without_a_formula(shape: str) -> None:
    hidden = {"effect": "transmission_pwl", "joints": [1, 2, 3], "shape": shape}
    arm = known({"arm": "cobot", "hidden": [hidden]}, poses=1500)
    arm.model = {"effects": [*BELIEVED, {"effect": "transmission_pwl", "joints": [1, 2, 3]}]}
    without = KnownArm(arm.campaign, {"effects": BELIEVED}).fit(seed=0).fresh_errors()
    errors = arm.fit(seed=0).fresh_errors()
    # Some 250 nodes from 4500 numbers: the error is the table's own noise and the corners of the curve it follows.
    assert errors.mean() < 12e-6 < 0.2 * without.mean()


def test_residual_grid_more_than_halves_the_error() -> None:
    arm = known({"arm": "kr30", "hidden": [{"effect": "residual_grid", "size": 6e-5}]}, poses=600)
    arm.model = {"effects": [*BELIEVED, {"effect": "residual_grid", "nodes": [4, 4, 4]}]}
    without = KnownArm(arm.campaign, {"effects": BELIEVED}).fit(seed=0).fresh_errors()
    assert arm.fit(seed=0).fresh_errors().mean() < 0.4 * without.mean()
