"""The other processes of the loop: compensator node and cell, started and known to be up."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import can

from armtrue_loop.operator import Operator
from armtrue_loop.wiring import COMPENSATOR_ID, CONTROLLER_BUS, CYCLE_US, DRIVE_BUS, JOINTS

# Starting and ending a program takes this long on no machine that is worth waiting for.
START_TIMEOUT_S = 120.0
ROOT = Path(__file__).resolve().parents[2]


def node_program() -> Path:
    """The built POSIX node; ARMTRUE_BUILD names another build folder than build/release."""
    return ROOT / os.environ.get("ARMTRUE_BUILD", "build/release") / "firmware/ports/posix/armtrue_node"


class NodeUnderTest:
    """A running armtrue_node between the controller's and the drives' bus."""

    def __init__(self, state: Path, robot_serial: str, mode: str, trusted_key: Path | None = None) -> None:
        self._command = [str(node_program()), "--upstream", CONTROLLER_BUS, "--state", str(state)]
        if mode == "inline":
            self._command += ["--downstream", DRIVE_BUS]
        self._command += [
            "--robot-serial",
            robot_serial,
            "--joints",
            str(JOINTS),
            "--cycle-us",
            str(CYCLE_US),
        ]
        if trusted_key is not None:
            self._command += ["--public-key", str(trusted_key)]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start and wait for the boot-up message. Raises RuntimeError."""
        with can.Bus(interface="socketcan", channel=CONTROLLER_BUS) as bus:
            self._process = subprocess.Popen(self._command)
            give_up = time.monotonic() + START_TIMEOUT_S
            while time.monotonic() < give_up and self._process.poll() is None:
                message = bus.recv(0.2)
                if message is not None and message.arbitration_id == 0x700 + COMPENSATOR_ID:
                    return
        self.stop()
        raise RuntimeError(f"{self._command[0]} did not boot")

    @property
    def process_id(self) -> int:
        """The running process. Raises RuntimeError if there is none."""
        if self._process is None:
            raise RuntimeError("the node is not running")
        return self._process.pid

    def stop(self) -> None:
        """End it as a power cut would."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


class CellProcess:
    """A running `armtrue_loop.cell`; it ends when its operator hangs up."""

    def __init__(self, scenario: Path, folder: Path, bus: str) -> None:
        self.socket = folder / "cell.socket"
        self.truth = folder / "truth.json"
        arguments = [str(scenario), "--bus", bus, "--socket", str(self.socket), "--truth", str(self.truth)]
        paths = [str(ROOT / "sim"), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "armtrue_loop.cell", *arguments],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        )

    def operator(self) -> Operator:
        """Connect to it once it listens. Raises RuntimeError if it ended."""
        while not self.socket.exists():
            if self._process.poll() is not None:
                raise RuntimeError(f"the cell ended with status {self._process.returncode}")
            time.sleep(0.05)
        return Operator(self.socket)

    def wait(self) -> None:
        """Wait for its end. Raises RuntimeError if it failed."""
        if self._process.wait(START_TIMEOUT_S) != 0:
            raise RuntimeError(f"the cell ended with status {self._process.returncode}")

    def kill(self) -> None:
        """End it whatever it does."""
        self._process.kill()
        self._process.wait()
