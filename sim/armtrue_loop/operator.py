"""Client of the simulated cell: asks it to mount a payload, to wait, to measure with the tracker."""

from __future__ import annotations

import json
import socket
import time
from pathlib import Path
from typing import Any


class Operator:
    """A connection to `armtrue_loop.cell`; close it to end the cell."""

    def __init__(self, path: Path, timeout_s: float = 30.0) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        give_up = time.monotonic() + timeout_s
        while True:
            try:
                self._socket.connect(str(path))
                break
            except OSError:
                if time.monotonic() > give_up:
                    raise
                time.sleep(0.05)
        self._stream = self._socket.makefile("rw", encoding="utf-8")

    def ask(self, **request: Any) -> dict[str, Any]:
        """One request (wait=, mount=, measure=, fault=); raises RuntimeError if the cell cannot do it."""
        self._stream.write(json.dumps(request) + "\n")
        self._stream.flush()
        answer: dict[str, Any] = json.loads(self._stream.readline())
        if "error" in answer:
            raise RuntimeError(f"the cell says: {answer['error']}")
        return answer

    def close(self) -> None:
        """Close the connection, which ends the cell."""
        self._stream.close()
        self._socket.close()
