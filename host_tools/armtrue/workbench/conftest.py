"""Helpers of the workbench's tests: they send the server what its page sends."""

from __future__ import annotations

import time
from typing import Any

from armtrue.workbench.engine import Engine


def finish(engine: Engine) -> None:
    """Wait until what was begun is done."""
    end = time.monotonic() + 60.0
    while engine.task is not None:
        assert time.monotonic() < end
        time.sleep(0.01)


def do(engine: Engine, action: str, **words: Any) -> str:
    """Press a button and wait; what the page then says."""
    engine.do(action, words)
    finish(engine)
    assert engine.failure == ""
    return engine.said
