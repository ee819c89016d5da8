"""A report of a simulated calibration, and a browser to read it with."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import armtrue_sim
import pytest
from armtrue import Fit, fit, load_data, load_model, load_robot, refine
from armtrue.report import write
from browser import Browser

SCENARIO = {
    "arm": "kr30",
    "seed": 2,
    "hidden": [
        {"effect": "gear_harmonics", "joints": [3], "scale": 2.5},
        {"effect": "backlash", "joints": [2]},
    ],
    "gross_errors": {"count": 3, "size": [0.002, 0.004]},
}


@pytest.fixture(scope="session")
def fits(tmp_path_factory: pytest.TempPathFactory) -> list[Fit]:
    folder = tmp_path_factory.mktemp("page")
    armtrue_sim.simulate(SCENARIO).write(folder)
    robot = load_robot(folder / "robot.yaml")
    data = load_data(folder / "data.csv", robot)
    believed = fit(data, robot, load_model(folder / "model.yaml", robot))
    believed.save(folder / "believed.json")
    refined, _ = refine(believed)
    refined.save(folder / "refined.json")
    return [believed, refined]


@pytest.fixture(scope="session")
def page(fits: list[Fit], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("html") / "report.html"
    write(fits, path)
    return path


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    opened = Browser()
    yield opened
    opened.close()
