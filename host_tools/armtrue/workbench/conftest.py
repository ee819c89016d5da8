"""Helpers of the workbench's tests: they start actions of the engine as its page does."""

from __future__ import annotations

import time
from typing import Any

from armtrue.workbench.engine import Engine


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
