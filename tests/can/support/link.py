"""A bus that goes away: its network interface is down for the length of a block."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def down(interface: str) -> Iterator[None]:
    """Up again after the block, whatever happened in it: the tests behind it have the same bus."""
    link = [*([] if os.geteuid() == 0 else ["sudo", "-n"]), "ip", "link", "set", interface]
    subprocess.run([*link, "down"], check=True)
    try:
        yield
    finally:
        subprocess.run([*link, "up"], check=True)
