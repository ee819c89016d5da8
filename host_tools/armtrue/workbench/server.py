"""The web server: for this machine alone, with a secret token in the path and no external resources."""

from __future__ import annotations

import hmac
import json
import logging
import secrets
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

from armtrue.errors import InputError
from armtrue.workbench.background import FAULT, Task
from armtrue.workbench.compensator import device_view
from armtrue.workbench.engine import BusyError, Engine
from armtrue.workbench.session import Session
from armtrue.workbench.showing import page
from armtrue.workbench.showing.beside import beside, swaps
from armtrue.workbench.showing.card import card, evidence
from armtrue.workbench.showing.panels import panel
from armtrue.workbench.showing.view import buttons, pieces
from armtrue.workbench.state import state

HOST = "127.0.0.1"
_LARGEST_REQUEST = 1024 * 1024
_LARGEST_FILE = 64 * 1024 * 1024
# Interval at which an idle stream of changes sends a keep-alive.
_HEARTBEAT_S = 15.0
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


# Pieces of the page that it requests one by one, made from the session and the request's parameters.
Piece = Callable[[Session, dict[str, str]], str]
_PIECES: dict[str, Piece] = {
    "panel": panel,
    "card": lambda session, words: card(session, words.get("candidate", "")),
    "evidence": lambda session, words: evidence(session, words.get("candidate", "")),
    "beside": lambda session, words: beside(session, words.get("node", "")),
    "swaps": lambda session, words: swaps(session, words.get("effect", "")),
}


