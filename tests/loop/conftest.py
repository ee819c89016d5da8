"""The loop's tests run where vcan0 and vcan1 exist; see sim/rig."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "sim"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "can" / "support"))

from rig.pytest_plugin import (
    can_buses,
    needs_can,
    pytest_collection_modifyitems,
    pytest_runtest_logreport,
    pytest_runtest_protocol,
)

__all__ = [
    "can_buses",
    "pytest_collection_modifyitems",
    "pytest_runtest_logreport",
    "pytest_runtest_protocol",
]

needs_can(__file__)
