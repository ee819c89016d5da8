"""The double-precision reference compared with the fitter (no shared code), and its inverse with its forward model."""

from __future__ import annotations

import json

import numpy as np
import pytest

from armtrue import _core
from armtrue.tables import Reference, Surroundings, fitted_arm, layout
from armtrue.tables.conftest import document
from armtrue.tables.reference import Standing, coordinates_moved

TERMS = [
    ("motor1", "1", 2e-3), ("motor2", "tau2", 2e-6), ("motor3", "sin(3*q3)", 1e-4), ("link1.rx", "gmx1", 1e-7),
    ("link2.ty", "1", 1e-3), ("link2.rz", "dT_air", 1e-6), ("link3.ry", "cos(th3)*payload", 1e-6),
    ("base.tz", "dT", 1e-6), ("base.rx", "bmx", 1e-8), ("motor2", "u_2_3_x", 1e-6), ("motor1", "dir1", 2e-5),
    ("link1.tz", "1 - exp(-time/900)", 1e-4),
]  # fmt: skip


def state(rows: int) -> tuple[np.ndarray, Surroundings, dict[str, np.ndarray]]:
    rng = np.random.default_rng(2)
    joints = rng.uniform([-3.0, -2.0, -2.5], [3.0, 2.0, 2.5], (rows, 3))
    around = Surroundings(
        {"arm": rng.uniform(10.0, 40.0, rows), "air": rng.uniform(15.0, 30.0, rows)},
        payload=rng.uniform(0.0, 10.0, rows),
        time=rng.uniform(0.0, 1e4, rows),
        direction=rng.choice([-1.0, 1.0], (rows, 3)),
    )
    assert around.payload is not None
    assert around.time is not None
    assert around.direction is not None
    columns = {f"q{k + 1}": np.ascontiguousarray(joints[:, k]) for k in range(3)}
    columns |= {f"dir{k + 1}": np.ascontiguousarray(around.direction[:, k]) for k in range(3)}
    columns |= {f"temp_{name}": np.asarray(column) for name, column in around.temperature.items()}
    return joints, around, {**columns, "payload": around.payload, "time": around.time}


def as_deflected(reference: Reference, motor: np.ndarray, around: Surroundings) -> Standing:
    """The deflected frames at which gravity acts, as in the fitter; a device uses those of the nominal arm."""
    standing = reference.at_nominal(motor)
    for _ in range(30):
        coordinates = reference.coordinates(reference.state(motor, around, standing))
        frames, _ = reference._frames(motor, coordinates)
        end = reference._virtual_joint(coordinates, f"link{reference.chain.joint_count}", len(motor))
        point = reference.at_nominal(motor).payload
        if end is not None:
            point = np.einsum("nij,nj->ni", end[:, :3, :3], point) + end[:, :3, 3]
        still = max(np.abs(a - b).max() for a, b in zip(frames, standing.frames, strict=True))
        standing = Standing(frames, point)
        if still < 1e-13:
            break
    return standing


def test_forward_model_matches_the_fitter() -> None:
    fit = document(TERMS, coupling=[{"joint": 3, "driving": 2, "ratio": -1.0}])
    joints, around, columns = state(200)
    predicted = np.asarray(_core.predict(json.dumps(fit), columns))
    reference = Reference(fitted_arm(fit, "test"), "")
    reached = reference.real(joints, around, as_deflected(reference, joints, around))[0][:, :3, 3]
    assert np.abs(predicted - reached).max() < 1e-12


def test_forward_model_in_standard_dh_matches_the_fitter() -> None:
    fit = document(TERMS)
    fit["robot"]["kinematics"]["convention"] = "dh"
    joints, around, columns = state(200)
    predicted = np.asarray(_core.predict(json.dumps(fit), columns))
    reference = Reference(fitted_arm(fit, "test"), "")
    reached = reference.real(joints, around, as_deflected(reference, joints, around))[0][:, :3, 3]
    assert np.abs(predicted - reached).max() < 1e-12


def test_forward_model_with_loads_at_command_matches_the_fitter() -> None:
    fit = document(TERMS) | {"statics": "nominal"}
    joints, around, columns = state(200)
    predicted = np.asarray(_core.predict(json.dumps(fit), columns))
    reference = Reference(fitted_arm(fit, "test"), "")
    reached = reference.real(joints, around)[0][:, :3, 3]
    assert np.abs(predicted - reached).max() < 1e-12


def test_inverse_reaches_the_nominal_point() -> None:
    reference = Reference(fitted_arm(document(TERMS), "test"), "")
    joints, around, _ = state(500)
    nominal = reference.nominal(joints)[:, :3, 3]
    corrected = reference.solve(joints, around).joints
    reached, jacobian = reference.real(corrected, around, reference.at_nominal(joints))
    regular = np.linalg.svd(jacobian[:, :3], compute_uv=False)[:, 2] > 0.05
    assert regular.mean() > 0.5
    assert np.linalg.norm(reached[regular, :3, 3] - nominal[regular], axis=1).max() < 1e-10


