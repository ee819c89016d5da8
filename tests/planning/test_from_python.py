"""Planning the next poses from Python."""

from __future__ import annotations

import armtrue
import armtrue_sim
import numpy as np
import pytest
from armtrue import Fit, InputError, Model, fit, load_data, load_model, load_robot, plan, plan_campaign
from armtrue.planning import Plan


@pytest.fixture(scope="module")
def believed(tmp_path_factory) -> Fit:
    """A fit to few poses of an arm whose model is complete."""
    folder = tmp_path_factory.mktemp("poses")
    armtrue_sim.simulate({"arm": "kr30", "seed": 5, "poses": 60, "hidden": []}).write(folder)
    robot = load_robot(folder / "robot.yaml")
    return fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))


def test_plan_without_ambiguity_serves_the_parameters(believed):
    made = plan(believed, 5, candidates=300)
    assert not made.separates
    assert made.count == 5
    for number, joint in enumerate(believed.robot.joints, start=1):
        low, high = joint["limits"]
        assert np.all((made.columns[f"q{number}"] >= low) & (made.columns[f"q{number}"] <= high))


def test_plan_separates_the_named_rivals(believed):
    rivals = [{"effect": "gear_harmonics", "joints": [2]}, {"effect": "joint_scale", "joints": [2]}]
    made = plan(believed, 5, rivals=rivals, candidates=300)
    assert made.separates
    assert {entry["truth"] for entry in made.figures["separations"]} == {"gear_harmonics 2", "joint_scale 2"}


def test_plan_with_one_rival_is_refused(believed):
    with pytest.raises(InputError):
        plan(believed, 5, rivals=[{"effect": "gear_harmonics", "joints": [2]}], candidates=300)


@pytest.mark.parametrize("first_campaign", [False, True])
def test_stated_number_of_random_poses_gives_equal_precision(believed, first_campaign):
    model = Model(believed.document["model"]["effects"])
    levels = {"payload": [0.0, 8.0], "temp_arm": [20.0, 30.0]}

    def made(poses: int) -> Plan:
        if first_campaign:
            return plan_campaign(believed.robot, model, poses, candidates=600, levels=levels)
        return plan(believed, poses, rivals=[], candidates=600)

    planned = made(20)
    information = planned.figures["information"]
    as_good = round(20 * planned.figures["random_poses_per_planned"])
    assert planned.precision() == f"20 planned poses give the precision of {as_good} random ones."
    random = made(as_good).figures["information"]["random"]["prediction_rms_um"]
    assert random == pytest.approx(information["planned"]["prediction_rms_um"], rel=0.05)


def test_names_exported_by_armtrue_have_docstrings():
    for name in armtrue.__all__:
        assert getattr(armtrue, name).__doc__
    assert plan_campaign.__module__ == "armtrue.planning"
