"""`armtrue open` as a process of its own, and requests to it, also such as no browser makes."""

from __future__ import annotations

import http.client
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

ARMTRUE = str(Path(sys.executable).with_name("armtrue"))
_PATIENCE_S = 120.0

# Two effects that the believed model lacks, both clear in the data.
TWO_HIDDEN = {
    "arm": "kr30",
    "seed": 8,
    "hidden": [
        {"effect": "gear_harmonics", "joints": [3], "scale": 2.5},
        {"effect": "backlash", "joints": [2]},
    ],
}


class Workbench:
    """A running `armtrue open`. `address`: what it printed."""

    def __init__(self, arguments: Sequence[str | Path], state: Path) -> None:
        self.state_home = state
        command = [ARMTRUE, "open", *map(str, arguments), "--no-browser"]
        environment = {**os.environ, "XDG_STATE_HOME": str(state)}
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            # A test run in the background has Ctrl-C ignored, and child processes inherit that.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        self.address = ""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith("workbench "):
                self.address = line.split()[1]
                break
        if not self.address:
            raise AssertionError(f"no address was printed: {self.process.stderr.read()}")

    @property
    def port(self) -> int:
        """The port on which it listens."""
        return int(urlsplit(self.address).port or 0)

    @property
    def path(self) -> str:
        """The page's path, which holds the token."""
        return urlsplit(self.address).path

    def ask(
        self, path: str, method: str = "GET", body: bytes | None = None, **headers: str
    ) -> http.client.HTTPResponse:
        """Send one request with any headers; its response."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=_PATIENCE_S)
        connection.request(method, path, body, {"Host": f"127.0.0.1:{self.port}", **headers})
        return connection.getresponse()

    def state(self) -> dict[str, Any]:
        """state.json."""
        return dict(json.loads(self.ask(f"{self.path}state.json").read()))

    def drafted(self, column: str, what: str) -> str | None:
        """The server's draft of the form of guesses: what a column is, or its unit."""
        view = json.loads(self.ask(f"{self.path}view.json").read())
        return view["draft"].get("form", {}).get("columns", {}).get(column, {}).get(what)

    def do(self, **words: Any) -> int:
        """Request an action; the HTTP status of the answer."""
        return self.ask(f"{self.path}do", "POST", json.dumps(words).encode()).status

    def end(self) -> int:
        """Ctrl-C, and the exit status."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(_PATIENCE_S)

    def kill(self) -> None:
        """End it as a power cut would."""
        self.process.kill()
        self.process.communicate()
