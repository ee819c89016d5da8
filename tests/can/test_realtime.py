"""The POSIX node as a real-time process, on socket pairs instead of a CAN bus."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from armtrue.device import SdoClient
from node_process import NODE_ID, run_node
from socket_bus import node_on_sockets

pytestmark = pytest.mark.without_bus


def test_node_on_inherited_sockets_answers_at_normal_priority(tmp_path: Path) -> None:
    with node_on_sockets(tmp_path / "state") as (process, upstream, _):
        assert SdoClient(upstream, NODE_ID, 30.0).upload(0x1018, 0) == b"\4"
        assert os.sched_getscheduler(process.pid) == os.SCHED_OTHER


def may_run_in_real_time() -> bool:
    """Whether this process may give another one a priority and lock its memory: root may, others rarely."""
    return os.geteuid() == 0


def test_priority_option_sets_sched_fifo_and_locks_memory(tmp_path: Path) -> None:
    if not may_run_in_real_time():
        refused = run_node(["--upstream", "fd:0", "--state", str(tmp_path / "state"), "--priority", "42"])
        assert refused.returncode == 2
        return
    with node_on_sockets(tmp_path / "state", "--priority", "42") as (process, upstream, _):
        assert SdoClient(upstream, NODE_ID, 30.0).upload(0x1018, 0) == b"\4"
        assert os.sched_getscheduler(process.pid) == os.SCHED_FIFO
        assert os.sched_getparam(process.pid).sched_priority == 42
        status = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii")
        locked = next(line.split()[1] for line in status.splitlines() if line.startswith("VmLck"))
        assert int(locked) > 1000, "kilobytes"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--upstream", "fd:x"], "fd:x: expected fd:NUMBER"),
        (["--upstream", "fd:99"], "fd:99: expected an open socket that keeps messages apart"),
        (["--upstream", "fd:0", "--priority", "100"], "--priority: '100', expected a number from 1 to 99"),
    ],
)
def test_bad_bus_or_priority_is_refused_in_one_sentence(
    tmp_path: Path, words: list[str], sentence: str
) -> None:
    done = run_node([*words, "--state", str(tmp_path / "state")])
    assert done.returncode == 2
    assert sentence in done.stderr
    assert len(done.stderr.splitlines()) == 1
