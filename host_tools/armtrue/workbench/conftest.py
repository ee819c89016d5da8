"""Helpers of the workbench's tests: they start actions of the engine as its page does."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import armtrue_sim
import pytest

from armtrue.workbench.engine import Engine
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.opening.opened import open_files

CAMPAIGN = {
    "arm": "kr30",
    "seed": 8,
    "poses": 150,
    "hidden": [{"effect": "gear_harmonics", "joints": [3], "scale": 2.5}],
}


@pytest.fixture
def engine(tmp_path, monkeypatch) -> Engine:
    """A workbench on a small campaign with a hidden effect, in the folder of its files."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    armtrue_sim.simulate(CAMPAIGN).write(tmp_path)
    engine = Engine(Drop(tmp_path / "drop"))
    engine.begin(open_files([Path("data.csv")]))
    return engine


def finish(engine: Engine) -> None:
    """Wait until the running action has ended."""
    end = time.monotonic() + 60.0
    while engine.task is not None:
        assert time.monotonic() < end
        time.sleep(0.01)


def do(engine: Engine, action: str, **words: Any) -> str:
    """Start an action as its button does and wait; return the message that the page then shows."""
    engine.do(action, words)
    finish(engine)
    assert engine.failure == ""
    return engine.said