class Server(ThreadingHTTPServer):
    """Serves one engine. `address`: the URL that the user opens."""

    daemon_threads = True
    # The server does not wait for requests of tabs that were closed.
    block_on_close = False

    def __init__(self, engine: Engine, port: int) -> None:
        self.engine = engine
        self.token = secrets.token_urlsafe(24)
        super().__init__((HOST, port), _Handler)
        engine.is_at(self.address)

    @property
    def address(self) -> str:
        """The URL of the page, with its token."""
        return f"http://{HOST}:{self.server_address[1]}/{self.token}/"

    def own_names(self) -> set[str]:
        """Host names that a browser may use for this server; any other is of a foreign page that was pointed here."""
        port = self.server_address[1]
        return {f"{HOST}:{port}", f"localhost:{port}"}

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report nothing: broken connections are the browser's affair."""


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"
    server_version = "armtrue"
    sys_version = ""
    timeout = 120

    def do_GET(self) -> None:
        engine = self.server.engine
        self._answer({
            "": lambda _: self._html(page.page()),
            "script.js": lambda _: self._send(page.script().encode(), "text/javascript; charset=utf-8"),
            "style.css": lambda _: self._send(page.style().encode(), "text/css; charset=utf-8"),
            "state.json": lambda _: self._json(state(engine)),
            "view.json": lambda _: self._json(whole_view(engine)),
            "device": lambda _: self._html(device_view(engine.own_device)),
            "changes": self._changes, "file": self._file,
            **{name: partial(self._piece, make) for name, make in _PIECES.items()},
        })  # fmt: skip

    def do_POST(self) -> None:
        self._answer({"do": self._do, "drop": self._drop, "draft": self._draft})

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing, because the address contains the token."""

    def _answer(self, known: dict[str, Any]) -> None:
        parts = urlsplit(self.path)
        _, token, name = [*parts.path.split("/", 2), "", ""][:3]
        if not self._allowed(token):
            self._refuse(HTTPStatus.FORBIDDEN, "The workbench answers to its own page on this machine alone.")
            return
        if name not in known:
            self._refuse(HTTPStatus.NOT_FOUND, "There is no such thing here.")
            return
        words = {key: values[0] for key, values in parse_qs(parts.query).items()}
        try:
            known[name](words)
        except BusyError as error:
            self._refuse(HTTPStatus.CONFLICT, str(error))
        except InputError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True
        except Exception:
            logging.getLogger(__name__).exception("a request failed")
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, FAULT)

    def _allowed(self, token: str) -> bool:
        names = self.server.own_names()
        origin = self.headers.get("Origin")
        if len(self.headers.get_all("Host") or []) != 1 or self.headers["Host"] not in names:
            return False
        if origin is not None and origin not in {f"http://{name}" for name in names}:
            return False
        return hmac.compare_digest(token.encode(), self.server.token.encode())

    def _piece(self, make: Piece, words: dict[str, str]) -> None:
        self._html(make(self.server.engine.session, words))

    def _file(self, words: dict[str, str]) -> None:
        engine = self.server.engine
        made = engine.result.made if words.get("name") == "result" and engine.result else engine.made
        if made is None:
            raise InputError("file: found none that was made, expected Export or Report to be pressed first")
        name = quote(made.name)
        self._send(made.content, made.kind, {"Content-Disposition": f"attachment; filename*=UTF-8''{name}"})

    def _do(self, _words: dict[str, str]) -> None:
        words = self._words()
        if not isinstance(words.get("do"), str):
            raise InputError('found a request that is no action, expected {"do": …}')
        self.server.engine.do(words["do"], words)
        self._json({"accepted": True})

    def _draft(self, _words: dict[str, str]) -> None:
        self.server.engine.take_draft(self._words())
        self._json({"accepted": True})

    def _drop(self, words: dict[str, str]) -> None:
        self.server.engine.take(words.get("name", ""), self._body(_LARGEST_FILE))
        self._json({"accepted": True})

    def _words(self) -> dict[str, Any]:
        """The body of the request as a JSON mapping; empty where it is none."""
        try:
            words = json.loads(self._body(_LARGEST_REQUEST))
        except (ValueError, RecursionError):
            return {}
        return words if isinstance(words, dict) else {}

    def _body(self, largest: int) -> bytes:
        """The body of the request. Errors: InputError where it is too long or does not state its length."""
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > largest:
            self.close_connection = True
            raise InputError(f"found {length or 'no'} bytes announced, expected at most {largest}")
        return self.rfile.read(int(length))

    def _changes(self, _words: dict[str, str]) -> None:
        """A stream of events: one whenever there is something new to see."""
        self.send_response(HTTPStatus.OK)
        self._headers("text/event-stream")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        engine, seen = self.server.engine, 0
        while True:
            now = engine.wait(seen, _HEARTBEAT_S)
            line = f"data: {json.dumps(running(engine))}\n\n" if now != seen else ": still here\n\n"
            self.wfile.write(line.encode())
            self.wfile.flush()
            seen = now

    def _html(self, text: str) -> None:
        self._send(text.encode(), "text/html; charset=utf-8")

    def _json(self, value: Any) -> None:
        self._send(_json_bytes(value), "application/json")

    def _refuse(self, status: HTTPStatus, sentence: str) -> None:
        # The body of the request was not read: it would be taken for the next request.
        self.close_connection = True
        self._send(_json_bytes({"error": sentence}), "application/json", status=status)

    def _send(
        self,
        content: bytes,
        kind: str,
        more: dict[str, str] | None = None,
        status: HTTPStatus = HTTPStatus.OK,
    ) -> None:
        self.send_response(status)
        self._headers(kind)
        for name, value in (more or {}).items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)

    def _headers(self, kind: str) -> None:
        self.send_header("Content-Type", kind)
        for name, value in _HEADERS.items():
            self.send_header(name, value)


def _json_bytes(value: Any) -> bytes:
    return json.dumps(value, allow_nan=False).encode()  # browsers do not read NaN


def whole_view(engine: Engine) -> dict[str, Any]:
    """All that the page shows.

    Running tasks and the state of the diagnosis are read before the pieces are made. Where a diagnosis ends in between,
    the page still takes it for unknown, and asks again.
    """
    before = running(engine)
    left_out = engine.session.node.left_out if engine.is_open else []
    return {**before, "pieces": pieces(engine), "draft": engine.draft, "left_out": left_out}


def running(engine: Engine) -> dict[str, Any]:
    """The shown model, the messages about it, the running tasks, and which buttons can be pressed."""
    return {
        "model": engine.shown, "known": engine.known, "ended": engine.ended,
        "said": engine.said, "failure": engine.failure,
        "task": _shown(engine.task), "diagnosing": _shown(engine.background.task), "buttons": buttons(engine),
        "first_figures": engine.first_figures is not None, "pausing": engine.pausing.is_set(),
        "made": engine.made.name if engine.made else None,
    }  # fmt: skip


def _shown(task: Task | None) -> dict[str, Any] | None:
    return None if task is None else {"name": task.name, "share": task.share, "stage": task.stage}
