"""Latency of the POSIX node's corrected targets, as an ordinary process and under SCHED_FIFO.

python tests/can/realtime_latency.py [--cycles N] [--busy N]

The program (armtrue_node) runs between two socket pairs: its loop, system calls and wake-ups count, a CAN controller
and its driver do not. Latency is from just before the last target frame of a set is sent to the kernel's time stamp of
the last corrected one. Prints the section of docs/results.md (`./dev bench posix`).
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import platform
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "can" / "support")]

from put_to_work import INLINE, TARGET_IDS, put_to_work  # noqa: E402
from socket_bus import SocketBus, node_on_sockets  # noqa: E402

PERIOD_S = 0.001
PRIORITY = 50
# Of this process, above the node's: it only measures, and sleeps until the next cycle.
OUR_PRIORITY = 60


def _spin() -> None:
    while True:
        pass


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """Run `count` processes that compute without end."""
    spinning = [multiprocessing.Process(target=_spin, daemon=True) for _ in range(count)]
    for process in spinning:
        process.start()
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.join()


def measured(upstream: SocketBus, downstream: SocketBus, cycles: int) -> list[float]:
    """Latency of each set in microseconds, at one set per millisecond."""
    taken = []
    due = time.clock_gettime(time.CLOCK_MONOTONIC)
    for number in range(cycles + 1):
        due = max(due + PERIOD_S, time.clock_gettime(time.CLOCK_MONOTONIC))
        time.sleep(max(0.0, due - time.clock_gettime(time.CLOCK_MONOTONIC)))
        targets = [120_000 + 30 * number * (joint + 1) for joint in range(6)]
        upstream.send(can.Message(arbitration_id=0x080, is_extended_id=False))
        for pair, identifier in enumerate(TARGET_IDS):
            data = struct.pack("<2i", *targets[2 * pair : 2 * pair + 2])
            sent = time.clock_gettime(time.CLOCK_REALTIME)
            upstream.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        if number == 0:
            continue  # nothing is sent for the first set of a stream
        while True:
            frame = downstream.recv(10.0)
            if frame is None:
                raise RuntimeError("no corrected target within 10 s")
            if frame.arbitration_id == TARGET_IDS[-1]:
                break
        taken.append(1e6 * (frame.timestamp - sent))
    return taken


def row(name: str, options: list[str], busy_count: int, cycles: int) -> str:
    """One line of the table."""
    with (
        tempfile.TemporaryDirectory() as folder,
        node_on_sockets(Path(folder) / "state", *options) as (_, upstream, downstream),
    ):
        put_to_work(upstream, INLINE, 30.0)
        with busy(busy_count):
            taken = measured(upstream, downstream, cycles)
    figures = [np.min(taken), np.median(taken), np.percentile(taken, 99.9), np.max(taken)]
    return f"| {name} | {busy_count} | " + " | ".join(f"{figure:.0f}" for figure in figures) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cycles", type=int, default=5_000)
    parser.add_argument("--busy", type=int, default=2 * (os.cpu_count() or 1))
    arguments = parser.parse_args()
    # For this process only: its own delay would count as the node's.
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(OUR_PRIORITY))
    print(
        f"{arguments.cycles} cycles of one a millisecond, six axes in three frames, inline; Linux "
        f"{platform.release()}, {os.cpu_count()} "
        f"processors of a virtual machine, other programs on it:\n"
    )
    print("| node | busy loops beside it | min [µs] | median | 99.9 % | max |")
    print("|---|---|---|---|---|---|")
    for name, options in (("ordinary", []), ("SCHED_FIFO", ["--priority", str(PRIORITY)])):
        for count in (0, arguments.busy):
            print(row(name, options, count, arguments.cycles), flush=True)


if __name__ == "__main__":
    main()
