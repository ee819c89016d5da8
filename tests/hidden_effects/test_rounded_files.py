"""Files with rounded figures or with every row twice, of arms whose model is complete."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from armtrue import diagnose, fit, load_data, load_model, load_robot
from armtrue_sim import simulate

Row = dict[str, str]


def diagnosed(folder: Path, edit: Callable[[list[Row]], list[Row]], sigma_m: float = 1e-5) -> dict[str, Any]:
    simulate(
        {"arm": "kr30", "seed": 71, "poses": 200, "test_poses": 0, "instrument": {"sigma": sigma_m}}, folder
    )
    path = folder / "data.csv"
    header, *lines = path.read_text().splitlines()
    names = header.split(",")
    rows = edit([dict(zip(names, line.split(","), strict=True)) for line in lines])
    path.write_text("\n".join([",".join(rows[0]), *(",".join(row.values()) for row in rows)]) + "\n")
    robot = load_robot(folder / "robot.yaml")
    found: dict[str, Any] = diagnose(
        fit(load_data(path, robot), robot, load_model(folder / "model.yaml", robot))
    )
    return found


def rounded(columns: str, to: Callable[[float], float]) -> Callable[[list[Row]], list[Row]]:
    names = columns.split()
    return lambda rows: [row | {name: str(to(float(row[name]))) for name in names} for row in rows]


def hundredth_of_a_degree(angle_rad: float) -> float:
    return math.radians(round(math.degrees(angle_rad), 2))


def test_rounded_angles_are_reported_as_noise_not_structure(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, rounded("q1 q2 q3 q4 q5 q6", hundredth_of_a_degree))
    assert found["verdict"] == "nothing_missing"
    assert any("joint angles in steps of 0.01 deg" in sentence for sentence in found["advice"])
    # Rounding to 0.01 degrees has a standard deviation of 0.01 / sqrt(12) degrees.
    assert found["noise"]["joints_urad"][:3] == pytest.approx([50.4] * 3, rel=0.1)
    assert found["noise"]["reading_um"] == pytest.approx(10.0, rel=0.1)


def test_rounded_positions_do_not_give_a_zero_noise_floor(tmp_path: Path) -> None:
    # Repeats that are rounded alike agree to the last digit.
    found = diagnosed(tmp_path, rounded("x y z", lambda value_m: round(value_m, 4)), 4e-6)
    assert found["verdict"] == "nothing_missing"
    assert found["noise_floor_um"] == pytest.approx(1.6 * 100.0 / math.sqrt(12.0), rel=0.1)
    assert found["advice"][0] == "nothing to add: what is left is noise as far as these data can tell"


@pytest.mark.parametrize("without", [pytest.param([], marks=pytest.mark.full), ["time", "repeat"]])
def test_duplicated_rows_count_once(without: list[str], tmp_path: Path) -> None:
    def twice(rows: list[Row]) -> list[Row]:
        return [{name: row[name] for name in row if name not in without} for row in rows] * 2

    found = diagnosed(tmp_path, twice)
    assert found["verdict"] == "nothing_missing"
    assert found["noise"]["reading_um"] == pytest.approx(10.0, rel=0.1)
