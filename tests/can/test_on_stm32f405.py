"""The scenario suites against the target of targets/stm32f405.toml."""

from __future__ import annotations

import pytest
import suite_conformance
from suite_conformance import *  # noqa: F403
from suite_foreign import *  # noqa: F403
from suite_motion import *  # noqa: F403
from suite_tables import *  # noqa: F403
from target import Target

TARGET = "stm32f405.toml"
pytestmark = pytest.mark.without_bus


@pytest.mark.full  # a minute and a half on the emulated chip, whose dictionary is the POSIX node's
def test_od_01_every_object_by_its_access_type(target: Target) -> None:
    suite_conformance.test_od_01_every_object_by_its_access_type(target)
