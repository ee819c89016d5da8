"""The double-precision reference against the fitter, which shares no code with it, and its inverse against itself."""

from __future__ import annotations

import json

import numpy as np

from armtrue import _core
from armtrue.tables import Reference, Surroundings, fitted_arm
from armtrue.tables.conftest import document
from armtrue.tables.reference import Standing

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
    """Where gravity acts on the fitted arm in its deflected position, as the fitter has it; a device does not."""
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


def test_forward_model_is_the_fitters() -> None:
    fit = document(TERMS, coupling=[{"joint": 3, "driving": 2, "ratio": -1.0}])
    joints, around, columns = state(200)
    predicted = np.asarray(_core.predict(json.dumps(fit), columns))
    reference = Reference(fitted_arm(fit, "test"), "")
    reached = reference.real(joints, around, as_deflected(reference, joints, around))[0][:, :3, 3]
    assert np.abs(predicted - reached).max() < 1e-12


def test_standard_dh_is_the_fitters() -> None:
    fit = document(TERMS)
    fit["robot"]["kinematics"]["convention"] = "dh"
    joints, around, columns = state(200)
    predicted = np.asarray(_core.predict(json.dumps(fit), columns))
    reference = Reference(fitted_arm(fit, "test"), "")
    reached = reference.real(joints, around, as_deflected(reference, joints, around))[0][:, :3, 3]
    assert np.abs(predicted - reached).max() < 1e-12


def test_forward_model_with_loads_at_the_command_is_the_fitters() -> None:
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
    corrected = reference.inverse(joints, around)
    reached, jacobian = reference.real(corrected, around, reference.at_nominal(joints))
    regular = np.linalg.svd(jacobian[:, :3], compute_uv=False)[:, 2] > 0.05
    assert regular.mean() > 0.5
    assert np.linalg.norm(reached[regular, :3, 3] - nominal[regular], axis=1).max() < 1e-10


def test_inverse_of_loads_at_the_command_is_the_fitters() -> None:
    """A spring that gives way by milliradians: at the target the loads would be others by 1 %."""
    fit = document([("motor2", "tau2", 1e-4), ("motor3", "tau3", 2e-4)]) | {"statics": "nominal"}
    reference = Reference(fitted_arm(fit, "test"), "")
    joints, around, columns = state(300)
    nominal = reference.nominal(joints)[:, :3, 3]
    corrected = reference.inverse(joints, around)
    columns |= {f"q{k + 1}": np.ascontiguousarray(corrected[:, k]) for k in range(3)}
    reached = np.asarray(_core.predict(json.dumps(fit), columns))
    jacobian = reference.real(corrected, around)[1]
    regular = np.linalg.svd(jacobian[:, :3], compute_uv=False)[:, 2] > 0.05
    assert np.linalg.norm(reached[regular] - nominal[regular], axis=1).max() < 1e-10


def test_corrected_arm_carries_nearly_what_the_nominal_one_does_at_the_target() -> None:
    fit = document([("motor2", "tau2", 1e-5), ("motor3", "tau3", 2e-5), ("link2.rx", "gmx2", 5e-6)])
    reference = Reference(fitted_arm(fit, "test"), "")
    joints, around, columns = state(300)
    nominal = reference.nominal(joints)[:, :3, 3]
    corrected = reference.inverse(joints, around)
    columns |= {f"q{k + 1}": np.ascontiguousarray(corrected[:, k]) for k in range(3)}
    off = np.asarray(_core.predict(json.dumps(fit), columns)) - nominal
    sag = reference.real(joints, around)[0][:, :3, 3] - nominal
    regular = np.linalg.svd(reference.real(joints, around)[1][:, :3], compute_uv=False)[:, 2] > 0.05
    assert np.linalg.norm(sag[regular], axis=1).max() > 1e-3
    assert np.linalg.norm(off[regular], axis=1).max() < 1e-3 * np.linalg.norm(sag[regular], axis=1).max()


def test_jacobian_is_the_derivative() -> None:
    reference = Reference(fitted_arm(document([]), "test"), "")
    joints, around, _ = state(20)
    pose, jacobian = reference.real(joints, around)
    for k in range(3):
        moved = joints.copy()
        moved[:, k] += 1e-6
        step = (reference.real(moved, around)[0][:, :3, 3] - pose[:, :3, 3]) / 1e-6
        assert np.abs(step - jacobian[:, :3, k]).max() < 2e-6
