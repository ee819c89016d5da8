"""Input of `armtrue fit` in these tests, and the truth that it should find."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import armtrue
import numpy as np
from armtrue.io import Dataset, Model, Robot

GEOMETRY = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]


@dataclasses.dataclass
class Given:
    """Input of `armtrue fit`, and the truth that it should find."""

    robot: Robot
    data: Dataset
    folder: Path
    truth: Any

    def model(self, effects: list[Any], **more: Any) -> Model:
        """A model of these effects; `more` as Model takes it."""
        return Model(effects=[{"effect": e} if isinstance(e, str) else e for e in effects], **more)

    def fit(self, effects: list[Any], **more: Any) -> armtrue.Fit:
        """The fit of these effects."""
        return armtrue.fit(self.data, self.robot, self.model(effects, **more))

    def with_columns(self, **columns: np.ndarray) -> Given:
        """The same poses with other columns."""
        data = dataclasses.replace(self.data, columns={**self.data.columns, **columns})
        return dataclasses.replace(self, data=data)

    def rows(self, chosen: slice) -> Dataset:
        """Some of the measurements."""
        columns = {name: values[chosen] for name, values in self.data.columns.items()}
        return dataclasses.replace(self.data, columns=columns, rows=self.data.rows[chosen])
