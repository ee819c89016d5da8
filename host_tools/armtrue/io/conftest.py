"""Robot files for the tests of the readers."""

from __future__ import annotations

from pathlib import Path

import pytest

from armtrue.io import Robot, load_robot

TWO_JOINTS = """\
name: two
kinematics:
  convention: mdh
  joints:
  - {name: A1, a: 0.0, alpha: 0.0, d: 0.4, limits: [-3.0, 3.0], gear_ratio: 100}
  - {name: A2, a: 0.1, alpha: -1.5707963, d: 0.0, limits: [-2.0, 2.0]}
temperature: {reference: 20.0, sensors: [arm]}
"""

# A linkage keeps the flange level: its joint turns by minus the sum of the two joints before it.
LEVEL = """\
name: level
kinematics:
  convention: mdh
  joints:
  - {name: A1, a: 0.0, alpha: -1.5707963, d: 0.4, limits: [-1.0, 1.0]}
  - {name: A2, a: 1.0, alpha: 0.0, d: 0.0, limits: [-1.0, 1.0]}
  - {name: A3, a: 1.0, alpha: 0.0, d: 0.0, passive: true}
coupling: [{joint: 3, driving: 1, ratio: -1}, {joint: 3, driving: 2, ratio: -1}]
"""


@pytest.fixture
def level(tmp_path: Path) -> Robot:
    path = tmp_path / "level.yaml"
    path.write_text(LEVEL)
    return load_robot(path)


@pytest.fixture
def two_joints(tmp_path: Path) -> Robot:
    path = tmp_path / "robot.yaml"
    path.write_text(TWO_JOINTS)
    return load_robot(path)
