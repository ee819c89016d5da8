"""The real UR10: what the fit reaches on poses that it has not seen. `./dev ur10` prints the whole table."""

from __future__ import annotations

import armtrue
import pytest
from ur10 import GEOMETRY, MEASUREMENTS, SPRINGS, TABLES, Split, error_mm, model_of, rms, robot, splits

pytestmark = pytest.mark.skipif(
    not MEASUREMENTS.is_dir(), reason=f"no UR10 measurements at {MEASUREMENTS} (not part of this repository)"
)


@pytest.fixture(scope="module")
def cut() -> dict[str, Split]:
    return splits()


def held_out_rms_mm(split: Split, effects: list) -> float:
    arm = robot()
    return rms(error_mm(armtrue.fit(split.train, arm, model_of(effects, arm)), split.held_out))


def test_series_c_geometry(cut):
    assert held_out_rms_mm(cut["C, random 30 %"], GEOMETRY) <= 0.51


def test_series_c_tables(cut):
    assert held_out_rms_mm(cut["C, random 30 %"], TABLES) <= 0.10


def test_series_a_later_than_what_was_fitted(cut):
    assert held_out_rms_mm(cut["A, last 30 % of the time"], SPRINGS) <= 0.105


def test_diagnosis_of_geometry_alone_names_the_mid_frequency_joint_error(cut):
    arm = robot()
    result = armtrue.diagnose(armtrue.fit(cut["C, random 30 %"].train, arm, model_of(GEOMETRY, arm)))
    best = result["candidates"][0]
    assert result["verdict"] == "missing_effect"
    assert best["effect"] == "transmission_pwl"
    assert best["recommend"]
    assert any("cycles a turn" in sentence for sentence in result["advice"])
