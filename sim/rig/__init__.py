"""A CAN bus on any machine: the kernel's own where it has AF_CAN, a User-Mode Linux otherwise.

`python -m rig -- COMMAND…` runs a command where vcan0 and vcan1 exist and exits with its status.
`rig.pytest_plugin` does the same for a folder of tests. A machine where neither way works is an
error, never a skip.
"""

from rig.buses import CanUnavailableError, has_native_can
from rig.run import run_on_bus

__all__ = ["CanUnavailableError", "has_native_can", "run_on_bus"]
