"""Simulated campaigns of arms without hidden effects; the tests add the mistakes that the checks must find."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import armtrue_sim
import pytest

from armtrue.io import Dataset, Robot, load_data, load_robot

Campaign = Callable[..., tuple[Dataset, Robot]]


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    def simulated(arm: str = "kr30", seed: int = 94, **more: object) -> tuple[Dataset, Robot]:
        armtrue_sim.simulate({"arm": arm, "seed": seed, "hidden": [], **more}).write(tmp_path)
        robot = load_robot(tmp_path / "robot.yaml")
        return load_data(tmp_path / "data.csv", robot, strict=False), robot

    return simulated
