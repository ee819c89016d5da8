"""The scenario suites against the target of targets/posix.toml."""

from __future__ import annotations

from suite_conformance import *  # noqa: F403
from suite_fd import *  # noqa: F403
from suite_foreign import *  # noqa: F403
from suite_motion import *  # noqa: F403
from suite_tables import *  # noqa: F403

TARGET = "posix.toml"
