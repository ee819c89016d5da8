"""The POSIX node as a test subject: started until it has booted, stopped, with a state folder of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import can
import canopen

ROOT = Path(__file__).resolve().parents[3]
EDS = ROOT / "firmware" / "canopen" / "od" / "armtrue.eds"
NODE_ID = 0x20


def node_program() -> Path:
    """The built node; ARMTRUE_BUILD names another build folder than build/release."""
    return ROOT / os.environ.get("ARMTRUE_BUILD", "build/release") / "firmware/ports/posix/armtrue_node"


class NodeProcess:
    """One running armtrue_node. Use as a context manager."""

    def __init__(
        self, state: Path, *options: str, upstream: str = "vcan0", downstream: str | None = None
    ) -> None:
        self.upstream = upstream
        self.command = [str(node_program()), "--upstream", upstream, "--state", str(state), *options]
        if downstream is not None:
            self.command += ["--downstream", downstream]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it and wait for its boot-up message. Raises RuntimeError with its output if it does not boot."""
        # Receive only that message: a full socket would drop it.
        wanted = [{"can_id": 0x700 + NODE_ID, "can_mask": 0x7FF, "extended": False}]
        with can.Bus(interface="socketcan", channel=self.upstream, can_filters=wanted) as bus:
            self._process = subprocess.Popen(self.command, stderr=subprocess.PIPE)
            deadline = time.monotonic() + 60.0
            while time.monotonic() < deadline:
                message = bus.recv(0.2)
                if (
                    message is not None
                    and message.arbitration_id == 0x700 + NODE_ID
                    and bytes(message.data) == b"\0"
                ):
                    return
                if self._process.poll() is not None:
                    break
        words = self.stop()
        raise RuntimeError(f"armtrue_node did not boot: {words}")

    def stop(self, how: signal.Signals = signal.SIGTERM) -> str:
        """End it; returns what it wrote to stderr."""
        if self._process is None:
            return ""
        self._process.send_signal(how)
        words = self._process.communicate(timeout=60.0)[1].decode()
        self._process = None
        return words

    def __enter__(self) -> NodeProcess:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop(signal.SIGKILL)


def connect(channel: str = "vcan0", node_id: int = NODE_ID, eds: Path = EDS) -> canopen.RemoteNode:
    """A PyPI canopen RemoteNode on its own network; close with `disconnect`."""
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05  # how long disconnect() waits for its thread
    network.connect(interface="socketcan", channel=channel)
    node = network.add_node(node_id, str(eds))
    node.sdo.RESPONSE_TIMEOUT = 30.0
    return node


def disconnect(node: canopen.RemoteNode) -> None:
    """Close the network of `connect`."""
    node.network.disconnect()


def run_node(options: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run the program with a command line that is expected to end by itself."""
    return subprocess.run(
        [str(node_program()), *options], capture_output=True, text=True, timeout=60.0, check=False
    )