def test_inverse_with_loads_at_command_matches_the_fitter() -> None:
    """The springs yield by milliradians: loads at the target would differ by 1 %."""
    fit = document([("motor2", "tau2", 1e-4), ("motor3", "tau3", 2e-4)]) | {"statics": "nominal"}
    reference = Reference(fitted_arm(fit, "test"), "")
    joints, around, columns = state(300)
    nominal = reference.nominal(joints)[:, :3, 3]
    corrected = reference.solve(joints, around).joints
    columns |= {f"q{k + 1}": np.ascontiguousarray(corrected[:, k]) for k in range(3)}
    reached = np.asarray(_core.predict(json.dumps(fit), columns))
    jacobian = reference.real(corrected, around)[1]
    regular = np.linalg.svd(jacobian[:, :3], compute_uv=False)[:, 2] > 0.05
    assert np.linalg.norm(reached[regular] - nominal[regular], axis=1).max() < 1e-10


def test_loads_of_the_nominal_arm_leave_under_a_thousandth_of_sag() -> None:
    fit = document([("motor2", "tau2", 1e-5), ("motor3", "tau3", 2e-5), ("link2.rx", "gmx2", 5e-6)])
    reference = Reference(fitted_arm(fit, "test"), "")
    joints, around, columns = state(300)
    nominal = reference.nominal(joints)[:, :3, 3]
    corrected = reference.solve(joints, around).joints
    columns |= {f"q{k + 1}": np.ascontiguousarray(corrected[:, k]) for k in range(3)}
    off = np.asarray(_core.predict(json.dumps(fit), columns)) - nominal
    sag = reference.real(joints, around)[0][:, :3, 3] - nominal
    regular = np.linalg.svd(reference.real(joints, around)[1][:, :3], compute_uv=False)[:, 2] > 0.05
    assert np.linalg.norm(sag[regular], axis=1).max() > 1e-3
    assert np.linalg.norm(off[regular], axis=1).max() < 1e-3 * np.linalg.norm(sag[regular], axis=1).max()


def stretched(rows: int) -> tuple[np.ndarray, Surroundings]:
    """The 5 % of random poses that are nearest to a singularity: elbow stretched or tool above the first axis."""
    joints = np.random.default_rng(4).uniform([-3.0, -2.0, -2.5], [3.0, 2.0, 2.5], (20 * rows, 3))
    reference = Reference(fitted_arm(document([]), "test"), "")
    jacobian = reference.real(joints, Surroundings({}))[1]
    nearest = np.argsort(np.linalg.svd(jacobian[:, :3], compute_uv=False)[:, 2])[:rows]
    return joints[nearest], Surroundings({})


SHORTER = [("link2.tx", "1", -3e-3), ("link3.ty", "1", 2e-3), ("motor2", "1", 2e-3)]


@pytest.mark.parametrize("rotation_length_m", [None, 0.25])
@pytest.mark.parametrize("statics", ["deflected", "nominal"])
def test_inverse_near_singularities_is_bounded_and_never_worse(
    rotation_length_m: float | None, statics: str
) -> None:
    fit = document([*SHORTER, ("motor3", "tau3", 2e-5)]) | {"statics": statics}
    reference = Reference(fitted_arm(fit, "test"), "")
    joints, around = stretched(300)
    corrected = reference.solve(joints, around, rotation_length_m).joints
    assert np.abs(corrected - joints).max() < 2.0 * np.pi * layout.MAX_DELTA[False] + 0.01
    wanted = reference.nominal(joints)

    def off(at: np.ndarray) -> np.ndarray:
        loads = reference.at_nominal(at if statics == "nominal" else joints)
        reached = reference.real(at, around, loads)[0]
        away = np.linalg.norm(reached[:, :3, 3] - wanted[:, :3, 3], axis=1)
        if rotation_length_m is None:
            return away
        between = wanted[:, :3, :3] @ np.swapaxes(reached[:, :3, :3], 1, 2)
        skew = 0.5 * (between - np.swapaxes(between, 1, 2))
        turn = np.linalg.norm([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=0)
        return np.hypot(away, rotation_length_m * turn)

    assert (off(corrected) <= off(joints) + 1e-12).all()


def test_inverse_reports_the_remaining_error_of_each_pose() -> None:
    reference = Reference(fitted_arm(document(SHORTER), "test"), "")
    joints, around = stretched(300)
    found = reference.solve(joints, around)
    reached = reference.real(found.joints, around, reference.at_nominal(joints))[0]
    left = np.linalg.norm(reached[:, :3, 3] - reference.nominal(joints)[:, :3, 3], axis=1)
    assert np.abs(found.position_m - left).max() < 1e-12
    assert 1e-4 < left.max() < 5e-3
    assert np.array_equal(left <= 1e-7, found.is_reached)
    assert 0.1 < found.is_reached.mean() < 0.9


@pytest.mark.parametrize(("rotation_length_m", "moved"), [(None, 3), (0.25, 3)])
def test_three_axes_move_three_coordinates(rotation_length_m: float | None, moved: int) -> None:
    arm = fitted_arm(document([]), "test")
    tool = arm.chain.end @ arm.flange_from_tool[""]
    assert coordinates_moved(arm.chain, tool, rotation_length_m) == moved


def test_jacobian_matches_finite_differences() -> None:
    reference = Reference(fitted_arm(document([]), "test"), "")
    joints, around, _ = state(20)
    pose, jacobian = reference.real(joints, around)
    for k in range(3):
        moved = joints.copy()
        moved[:, k] += 1e-6
        step = (reference.real(moved, around)[0][:, :3, 3] - pose[:, :3, 3]) / 1e-6
        assert np.abs(step - jacobian[:, :3, k]).max() < 2e-6
