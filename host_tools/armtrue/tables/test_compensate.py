"""What `compensate` says of poses that do not reach their target."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armtrue.tables import ExportOptions, export, fitted_arm
from armtrue.tables.compensate import Compensated, Engine, compensate, sidecar
from armtrue.tables.conftest import document

SHORTER = [("link2.tx", "1", -3e-3), ("motor2", "1", 2e-3)]


def compensated(
    folder: Path, fit: dict[str, Any], joints: np.ndarray, engine: Engine, **options: Any
) -> Compensated:
    """`joints` corrected by the table of `fit`."""
    fit["robot"]["temperature"] = {}
    tables, poses = folder / "t.bin", folder / "poses.csv"
    tables.write_bytes(export(fitted_arm(fit, "fit"), ExportOptions(**options)).image)
    sidecar(tables).write_text(json.dumps(fit))
    names = ",".join(f"q{k + 1}" for k in range(joints.shape[1]))
    np.savetxt(poses, joints, delimiter=",", header=names, comments="")
    return compensate(tables, poses, engine)


@pytest.mark.parametrize("engine", list(Engine))
def test_arm_of_two_axes_is_said_to_have_too_few(tmp_path: Path, engine: Engine) -> None:
    fit = document([("link2.tx", "1", -3e-3)])
    fit["robot"]["kinematics"]["joints"].pop()
    fit["robot"]["links"] = []
    joints = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 2))
    (note,) = compensated(tmp_path, fit, joints, engine).notes
    assert note.startswith("20 of 20 poses ")
    assert note.endswith("the arm's 2 axes set only 2 of the 3 coordinates of the tool's position")


@pytest.mark.parametrize("engine", list(Engine))
def test_three_axes_are_said_to_hold_no_attitude(tmp_path: Path, engine: Engine) -> None:
    joints = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
    (note,) = compensated(tmp_path, document(SHORTER), joints, engine, full_pose=True).notes
    assert note.endswith(
        "the arm's 3 axes set only 3 of the 6 coordinates of the tool's position and attitude"
    )


def test_double_engine_counts_poses_that_it_leaves_off_their_target(tmp_path: Path) -> None:
    """The elbow stretched: the arm is 3 mm too short for the point."""
    joints = np.zeros((5, 3))
    joints[:, 2] = [1.0, -0.322, -0.321, -0.320, -1.0]
    result = compensated(tmp_path, document(SHORTER), joints, Engine.DOUBLE)
    (note,) = result.notes
    assert note.startswith("3 of 5 poses do not reach their target, up to ")
    assert note.endswith(" are left: they are close to a singularity or at the end of the reach")
    assert np.abs(result.joints - joints).max() < 0.32


def test_double_engine_says_nothing_where_every_target_is_reached(tmp_path: Path) -> None:
    joints = np.array([[0.1, 0.2, 1.0], [0.5, -0.2, 1.2]])
    assert compensated(tmp_path, document(SHORTER), joints, Engine.DOUBLE).notes == []
