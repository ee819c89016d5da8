"""Loads act on the deflected arm or at the commanded angles (`statics`): the data decide which."""

from __future__ import annotations

import armtrue
import armtrue_sim
import numpy as np
import pytest
from armtrue_sim.cases import hidden_cases


@pytest.mark.quick("weighed-deflected-cobot", "unknown-nominal-cobot")
@pytest.mark.parametrize("arm", ["kr30", "cobot"])
@pytest.mark.parametrize("statics", ["deflected", "nominal"])
@pytest.mark.parametrize("masses", ["weighed", "unknown"])
def test_fit_finds_whether_loads_act_on_the_deflected_arm(tmp_path, arm, statics, masses):
    campaign = armtrue_sim.simulate({"arm": arm, "seed": 5, "hidden": [], "poses": 240, "statics": statics})
    if masses == "unknown":
        campaign.robot.pop("links")
    campaign.write(tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data, test = (armtrue.load_data(tmp_path / name, robot) for name in ("data.csv", "test.csv"))
    fit = armtrue.fit(data, robot, armtrue.load_model(tmp_path / "model.yaml", robot))
    assert fit.document["statics"] == statics
    # The other `statics` adds 2 to 5 µm on these arms.
    predicted = fit.predict(test)
    assert 1e6 * np.linalg.norm(predicted - test.positions_m, axis=1).mean() < 4.0
    fit.save(tmp_path / "fit.json")
    np.testing.assert_allclose(armtrue.Fit.load(tmp_path / "fit.json").predict(test), predicted, atol=1e-12)
    assert armtrue.diagnose(fit)["verdict"] == "nothing_missing"


@pytest.mark.quick("cobot-29503")
@pytest.mark.parametrize(("arm", "seed"), [("cobot", 29503), ("cobot", 29511)])
def test_first_diagnosis_names_only_the_hidden_effects(tmp_path, arm, seed):
    # While effects were missing, the fit chose the wrong `statics`, and the diagnosis named masses or a hardening
    # spring with more than 80 % to make up for it.
    case = hidden_cases("one_hidden", arm, seed)
    case.campaign.write(tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data = armtrue.load_data(tmp_path / "data.csv", robot)
    fit = armtrue.fit(data, robot, armtrue.load_model(tmp_path / "model.yaml", robot))
    likely = [c["effect"] for c in armtrue.diagnose(fit)["candidates"] if c["probability"] > 0.5]
    assert likely == [hidden.effect for hidden in case.hidden]


@pytest.mark.parametrize(
    ("arm", "seed"),
    [("cobot", 32921), pytest.param("lbr", 32922, marks=pytest.mark.full)],
)
def test_refine_adds_nothing_to_an_arm_of_unknown_masses(tmp_path, arm, seed):
    # Loads were taken at commanded angles: couplings, scales and a balancer were named for the few micrometres, with up
    # to 100 %, and the compensated arm missed by 18 µm.
    case = hidden_cases("nothing_hidden", arm, seed)
    case.campaign.robot.pop("links")
    case.campaign.write(tmp_path)
    robot = armtrue.load_robot(tmp_path / "robot.yaml")
    data, test = (armtrue.load_data(tmp_path / name, robot) for name in ("data.csv", "test.csv"))
    fit, story = armtrue.refine(armtrue.fit(data, robot, armtrue.load_model(tmp_path / "model.yaml", robot)))
    assert [step["added"] for step in story["steps"]] == [None]
    exact = np.stack([case.campaign.test[axis] for axis in "xyz"], axis=1)
    assert 1e6 * np.linalg.norm(fit.predict(test) - exact, axis=1).mean() < 5.0
