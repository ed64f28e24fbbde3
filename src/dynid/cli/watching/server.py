"""A server for one page, on this machine only: it answers to its own name, and has nothing else to give."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from dynid.cli.watching.board import Board, Notice
from dynid.errors import UsageError

#: Seconds between two signs of life to a page that listens.
_PULSE = 10.0
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class Server(ThreadingHTTPServer):
    """Serves `/`, the page, and `/events`, what becomes of it."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, port: int) -> None:
        self.board = Board()
        super().__init__(("127.0.0.1", port), Handler)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self.server_port}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Let go of whoever went away."""


class Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    server: Server
    timeout = 30
    server_version = "dynid"
    sys_version = ""

    def do_GET(self) -> None:
        """Give the page, or the stream of events."""
        # A foreign site that has its name point here comes with that name (DNS rebinding).
        names = {f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")}
        origin = self.headers.get("Origin")
        if self.headers.get("Host") not in names or (origin and origin not in {f"http://{n}" for n in names}):
            self._refuse(403)
        elif self.path == "/":
            self._send(self.server.board.now.page.encode(), "text/html; charset=utf-8")
        elif self.path == "/events":
            self._stream()
        else:
            self._refuse(404)

    def _send(self, content: bytes, kind: str) -> None:
        self._start(200, kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _start(self, status: int, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        for name, value in _HEADERS.items():
            self.send_header(name, value)

    def _refuse(self, status: int) -> None:
        self._start(status, "text/plain")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def _stream(self) -> None:
        self._start(200, "text/event-stream")
        self.end_headers()
        seen: Notice | None = None
        while True:
            notice = self.server.board.wait(seen, _PULSE)
            said = {"version": notice.version, "fault": notice.fault, "running": notice.running}
            line = ": still here\n\n" if notice is seen else f"data: {json.dumps(said)}\n\n"
            self.wfile.write(line.encode())
            self.wfile.flush()
            seen = notice

    def log_message(self, format: str, *args: Any) -> None:
        """Keep quiet: the terminal is for the scene."""


@contextmanager
def serving(port: int) -> Iterator[Server]:
    """Serve in the background.

    Parameters
    ----------
    port
        Of 127.0.0.1; 0: a free one.

    Raises
    ------
    UsageError
        Where the port is taken.
    """
    try:
        server = Server(port)
    except OSError as error:
        problem = f"port {port} cannot be used: {error.strerror or error}"
        raise UsageError(problem, remedy="Name another one, or none for a free one.") from error
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
