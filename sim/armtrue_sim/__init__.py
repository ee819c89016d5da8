"""Simulated arms with exactly known errors: one scenario gives one measurement campaign, reproducibly.

    campaign = armtrue_sim.simulate("sim/scenarios/kr30.yaml", "out/kr30")
    campaign.arm.true_position(q, {"payload": mass, "temp_arm": temperature})

The kinematics are in numpy and share no code with the fitter, so that the agreement of the two verifies both.
"""

from .arm import Arm, Term
from .campaign import Campaign, cli_simulate, measure, simulate
from .errors import ScenarioError
from .mechanics.transforms import Pose
from .poses import random_poses
from .scenario import Scenario

__all__ = [
    "Arm",
    "Campaign",
    "Pose",
    "Scenario",
    "ScenarioError",
    "Term",
    "cli_simulate",
    "measure",
    "random_poses",
    "simulate",
]
