"""Memory that the workbench's server holds, now and over many actions.

As a program it prints a table for docs/results.md (an hour); `./dev bench workbench` runs it.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import deque
from pathlib import Path
from typing import Any

import armtrue_sim
from armtrue.candidates import model_entry
from opened import TWO_HIDDEN, Workbench

POSES, ACTIONS, EVERY = 300, 500, 100
_PATIENCE_S = 600.0
_CANDIDATES = 8
_READINGS = 5  # a figure is the least of these


def resident_mb(workbench: Workbench) -> float:
    """Memory of the server's process [MB]."""
    lines = Path(f"/proc/{workbench.process.pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS"))


def held_over(workbench: Workbench, actions: int, every: int, diagnosed_every: int = 4) -> list[float]:
    """Memory [MB] after each `every` of `actions` actions: Add, Undo, Redo and Remove in turn, each waited for.

    `diagnosed_every`: after this many actions a diagnosis is waited for; the next action stops the others. Freed memory
    goes back to the system in pieces, so a figure is the least of those after the last few diagnoses.
    """
    _wait_for_diagnosis(workbench)
    entries = [model_entry(candidate) for candidate in workbench.state()["candidates"][:_CANDIDATES]]
    held, readings = [], deque[float](maxlen=_READINGS)
    for done in range(0, actions, 4):
        _do(workbench, do="add", entry=entries[(done // 4) % len(entries)])
        _do(workbench, do="undo")
        _do(workbench, do="redo")
        state = _do(workbench, do="remove", effect=len(workbench.state()["effects"]) - 1)
        assert state["failure"] == "", state["failure"]
        if (done + 4) % diagnosed_every == 0:
            _wait_for_diagnosis(workbench)
            readings.append(resident_mb(workbench))
        if (done + 4) % every == 0:
            held.append(min(readings))
    return held


def _do(workbench: Workbench, **words: Any) -> dict[str, Any]:
    assert workbench.do(**words) == 200
    end = time.monotonic() + _PATIENCE_S
    while (state := workbench.state())["busy"]:
        assert time.monotonic() < end, f"{words['do']} takes longer than {_PATIENCE_S} s"
        time.sleep(0.01)
    return state


def _wait_for_diagnosis(workbench: Workbench) -> None:
    """Wait until its result is there and its memory is freed, which takes a while beside other programs."""
    end = time.monotonic() + _PATIENCE_S
    while not (state := workbench.state())["candidates"] or state["diagnosing"]:
        assert time.monotonic() < end, f"no diagnosis within {_PATIENCE_S} s"
        time.sleep(0.1)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, nargs="*", default=[POSES, 2000, 12000])
    parser.add_argument("--actions", type=int, default=ACTIONS)
    given = parser.parse_args()
    marks = range(EVERY, given.actions + 1, EVERY)
    print(f"| poses | {' | '.join(map(str, marks))} |")
    print("|---" * (1 + len(marks)) + "|")
    for poses in given.poses:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            armtrue_sim.simulate({**TWO_HIDDEN, "poses": poses}).write(folder)
            workbench = Workbench([folder / "data.csv"], folder / "state")
            try:
                # A diagnosis of many measurements takes ten seconds: one in twenty actions waits for it.
                held = held_over(workbench, given.actions, EVERY, 20 if poses > POSES else 4)
                print(f"| {poses} | {' | '.join(f'{mb:.0f}' for mb in held)} |", flush=True)
            finally:
                workbench.kill()


if __name__ == "__main__":
    main()
