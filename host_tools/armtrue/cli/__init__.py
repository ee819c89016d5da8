"""The command `armtrue`."""

from __future__ import annotations

import os
import signal
from types import FrameType

INTERRUPTED = 130


def main() -> None:
    """Run the command line and exit; interrupted while it is still being read in, it ends at once and quietly."""
    # An ignored signal (nohup, a shell's background job) stays ignored.
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if interruptible:
        signal.signal(signal.SIGINT, _leave)
    from armtrue.cli import app

    if interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    app.main()


def _leave(_signal: int, _frame: FrameType | None) -> None:
    os._exit(INTERRUPTED)
