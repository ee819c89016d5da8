"""One campaign for all tests of a file."""

from __future__ import annotations

import csv

import armtrue_sim
import pytest
from foreign_files import Campaign, campaign_of


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    made = tmp_path_factory.mktemp("simulated")
    armtrue_sim.simulate({"arm": "kr30", "seed": 4, "poses": 80, "hidden": []}).write(made)
    with (made / "data.csv").open() as stream:
        return campaign_of(list(csv.DictReader(stream)), made / "robot.yaml")
