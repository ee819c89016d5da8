"""Simulated campaigns, written to disk and read back as a user's files are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import armtrue
import pytest
from armtrue_sim import simulate
from fitting_given import GEOMETRY, Given


@pytest.fixture
def campaign(tmp_path: Path) -> Callable[..., Given]:
    def make(**plan: Any) -> Given:
        made = simulate(
            {"name": "campaign", "arm": "kr30", "seed": 1, "poses": 120, "believed": GEOMETRY, **plan}
        )
        made.write(tmp_path)
        robot = armtrue.load_robot(tmp_path / "robot.yaml")
        return Given(robot, armtrue.load_data(tmp_path / "data.csv", robot), tmp_path, made.truth)

    return make
