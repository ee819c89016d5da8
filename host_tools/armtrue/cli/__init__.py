"""The command `armtrue`."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130


def main() -> None:
    """Run the command line and exit; an interrupt during its import ends the process at once, without a message."""
    # An ignored signal (nohup, a shell's background job) stays ignored.
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if interruptible:
        signal.signal(signal.SIGINT, _leave)
    if sys.argv[1:] == ["--version"]:
        from armtrue import __version__

        # Answered before the libraries of the command line are imported.
        with contextlib.suppress(OSError):
            os.write(sys.stdout.fileno(), f"armtrue {__version__}\n".encode())
            return
    from armtrue.cli import app

    if interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        app.main()
    except KeyboardInterrupt:  # on the way out of `app.main`
        os._exit(INTERRUPTED)
    finally:
        # The command has finished. Without this, Python restores the signal's default action, which kills the process.
        if interruptible:
            signal.signal(signal.SIGINT, signal.SIG_IGN)


def _leave(_signal: int, _frame: FrameType | None) -> None:
    os._exit(INTERRUPTED)
