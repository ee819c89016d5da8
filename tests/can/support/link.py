"""A bus that goes away: its network interface is down for the length of a block."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def down(interface: str) -> Iterator[None]:
    """Set it down for the block and up again in any case: later tests use the same bus."""
    link = [*([] if os.geteuid() == 0 else ["sudo", "-n"]), "ip", "link", "set", interface]
    subprocess.run([*link, "down"], check=True)
    try:
        yield
    finally:
        subprocess.run([*link, "up"], check=True)
