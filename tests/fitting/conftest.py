"""Campaigns on disk, read as a person's are."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import armtrue
import numpy as np
import pytest
from armtrue.io import Dataset, Model, Robot
from armtrue_sim import simulate

GEOMETRY = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]


@dataclasses.dataclass
class Given:
    """What `armtrue fit` is given, and what it should find."""

    robot: Robot
    data: Dataset
    folder: Path
    truth: Any

    def model(self, effects: list[Any], **more: Any) -> Model:
        return Model(effects=[{"effect": e} if isinstance(e, str) else e for e in effects], **more)

    def fit(self, effects: list[Any], **more: Any) -> armtrue.Fit:
        return armtrue.fit(self.data, self.robot, self.model(effects, **more))

    def with_columns(self, **columns: np.ndarray) -> Given:
        """The same poses with other columns."""
        data = dataclasses.replace(self.data, columns={**self.data.columns, **columns})
        return dataclasses.replace(self, data=data)

    def rows(self, chosen: slice) -> Dataset:
        """Some of the measurements."""
        columns = {name: values[chosen] for name, values in self.data.columns.items()}
        return dataclasses.replace(self.data, columns=columns, rows=self.data.rows[chosen])


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
