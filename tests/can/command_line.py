"""`armtrue …` as a person or a program calls it, in tests."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from armtrue.cli.app import main


class Running:
    """`armtrue …` in a forked process: what the program does, without importing everything anew."""

    def __init__(self, *words: str | Path) -> None:
        self.command = ["armtrue", *map(str, words)]
        if "--interface" not in words:
            self.command += ["--interface", "socketcan"]
        if "--channel" not in words:
            self.command += ["--channel", "vcan0"]
        if "--timeout" not in words:
            # Nobody whom a test asks is absent, only slow where the machine is loaded.
            self.command += ["--timeout", "30"]
        self._out, self._err = tempfile.TemporaryFile("w+"), tempfile.TemporaryFile("w+")  # noqa: SIM115
        self._child = os.fork()
        if self._child == 0:
            self._become()

    def _become(self) -> None:
        os.dup2(self._out.fileno(), 1)
        os.dup2(self._err.fileno(), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        sys.argv = self.command
        status = 99
        try:
            main()
        except SystemExit as leaving:
            status = leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)

    def send(self, how: signal.Signals) -> None:
        """Send it a signal."""
        os.kill(self._child, how)

    def wait(self) -> subprocess.CompletedProcess[str]:
        """Its end."""
        status = os.waitstatus_to_exitcode(os.waitpid(self._child, 0)[1])
        self._out.seek(0)
        self._err.seek(0)
        with self._out, self._err:
            return subprocess.CompletedProcess(self.command, status, self._out.read(), self._err.read())


def armtrue(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run `armtrue …` to its end."""
    return Running(*words).wait()
