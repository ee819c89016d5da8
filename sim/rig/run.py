"""Choose where a command finds its bus, and run it there."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence

from rig.buses import ensure_buses, has_native_can
from rig.uml import run_in_uml


def run_on_bus(command: Sequence[str], timeout_s: float, environment: Mapping[str, str] | None = None) -> int:
    """Run `command` where vcan0 and vcan1 exist: natively with AF_CAN, else inside User-Mode Linux.

    Returns the command's exit status. Raises CanUnavailableError, TimeoutError.
    """
    if has_native_can():
        ensure_buses()
        merged = (
            os.environ | {"ARMTRUE_RIG": os.environ.get("ARMTRUE_RIG", "native")} | dict(environment or {})
        )
        try:
            return subprocess.run(command, env=merged, timeout=timeout_s, check=False).returncode
        except subprocess.TimeoutExpired:
            raise TimeoutError(f"`{' '.join(command)}` did not end within {timeout_s:g} s") from None
    return run_in_uml(command, timeout_s, environment)
