"""How the POSIX node's program starts: what it refuses, and that its clock starts with it."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import can
import pytest
from armtrue.device import SdoClient
from node_process import NODE_ID, run_node
from socket_bus import SocketBus, node_on_sockets

pytestmark = pytest.mark.without_bus

TIME_SINCE_START = (0x2001, 13)  # ms


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    """The one sentence that the node printed as it refused its options with exit status 2."""
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    return done.stderr


@pytest.mark.parametrize("interface", ["can0", "fd:0"])
def test_one_interface_given_twice_is_refused(tmp_path: Path, interface: str) -> None:
    """The node would pass its own frames on to itself for ever."""
    buses = ["--upstream", interface, "--downstream", interface]
    said = refusal(run_node([*buses, "--state", str(tmp_path / "state")]))
    assert said == (
        f"armtrue_node: --downstream: '{interface}' is the interface of --upstream, expected another one, "
        "or no --downstream for offset mode\n"
    )
    assert not (tmp_path / "state").exists()


def test_second_node_on_one_state_folder_is_refused(tmp_path: Path) -> None:
    state = tmp_path / "state"
    with node_on_sockets(state) as (_, upstream, _downstream):
        said = refusal(run_node(["--upstream", "fd:0", "--state", str(state)]))
        assert said == (
            f"armtrue_node: {state}: in use by another armtrue_node, expected a folder of its own for each\n"
        )
        assert SdoClient(upstream, NODE_ID, 30.0).upload(0x1018, 0) == b"\4"


def test_state_folder_is_free_again_when_its_node_has_ended(tmp_path: Path) -> None:
    for _ in range(2):
        with node_on_sockets(tmp_path / "state"):
            pass


def milliseconds_since_start(upstream: SocketBus) -> int:
    return int.from_bytes(SdoClient(upstream, NODE_ID, 30.0).upload(*TIME_SINCE_START), "little")


def test_clock_starts_with_the_node_and_again_with_its_reset(tmp_path: Path) -> None:
    """As on the chips: terms in `time` (warm_up) are those of an arm that was just switched on."""
    begun = time.monotonic()
    with node_on_sockets(tmp_path / "state") as (_, upstream, _downstream):
        time.sleep(1.0)
        first = milliseconds_since_start(upstream)
        assert 900 <= first <= 1000.0 * (time.monotonic() - begun)
        reset = time.monotonic()
        upstream.send(can.Message(arbitration_id=0, data=[0x81, NODE_ID], is_extended_id=False))
        while (frame := upstream.recv(30.0)) is None or frame.arbitration_id != 0x700 + NODE_ID:
            assert frame is not None, "no boot-up message"
        assert milliseconds_since_start(upstream) <= 1000.0 * (time.monotonic() - reset)
