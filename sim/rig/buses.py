"""Which CAN interfaces exist here, and making them where we may."""

from __future__ import annotations

import os
import socket
import subprocess
from pathlib import Path

BUSES = ("vcan0", "vcan1")
FD_MTU = 72


class CanUnavailableError(RuntimeError):
    """No CAN bus can be had on this machine; the message says what was tried and what would help."""


def has_native_can() -> bool:
    """Whether this kernel knows AF_CAN at all (many build machines' kernels do not)."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def _is_up(bus: str) -> bool:
    flags = Path("/sys/class/net") / bus / "flags"
    return flags.exists() and int(flags.read_text(), 16) & 1 == 1


def ensure_buses(buses: tuple[str, ...] = BUSES) -> None:
    """Bring the virtual buses up, creating those that are absent (needs CAP_NET_ADMIN then).

    Raises CanUnavailableError, naming the interface and the command that failed.
    """
    for bus in buses:
        if _is_up(bus):
            continue
        commands = [["ip", "link", "set", bus, "mtu", str(FD_MTU)], ["ip", "link", "set", bus, "up"]]
        if not (Path("/sys/class/net") / bus).exists():
            commands.insert(0, ["ip", "link", "add", "dev", bus, "type", "vcan"])
        if os.geteuid() != 0:
            commands = [["sudo", "-n", *command] for command in commands]
        for command in commands:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise CanUnavailableError(
                    f"{bus}: `{' '.join(command)}` failed: {done.stderr.strip() or done.returncode}; "
                    f"create it by hand or run as root"
                )
