"""The command line `armtrue`, called as its user would, without importing everything anew for each call.

Inside User-Mode Linux starting Python takes seconds. A process that has imported the program once, before there are
any threads, forks for each call; arguments, output and exit status are those of the program.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import re
import socket
import sys
import tempfile
from pathlib import Path
from typing import Any

# Tests, the compensator (a library, no module), and what needs packages that a demo has not.
_LEFT_OUT = re.compile(r"\.(test_\w+|conftest|workbench|_fixed|__main__)(\.|$)")


class Toolbox:
    """Make it before threads are started; use as a context manager."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        sys.stdout.flush()
        self._server = os.fork()
        if self._server == 0:
            ours.close()
            _serve(theirs)
        theirs.close()
        self._socket = ours
        self._stream = ours.makefile("rw", encoding="utf-8")

    def __enter__(self) -> Toolbox:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()
        self._socket.close()
        os.waitpid(self._server, 0)

    def armtrue(self, *words: str | Path, show: int | None = None) -> None:
        """Run `armtrue …`; of its output the first `show` lines are printed, None: all.

        Raises RuntimeError with everything it said if it fails.
        """
        sys.stdout.flush()
        arguments = ["armtrue", *map(str, words)]
        self._stream.write(json.dumps({"arguments": arguments, "capture": show is not None}) + "\n")
        self._stream.flush()
        answer: dict[str, Any] = json.loads(self._stream.readline())
        if answer["status"] != 0:
            raise RuntimeError(
                f"`{' '.join(arguments)}` ended with status {answer['status']}: {answer['said']}"
            )
        if show:
            lines = answer["said"].strip("\n").splitlines()
            print("\n".join(line.rstrip() for line in lines[:show]))
            if sum(bool(line.strip()) for line in lines[show:]) > 1:
                print("  …")


def _serve(connection: socket.socket) -> None:
    """Answer calls until the other side hangs up; never returns."""
    from armtrue.cli.app import main

    _import_what_commands_need()
    with connection, connection.makefile("rw", encoding="utf-8") as stream:
        for line in stream:
            request = json.loads(line)
            with tempfile.TemporaryFile("w+") as said:
                child = os.fork()
                if child == 0:
                    _become(main, request["arguments"], said.fileno() if request["capture"] else None)
                status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
                said.seek(0)
                stream.write(json.dumps({"status": status, "said": said.read()}) + "\n")
                stream.flush()
    os._exit(0)


def _import_what_commands_need() -> None:
    """Import, once and before any fork, the modules that commands import only when they run.

    Commands do so to keep `--help` quick; without this every forked call would import them again.
    """
    import armtrue

    for module in pkgutil.walk_packages(armtrue.__path__, "armtrue."):
        if not _LEFT_OUT.search(module.name):
            importlib.import_module(module.name)


def _become(main: Any, arguments: list[str], output: int | None) -> None:
    """Be the program; never returns."""
    if output is not None:
        os.dup2(output, 1)
        os.dup2(output, 2)
    sys.stdout, sys.stderr = os.fdopen(os.dup(1), "w"), os.fdopen(os.dup(2), "w")
    sys.argv = arguments
    status = 99
    try:
        main()
        status = 0
    except SystemExit as leaving:
        status = leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
    except BaseException as problem:
        print(f"{type(problem).__name__}: {problem}", file=sys.stderr)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
