"""A simulated campaign as columns, files of any columns, and the result of init on them, run in this process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from armtrue.foreign import init
from armtrue.io import Dataset, load_data, load_robot
from armtrue.tables.chain import chain_from_robot, pose

JOINTS = [f"q{k}" for k in range(1, 7)]


@dataclass
class Campaign:
    """`joints` [rad], `points` [m] as a tracker measured them; `own` (N, 4, 4): the tool's pose in the robot's base
    as the arm's controller computes it, by nominal kinematics.
    """

    robot: Path
    joints: np.ndarray
    points: np.ndarray
    own: np.ndarray

    def joint_columns(self, digits: int = 10) -> dict[str, Sequence[Any]]:
        """J1 … J6 in degrees."""
        return {f"J{k}": np.round(np.degrees(column), digits) for k, column in enumerate(self.joints.T, 1)}

    def in_base(self) -> np.ndarray:
        """The points in the frame of the robot's base, into which trackers are often aligned."""
        base = pose(load_robot(self.robot).spec["base"])
        return (self.points - base[:3, 3]) @ base[:3, :3]


def campaign_of(rows: list[dict[str, str]], robot: Path) -> Campaign:
    """The rows of a simulated data.csv."""
    joints = np.array([[float(row[name]) for name in JOINTS] for row in rows])
    points = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
    spec = load_robot(robot).spec
    return Campaign(robot, joints, points, chain_from_robot(spec).tool_poses(joints, pose(spec["tool"])))


def named(names: Sequence[str], table: np.ndarray) -> dict[str, Sequence[Any]]:
    """The columns of `table` under `names`."""
    return dict(zip(names, np.asarray(table).T, strict=True))


def write(path: Path, columns: dict[str, Sequence[Any]]) -> Path:
    """A CSV of `columns`."""
    lines = [",".join(columns)]
    lines += [",".join(map(str, cells)) for cells in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return path


@dataclass
class Read:
    """The notes of init in one line, its findings, the dataset.yaml it wrote, and the measurements read by that."""

    said: str
    findings: list[Any]
    dataset: dict[str, Any]
    data: Dataset


def read(campaign: Campaign, where: Path, *files: Path, **options: Any) -> Read:
    """Run init on `files`, and read the measurements that it describes."""
    guessed = init(list(files), where / "arm", robot=campaign.robot, **options)
    dataset = yaml.safe_load((where / "arm" / "dataset.yaml").read_text())
    arm = load_robot(where / "arm" / "robot.yaml")
    data = load_data(where / "arm" / "dataset.yaml", arm, strict=False)
    return Read(" · ".join(guessed.notes), guessed.findings, dataset, data)
