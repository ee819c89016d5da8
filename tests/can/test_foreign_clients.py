"""Third-party clients: can-utils, and zencan-client from crates.io (in Rust).

PyPI canopen is in test_sdo.py, on all targets in suite_foreign.py, and, with its CiA 402 profile, in sim/armtrue_loop.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import canopen
import pytest
from node_process import NODE_ID, ROOT, NodeProcess
from small_table import small_table

ZENCAN = ROOT / "build" / "zencan" / "debug" / "zencan-check"


def zencan_check(*arguments: str, timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Run the Rust client; a test fails where it has not been built."""
    assert ZENCAN.exists(), (
        "zencan-check is not built: ./dev test zencan does it (tools/test.d/30-zencan.full.sh)"
    )
    environment = os.environ | {"RUST_BACKTRACE": "1"}
    return subprocess.run(
        [str(ZENCAN), *arguments],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        env=environment,
        check=False,
    )


def run(*words: str, timeout_s: float = 60.0) -> str:
    assert shutil.which(words[0]), f"{words[0]} is not installed (Debian's can-utils)"
    return subprocess.run(words, capture_output=True, text=True, timeout=timeout_s, check=True).stdout


@contextlib.contextmanager
def candump(*arguments: str, hears: Sequence[int]) -> Iterator[subprocess.Popen[str]]:
    """A candump that listens already: the kernel's receiver lists have the identifiers that it filters for."""
    with subprocess.Popen(["candump", "-L", *arguments], stdout=subprocess.PIPE, text=True) as process:
        try:
            give_up = time.monotonic() + 30.0
            while not all(any(is_heard(identifier)) for identifier in hears):
                assert time.monotonic() < give_up, "candump does not listen"
                time.sleep(0.01)
            yield process
        finally:
            process.kill()


def is_heard(identifier: int) -> Iterator[bool]:
    """Whether a receiver of exactly this identifier is registered, list by list."""
    for listing in Path("/proc/net/can").glob("rcvlist_*"):
        yield f" {identifier:x} " in listing.read_text().lower()


def test_cansend_and_candump_see_an_sdo_answer(running_node: NodeProcess) -> None:
    with candump("-n", "1", "vcan0,5A0:7FF", hears=[0x5A0]) as dump:
        run("cansend", "vcan0", "620#4000100000000000")
        out = dump.communicate(timeout=60.0)[0]
    assert out.split()[-1] == "5A0#430010009201FFFF"


def test_canplayer_replays_a_session(running_node: NodeProcess, tmp_path: Path) -> None:
    log = tmp_path / "session.log"
    requests = ["620#2B17100064000000", "000#0120", "620#4017100000000000"]
    log.write_text("".join(f"({k}.000000) vcan0 {frame}\n" for k, frame in enumerate(requests, 1)))
    with candump("-n", "10", "vcan0,5A0:7FF,720:7FF", hears=[0x5A0, 0x720]) as dump:
        run("canplayer", "-t", "-I", str(log))
        frames = [line.split()[-1] for line in dump.communicate(timeout=60.0)[0].splitlines()]
    assert "5A0#6017100000000000" in frames
    assert "5A0#4B17100064000000" in frames
    assert frames[-1] == "720#05", "operational, and says so every 100 ms"


def test_no_sdo_answer_is_lost_on_a_bus_flooded_by_cangen(
    running_node: NodeProcess, remote: canopen.RemoteNode
) -> None:
    image = small_table(padding=4000)
    # The device receives all frames; a Python client that did so would be slower than they come.
    remote.network.bus.set_filters([{"can_id": 0x580 + NODE_ID, "can_mask": 0x7FF, "extended": False}])
    with subprocess.Popen(["cangen", "vcan0", "-g", "0.3", "-I", "100", "-L", "8", "-i"]) as flood:
        try:
            for _ in range(50):
                assert remote.sdo.upload(0x1000, 0)
            remote.sdo.download(0x2010, 0, image)
            assert remote.sdo.upload(0x2010, 0) == image
        finally:
            flood.kill()


@pytest.mark.full
def test_zencan_client_passes_its_whole_check(running_node: NodeProcess, tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    tables.write_bytes(small_table(sequence=7, padding=2000))
    done = zencan_check("vcan0", str(NODE_ID), str(tables), timeout_s=120.0)
    assert done.returncode == 0, done.stderr


@pytest.mark.full
@pytest.mark.parametrize("arguments", [[], ["vcan0", "many", "x"]])
def test_zencan_check_with_wrong_arguments_names_expected_ones(arguments: list[str]) -> None:
    done = zencan_check(*arguments, timeout_s=60.0)
    assert done.returncode == 2
    assert "NODE" in done.stderr
