"""`dynid watch`: run a scene whenever a file of it changes, with a live page."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from dynid.errors import DynidError, UsageError

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.scene.load import Scene
    from dynid.study.plan import Plan

#: Longest text of a scene that may be the name of a file, and how deep one scene may name another.
_LONGEST, _DEEPEST = 1000, 4

Stamp = tuple[tuple[str, int, int, int], ...]


def files_of(scene: str) -> list[Path]:
    """Return the scene's file and every file that a text in it names, and so on from scenes named there.

    Whatever is no file is no matter: a scene with faults is watched too.
    """
    found: dict[Path, None] = {}
    _gather(Path(scene), found, _DEEPEST)
    return list(found)


def _gather(file: Path, found: dict[Path, None], deeper: int) -> None:
    from dynid.errors import DynidError
    from dynid.scene.yaml.source import read_source

    found[file] = None
    if not deeper:
        return
    try:
        data = read_source(file).data
    except DynidError:
        return
    for text in _texts(data):
        other = file.parent / text
        if other in found or not _is_file(other):
            continue
        found[other] = None
        if other.suffix in (".yaml", ".yml"):
            _gather(other, found, deeper - 1)


def _texts(data: Any) -> Iterator[str]:
    stack = [data]
    while stack:
        item = stack.pop()
        if isinstance(item, str) and 0 < len(item) <= _LONGEST:
            yield item
        elif isinstance(item, dict):
            stack += item.values()
        elif isinstance(item, list):
            stack += item


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def stamp(files: list[Path]) -> Stamp:
    """Return what changes when a file is saved; what is not there has a stamp too."""
    return tuple(_stamp(file) for file in files)


def _stamp(file: Path) -> tuple[str, int, int, int]:
    try:
        status = file.stat()
    except OSError:
        return str(file), 0, 0, 0
    return str(file), status.st_mtime_ns, status.st_size, status.st_ino


@dataclass(frozen=True)
class Notice:
    """Content of the live page.

    Parameters
    ----------
    page
        HTML of the last good result.
    version
        Counts good results.
    fault
        What is wrong with the scene as it is now; empty where nothing is.
    running
        Whether it is being run.
    """

    page: str = ""
    version: int = 0
    fault: str = ""
    running: bool = False


class Board:
    """Holds a notice that one thread replaces and others wait for."""

    def __init__(self) -> None:
        self._notice = Notice()
        self._changed = threading.Condition()

    @property
    def now(self) -> Notice:
        """The notice as it is."""
        return self._notice

    def put(self, **news: str | int | bool) -> None:
        """Replace a part of the notice."""
        with self._changed:
            self._notice = replace(self._notice, **news)  # type: ignore[arg-type]
            self._changed.notify_all()

    def wait(self, seen: Notice | None, seconds: float) -> Notice:
        """Return the notice once it is another one than was seen, or after some time as it is."""
        with self._changed:
            self._changed.wait_for(lambda: self._notice is not seen, seconds)
            return self._notice


#: Samples of the first look, most of the second, and the seconds that this one may take.
FIRST, MOST, SECONDS = 6, 1000, 4.0


def looks(study: Scene, target: Path) -> Iterator[str]:
    """Run a few samples of a study into a file, then more where they are quick; tell each time which.

    Parameters
    ----------
    study
        The study, checked.
    target
        The file, which holds what was run whenever this yields.
    """
    from dynid.study.plan import make_plan

    plan, started = make_plan(study), time.perf_counter()
    count = _run(plan, target, FIRST)
    yield _said(plan, count)
    each = (time.perf_counter() - started) / count
    enough = min(plan.size, MOST, int(SECONDS / each))
    if enough >= 2 * count or count < plan.size <= enough:
        yield _said(plan, _run(plan, target, enough))


def _run(plan: Plan, target: Path, most: int) -> int:
    """Run at most so many samples, those that the file has excepted; return how many there are."""
    from dynid.study.execute import run_study, shard_of
    from dynid.study.executors import make_executor

    shard = (1, -(-plan.size // most))
    run_study(plan, target, make_executor("serial"), shard=shard, force=True)
    return len(shard_of(plan, shard))


def _said(plan: Plan, count: int) -> str:
    if count == plan.size:
        return ""
    return (
        f"A first look: {count:,} of {plan.size:,} samples, evenly over the plan; dynid study runs them all."
    )


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
        """Address of the page."""
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


#: Seconds between two looks; a file counts as saved when two looks in a row see the same.
_LOOK = 0.15


class Watch:
    """A scene that is watched.

    Parameters
    ----------
    scene
        Its file.
    overrides
        As of `--set`.
    output
        The HDF5 file of the last good result, if it is wanted.
    board
        What the page shows.
    """

    def __init__(self, scene: str, overrides: Sequence[str], output: str | None, board: Board) -> None:
        self.scene, self.overrides, self.output, self.board = scene, tuple(overrides), output, board
        self._files: list[Path] = []
        board.put(page=self._waiting())

    def run(self) -> None:
        """Run the scene now and after every change, until interrupted."""
        while True:
            self._files = files_of(self.scene)
            before = stamp(self._files)
            self.show()
            self._wait(before)

    def show(self) -> None:
        """Run the scene once, and show its result or its faults."""
        started = time.perf_counter()
        self.board.put(running=True)
        fault = self._attempt()
        self.board.put(running=False, fault=fault)
        said = fault or f"{self.scene}: done in {time.perf_counter() - started:.2g} s"
        click.echo(said, err=True)

    def _attempt(self) -> str:
        """Run the scene; return what is wrong, if anything is."""
        try:
            self._compute()
        except DynidError as error:
            return str(error)
        except MemoryError:
            return f"{self.scene}: this needs more memory than there is"
        except Exception as error:
            return f"{self.scene}: a fault of dynid itself: {type(error).__name__} {error}"
        return ""

    def _compute(self) -> None:
        from dynid.scene.load import load_scene

        scene = load_scene(self.scene, self.overrides)
        if scene.kind == "study":
            self._look_at(scene)
            return
        from dynid.cli.run import compute

        result = compute(scene, lambda _: None, accuracy=False)
        if self.output:
            from dynid.store import write_result

            write_result(result, self.output)
        self._publish(result)

    def _look_at(self, study: Scene) -> None:
        """Run some of a study's samples, and show what they tell; more of them where they are quick."""
        from dynid.file_access import replace_file
        from dynid.store import open_stored

        with TemporaryDirectory() as folder:
            target = Path(folder) / "study.h5"
            for note in looks(study, target):
                with open_stored(target) as result:
                    self._publish(result, note)
            if self.output:
                replace_file(self.output, target.read_bytes())

    def _publish(self, result: Result, note: str = "") -> None:
        from dynid.report.page import page

        version = self.board.now.version + 1
        self.board.put(page=page(result, live=version, note=note), version=version, fault="")

    def _wait(self, before: Stamp) -> None:
        """Return when a file has changed, and no longer does."""
        last = before
        while True:
            time.sleep(_LOOK)
            now = stamp(self._files)
            if now == last and now != before:
                return
            last = now

    def _waiting(self) -> str:
        from dynid.report.page.document import document

        return document(Path(self.scene).name, "waiting for a first result", [], ["watch.js"], live=0)


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
@click.option(
    "--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Set a value of the scene; repeatable."
)
@click.option("-o", "--output", type=click.Path(), help="Write the last good result to this HDF5 file, too.")
def watch(scene: str, port: int, no_browser: bool, overrides: tuple[str, ...], output: str | None) -> int:
    """Run a scene whenever it or a file that it reads changes, and show its page in the browser.

    The page is served on this machine only, until Ctrl-C. A scene with faults leaves the last good result on
    the page, with the faults and their places above it. Of a study some samples are run, evenly over its
    plan, as many as a few seconds allow.
    """
    from dynid.cli.run import refuse_missing_folders, refuse_overwriting

    if not Path(scene).is_file():
        from dynid.scene.yaml.source import read_source

        read_source(scene)  # which says what is wrong
    if output:
        refuse_overwriting(scene, output, None)
        refuse_missing_folders(output)
    with serving(port) as server:
        click.echo(f"watching {scene} at {server.address} (Ctrl-C ends)", err=True)
        if not no_browser:
            click.launch(server.address)
        Watch(scene, overrides, output, server.board).run()
    return 0
