"""Rows of several reflectors that share one measured orientation: it is one reading, not one for each row.

Copies agree exactly with each other, so all scatter of the orientations seemed to be that of the joints: readings were
said to scatter by 12 mm, or the hidden effect was not named.
"""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from armtrue import diagnose, fit, load_data, load_model, load_robot
from armtrue_sim import simulate

QUATERNION = ("qw", "qx", "qy", "qz")


def copy_orientations(path: Path, joints: int) -> None:
    """Give each row of a data file the orientation of the first row with the same joints and repeat."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    first: dict[tuple[str, ...], dict[str, str]] = {}
    for row in rows:
        pose = (*(row[f"q{k}"] for k in range(1, joints + 1)), row["repeat"])
        read = first.setdefault(pose, row)
        row.update({name: read[name] for name in QUATERNION})
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


@pytest.mark.parametrize(("noise_rad", "least_probability"), [(2e-5, 0.9), (0.0, 0.5)])
def test_hidden_wave_and_noise_are_found_as_with_one_reflector(
    noise_rad: float, least_probability: float, tmp_path: Path
) -> None:
    simulate(
        {
            "arm": "rail",
            "seed": 3,
            "poses": 150,
            "instrument": {"sigma": 8.0e-6, "orientation": noise_rad},
            "columns": {"add": ["orientation"]},
            "targets": {"names": ["A", "B"]},
            "hidden": [{"effect": "gear_mesh", "joints": [1]}],
        },
        tmp_path,
    )
    robot = load_robot(tmp_path / "robot.yaml")
    copy_orientations(tmp_path / "data.csv", robot.joint_count)
    found = diagnose(
        fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot))
    )
    best = found.candidates[0]
    assert (best["effect"], best["joints"], best["recommend"]) == ("gear_mesh", [1], True)
    assert best["probability"] > least_probability
    assert found["noise"]["reading_um"] == pytest.approx(8.0, abs=1.0)
