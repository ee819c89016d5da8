"""The scenario suites against the target of targets/stm32f405.toml."""

from __future__ import annotations

import pytest
from suite_conformance import *  # noqa: F403
from suite_foreign import *  # noqa: F403
from suite_motion import *  # noqa: F403
from suite_tables import *  # noqa: F403

TARGET = "stm32f405.toml"
pytestmark = pytest.mark.without_bus
