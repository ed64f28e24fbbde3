"""`dynid watch`: rerun a scene whenever one of its files changes, with a live page."""

from __future__ import annotations

import json
import secrets
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.arguments import refuse_missing_folders, refuse_overwriting, set_option
from dynid.errors import DynidError, UsageError

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.scene.load import Scene

#: Longest text of a scene that may be the name of a file, and depth to which scenes name scenes.
_NAME_LENGTH, _DEPTH = 1000, 4

_Stamp = tuple[tuple[str, int, int, int], ...]


def files_of(scene: str) -> list[Path]:
    """Return the scene's file and every file that a text in it names, also in scenes named there.

    Files that cannot be read are skipped: a scene with faults is watched, too.
    """
    from dynid.scene.yaml.source import read_source

    files: dict[Path, None] = {}

    def collect(file: Path, depth: int) -> None:
        files[file] = None
        try:
            stack = [read_source(file).data] if depth else []
        except DynidError:
            return
        while stack:
            item = stack.pop()
            if isinstance(item, (dict, list)):
                stack += item.values() if isinstance(item, dict) else item
            if not isinstance(item, str) or not 0 < len(item) <= _NAME_LENGTH:
                continue
            path = file.parent / item
            is_new = False
            with suppress(OSError, ValueError):  # no possible name of a file
                is_new = path not in files and path.is_file()
            if is_new:
                collect(path, depth - 1 if path.suffix in (".yaml", ".yml") else 0)

    collect(Path(scene), _DEPTH)
    return list(files)


def stamp(files: list[Path]) -> _Stamp:
    """Return name, time (ns), size and inode of each file, which change when it is saved; 0 for no file."""
    stamps = []
    for file in files:
        try:
            status = file.stat()
        except OSError:
            stamps.append((str(file), 0, 0, 0))
        else:
            stamps.append((str(file), status.st_mtime_ns, status.st_size, status.st_ino))
    return tuple(stamps)


@dataclass(frozen=True)
class Notice:
    """Content of the live page: HTML and number of the last good result, faults of the scene as it is."""

    page: str = ""
    version: int = 0
    fault: str = ""
    running: bool = False


class Board:
    """Holder of a notice, which one thread replaces and others wait for."""

    def __init__(self) -> None:
        self._notice = Notice()
        self._changed = threading.Condition()

    @property
    def now(self) -> Notice:
        """The present notice."""
        return self._notice

    def put(self, **news: str | int | bool) -> None:
        """Replace a part of the notice."""
        with self._changed:
            self._notice = replace(self._notice, **news)  # type: ignore[arg-type]
            self._changed.notify_all()

    def wait(self, seen: Notice | None, seconds: float) -> Notice:
        """Return the notice once it differs from the one seen, or after some seconds unchanged."""
        with self._changed:
            self._changed.wait_for(lambda: self._notice is not seen, seconds)
            return self._notice


#: Samples of the first preview, most of the second, and the seconds that the second may take.
FIRST, MOST, SECONDS = 6, 1000, 4.0


