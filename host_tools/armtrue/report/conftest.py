"""One simulated calibration, refined, for all tests of the report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import armtrue_sim
import pytest

from armtrue import Fit, fit, load_data, load_model, load_robot, refine
from armtrue.report import Report, gather


def fitted(folder: Path, scenario: dict[str, Any]) -> Fit:
    """The believed model fitted to a simulated campaign, saved in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    armtrue_sim.simulate(scenario).write(folder)
    robot = load_robot(folder / "robot.yaml")
    made = fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))
    made.save(folder / "believed.json")
    return made


@pytest.fixture(scope="session")
def fits(tmp_path_factory: pytest.TempPathFactory) -> list[Fit]:
    """An arm with an eccentric gear and lost motion that its model lacks, and three gross errors; then refined."""
    folder = tmp_path_factory.mktemp("report")
    scenario = {
        "arm": "kr30",
        "seed": 2,
        "hidden": [
            {"effect": "gear_harmonics", "joints": [3], "scale": 2.5},
            {"effect": "backlash", "joints": [2]},
        ],
        "gross_errors": {"count": 3, "size": [0.002, 0.004]},
    }
    believed = fitted(folder, scenario)
    refined, _ = refine(believed)
    refined.save(folder / "refined.json")
    return [Fit.load(folder / "believed.json"), Fit.load(folder / "refined.json")]


@pytest.fixture(scope="session")
def heated(tmp_path_factory: pytest.TempPathFactory) -> Report:
    """Of an arm whose axis 2 drifts with temperature, with opposite signs on the left and right of the cell."""
    term = {"effect": "custom", "name": "heat_times_joint", "coordinate": "motor2", "joints": [1]}
    hidden = [{**term, "expression": "tanh(dT*q1/10)", "value": 1.5e-4}]
    scenario = {"arm": "kr30", "seed": 14, "hidden": hidden}
    return gather([fitted(tmp_path_factory.mktemp("heated"), scenario)])


@pytest.fixture(scope="session")
def report(fits: list[Fit]) -> Report:
    return gather(fits)
