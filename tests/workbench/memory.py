"""Memory that the workbench's server holds, now and over many actions."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from opened import Workbench

POSES, ACTIONS, EVERY = 300, 500, 100
_PATIENCE_S = 120.0
_CANDIDATES = 8


def resident_mb(workbench: Workbench) -> float:
    """Memory of the server's process [MB]."""
    lines = Path(f"/proc/{workbench.process.pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS"))


def held_over(workbench: Workbench, actions: int, every: int) -> list[float]:
    """Memory [MB] after each `every` of so many actions: Add, Undo, Redo and Remove in turn, each waited for."""
    held = []
    for done in range(0, actions, 4):
        _wait(workbench, "candidates")  # of many measurements they come a while after the figures
        _do(workbench, do="add", candidate=(done // 4) % _CANDIDATES)
        _do(workbench, do="undo")
        _do(workbench, do="redo")
        state = _do(workbench, do="remove", effect=len(workbench.state()["effects"]) - 1)
        assert state["failure"] == "", state["failure"]
        if (done + 4) % every == 0:
            held.append(resident_mb(workbench))
    return held


def _do(workbench: Workbench, **words: Any) -> dict[str, Any]:
    assert workbench.do(**words) == 200
    end = time.monotonic() + _PATIENCE_S
    while (state := workbench.state())["busy"]:
        assert time.monotonic() < end, f"{words['do']} takes longer than {_PATIENCE_S} s"
        time.sleep(0.01)
    return state


def _wait(workbench: Workbench, key: str) -> None:
    end = time.monotonic() + _PATIENCE_S
    while not workbench.state()[key]:
        assert time.monotonic() < end, f"no {key} within {_PATIENCE_S} s"
        time.sleep(0.1)