def previews(study: Scene, target: Path) -> Iterator[str]:
    """Run a few samples of a checked study into a file, then more if they are fast.

    Yields each time, with the finished samples in the file, which samples were run; empty for all.
    """
    from dynid.study.executors import make_executor
    from dynid.study.plan import make_plan
    from dynid.study.run import run_study, shard_of

    plan, started = make_plan(study), time.perf_counter()

    def run(limit: int) -> tuple[int, str]:
        """Run at most so many samples that the file does not hold; return how many it has, and the note."""
        shard = (1, -(-plan.size // limit))
        run_study(plan, target, make_executor("serial"), shard=shard, force=True)
        count = len(shard_of(plan, shard))
        part = f"{count:,} of {plan.size:,} samples, evenly over the plan; dynid study runs them all."
        return count, f"Preview: {part}" if count < plan.size else ""

    count, note = run(FIRST)
    yield note
    duration = (time.perf_counter() - started) / count
    enough = min(plan.size, MOST, int(SECONDS / duration))
    if enough >= 2 * count or count < plan.size <= enough:
        yield run(enough)[1]


#: Seconds between two comments on an idle event stream, which keep the connection open.
_PULSE = 10.0
#: Most connections at a time: a page takes two.
_CONNECTIONS = 16
_BUSY = b"HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class _Server(ThreadingHTTPServer):
    """Server of the page at `/TOKEN/` and of its changes at `/TOKEN/events`.

    The token is new for each server: other users and programs of this machine do not know it.
    """

    daemon_threads = True
    block_on_close = False

    def __init__(self, port: int) -> None:
        self.board = Board()
        self.token = secrets.token_urlsafe(16)
        self._free = threading.BoundedSemaphore(_CONNECTIONS)
        super().__init__(("127.0.0.1", port), _Handler)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/{self.token}/"

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a request in a thread; refuse it where there are too many connections."""
        if not self._free.acquire(blocking=False):
            with suppress(OSError):
                request.settimeout(1.0)
                request.sendall(_BUSY)
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except BaseException:  # no thread was started
            self._free.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore clients that disconnect."""


class _Handler(BaseHTTPRequestHandler):
    """Handler of one request."""

    server: _Server
    timeout = 30
    server_version = "dynid"
    sys_version = ""

    def do_GET(self) -> None:
        # A foreign site whose name resolves to this machine sends that name (DNS rebinding).
        names = {f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")}
        origin = self.headers.get("Origin")
        if self.headers.get("Host") not in names or (origin and origin not in {f"http://{n}" for n in names}):
            self._refuse(403)
            return
        token, _, name = self.path.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self._refuse(403)
        elif name == "" and self.path.endswith("/"):
            content = self.server.board.now.page.encode()
            self._start(200, "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)
        elif name == "events":
            self._start(200, "text/event-stream")
            self.end_headers()
            seen: Notice | None = None
            while True:
                notice = self.server.board.wait(seen, _PULSE)
                state = {"version": notice.version, "fault": notice.fault, "running": notice.running}
                line = ": still here\n\n" if notice is seen else f"data: {json.dumps(state)}\n\n"
                self.wfile.write(line.encode())
                self.wfile.flush()
                seen = notice
        else:
            self._refuse(404)

    def _start(self, status: int, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        for name, value in _HEADERS.items():
            self.send_header(name, value)

    def _refuse(self, status: int) -> None:
        self._start(status, "text/plain")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: the terminal is for the scene."""


@contextmanager
def serving(port: int) -> Iterator[_Server]:
    """Serve in the background at a port of 127.0.0.1; 0: a free one. Raises `UsageError` if it is taken."""
    try:
        server = _Server(port)
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


#: Seconds between two polls; a file is saved when two polls in a row find it unchanged.
_POLL = 0.15


class Watch:
    """Rerun of a scene, with values set, whenever one of its files changes.

    The last good result is written to an output file, if any, and shown by the board's notice.
    """

    def __init__(self, scene: str, overrides: Sequence[str], output: str | None, board: Board) -> None:
        self.scene, self.overrides, self.output, self.board = scene, tuple(overrides), output, board
        self._files: list[Path] = []

        from dynid.report.page.document import document

        waiting = document(Path(scene).name, "waiting for a first result", [], ["watch.js"], live=0)
        board.put(page=waiting)

    def run(self) -> None:
        """Run the scene now and after every change, until interrupted."""
        while True:
            self._files = files_of(self.scene)
            last = before = stamp(self._files)
            self.show()
            while True:  # until a file has changed, and no longer does
                time.sleep(_POLL)
                now = stamp(self._files)
                if now == last and now != before:
                    break
                last = now

    def show(self) -> None:
        """Run the scene once, and show its result or its faults."""
        started = time.perf_counter()
        self.board.put(running=True)
        fault = ""
        try:
            self._compute()
        except DynidError as error:
            fault = str(error)
        except MemoryError:
            fault = f"{self.scene}: this needs more memory than there is"
        except Exception as error:
            fault = f"{self.scene}: a fault of dynid itself: {type(error).__name__} {error}"
        self.board.put(running=False, fault=fault)
        click.echo(fault or f"{self.scene}: done in {time.perf_counter() - started:.2g} s", err=True)

    def _compute(self) -> None:
        """Run the scene, or some samples of a study, and publish the result."""
        from dynid.scene.load import load_scene

        scene = load_scene(self.scene, self.overrides)
        if scene.kind == "study":
            from dynid.file_access import replace_file
            from dynid.store import open_stored

            with TemporaryDirectory() as folder:
                target = Path(folder) / "study.h5"
                for note in previews(scene, target):
                    with open_stored(target) as preview:
                        self._publish(preview, note)
                if self.output:
                    replace_file(self.output, target.read_bytes())
            return
        from dynid.cli.run import compute

        try:
            self._keep(compute(scene, lambda _: None, accuracy=False))
        except DynidError as error:
            if error.result is not None:
                self._keep(error.result)
            raise

    def _keep(self, result: Result) -> None:
        """Write a result where that is wanted, and publish it."""
        if self.output:
            from dynid.store import write_result

            write_result(result, self.output)
        self._publish(result)

    def _publish(self, result: Result, note: str = "") -> None:
        from dynid.report.page import page

        version = self.board.now.version + 1
        self.board.put(page=page(result, live=version, note=note), version=version, fault="")


@click.command()
@click.argument("scene", type=click.Path())
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    metavar="N",
    help="The port of the page; default a free one.",
)
@click.option("--no-browser", is_flag=True, help="Open no browser; the address is printed.")
@set_option("scene")
@click.option("-o", "--output", type=click.Path(), help="Also write the last good result to this HDF5 file.")
def watch(scene: str, port: int, no_browser: bool, overrides: tuple[str, ...], output: str | None) -> int:
    """Rerun a scene whenever it or a file that it reads changes, with a live report in the browser.

    The report is served on this machine only, at an address with a token, until Ctrl-C. While the scene has
    faults, the report keeps the last good result and lists the faults with their places. For a study, as many
    samples are run as a few seconds allow, evenly over its plan.
    """
    if not Path(scene).is_file():
        from dynid.scene.yaml.source import read_source

        read_source(scene)  # raises the error
    if output:
        refuse_overwriting(scene, output, None)
        refuse_missing_folders(output)
    with serving(port) as server:
        click.echo(f"watching {scene} at {server.address} (Ctrl-C ends)", err=True)
        if not no_browser:
            click.launch(server.address)
        Watch(scene, overrides, output, server.board).run()
    return 0
