"""A balancer whose gas warms and whose seals rub: two effects whose coefficients multiply one another."""

from __future__ import annotations

from pathlib import Path

import pytest
from armtrue import add, fit, load_data, load_model, load_robot, refine
from armtrue_sim.cases import hidden_cases


@pytest.mark.quick("kr30-33301", "irb2400-34402")
@pytest.mark.parametrize(("arm", "seed"), [("kr30", 33301), ("irb2400", 33500), ("irb2400", 34402)])
def test_state_of_the_balancer_corrects_the_balancer(arm: str, seed: int, tmp_path: Path) -> None:
    # The fit kept the balancer's geometry from before, when friction hid it: 7 um remained, and the verdict was an
    # unexplained structure of q2*dir2. In the third case the structure stood for the whole balancer, which was removed
    # as superfluous before its state was tried, and 40 um remained.
    hidden_cases("later_balancer_state", arm, seed).campaign.write(tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    first = fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot))
    _best, story = refine(first)
    assert [step["added"]["effect"] for step in story["steps"] if step["added"]] == ["balancer_state"]
    assert story["steps"][-1]["verdict"] == "nothing_missing"


def test_wave_of_the_same_joint_does_not_hide_the_balancer(tmp_path: Path) -> None:
    # Beside a wave of axis 2 the fit found another balancer, and kept its friction: added, the wave raised the error
    # from 15 to 37 um.
    hidden_cases("later_balancer_state", "kr30", 33301).campaign.write(tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    state = add(
        fit(load_data(tmp_path / "data.csv", robot), robot, load_model(tmp_path / "model.yaml", robot)),
        *("balancer_state", [2]),
    )
    before, after = state.document, add(state, "gear_harmonics", [2]).document
    assert after["error"]["train"]["rms_um"] < 1.01 * before["error"]["train"]["rms_um"]
