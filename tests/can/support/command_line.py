"""`armtrue …` as a person or a program calls it, in tests."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from armtrue.cli.app import main
from armtrue.device import SdoClient


@dataclass(frozen=True)
class Moment:
    """A signal that the program gets right after the `count`th request of a kind, which is on the bus by then.

    The program signals itself: a watcher of the bus would lose frames on a loaded machine (a socket keeps 277 of
    them, an upload has 1400) and signal too late on any.
    """

    how: signal.Signals
    count: int
    is_wanted: Callable[[bytes], bool]


def _signal_itself(moment: Moment) -> None:
    """Arm the moment in this process."""
    send = SdoClient._send
    left = moment.count

    def send_until(client: SdoClient, payload: bytes) -> None:
        nonlocal left
        send(client, payload)
        left -= moment.is_wanted(payload)
        if left == 0:
            left = -1
            os.kill(os.getpid(), moment.how)

    SdoClient._send = send_until  # type: ignore[method-assign]


class Running:
    """`armtrue …` in a forked process, which need not import everything again."""

    def __init__(self, *words: str | Path, moments: Sequence[Moment] = ()) -> None:
        self.command = ["armtrue", *map(str, words)]
        if "--interface" not in words:
            self.command += ["--interface", "socketcan"]
        if "--channel" not in words:
            self.command += ["--channel", "vcan0"]
        if "--timeout" not in words:
            # Every node that a test asks is there, but may be slow on a loaded machine.
            self.command += ["--timeout", "30"]
        self._out, self._err = tempfile.TemporaryFile("w+"), tempfile.TemporaryFile("w+")  # noqa: SIM115
        self._child = os.fork()
        if self._child == 0:
            self._become(moments)

    def _become(self, moments: Sequence[Moment]) -> None:
        os.dup2(self._out.fileno(), 1)
        os.dup2(self._err.fileno(), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        sys.argv = self.command
        status = 99
        try:
            for moment in moments:
                _signal_itself(moment)
            main()
        except SystemExit as leaving:
            status = leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)

    def send(self, how: signal.Signals) -> None:
        """Send it a signal."""
        os.kill(self._child, how)

    def wait_until_stopped(self) -> None:
        """Wait until its next Moment of SIGSTOP has stopped it; fails if it ends first."""
        status = os.waitpid(self._child, os.WUNTRACED)[1]
        assert os.WIFSTOPPED(status), f"{self.command} ended before its moment, status {status}"

    def wait(self) -> subprocess.CompletedProcess[str]:
        """Wait for its end; its exit status and output."""
        status = os.waitstatus_to_exitcode(os.waitpid(self._child, 0)[1])
        self._out.seek(0)
        self._err.seek(0)
        with self._out, self._err:
            return subprocess.CompletedProcess(self.command, status, self._out.read(), self._err.read())


def armtrue(*words: str | Path, moments: Sequence[Moment] = ()) -> subprocess.CompletedProcess[str]:
    """Run `armtrue …` to its end."""
    return Running(*words, moments=moments).wait()
