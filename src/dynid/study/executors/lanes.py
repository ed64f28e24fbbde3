"""Processes that run one call at a time each, and are killed where a call takes too long.

They are no pool of `multiprocessing`: one of them may end without the others, and a worker of Dask, which may
have no such children, may have these.
"""

from __future__ import annotations

import json
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any

from dynid.study.executors.processes import ONE_THREAD

_LENGTH = struct.Struct("<Q")
_BOOT = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from dynid.study.executors.lanes import serve; serve()"
)
_WARM_UP = 10.0  # s more for the first call of all, which loads what it needs; or
_SLOWNESS = 5.0  # times as long as the process took to start, where that is more
_START = 600.0  # s that a process may take to start
_IDLE = 60.0  # s that a process of a worker of Dask waits for the next call


class Overdue(Exception):
    """A call took longer than it may."""


class Died(Exception):
    """The process of a call ended with it."""


class Lane:
    """One process after another, in which calls are run."""

    def __init__(self) -> None:
        self.timer: threading.Timer | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._replies: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._known: bytes | None = None  # a call that ended in time
        self._warm_up = 0.0
        self._closed = False

    def run(self, seconds: float, call: Callable[..., Any], *args: Any) -> Any:
        """Return what a call returns, or raise what it raises.

        A new process first repeats a call that ended in time before: what that loads is no part of the time
        of the next one.

        Raises
        ------
        Overdue
            Where it takes longer than so many seconds. The process is killed.
        Died
            Where its process ends.
        """
        message = pickle.dumps((call, args))
        if self._process is None:
            self._start()
            if self._known is not None:
                try:
                    self._exchange(self._known, seconds + self._warm_up)
                except (Overdue, Died):
                    self._known = None
                    self._start()
        allowed = seconds + (0.0 if self._known else self._warm_up)
        done, answer = pickle.loads(self._exchange(message, allowed))
        if not done:
            raise answer
        self._known = self._known or message
        return answer

    def close(self) -> None:
        """End the process, whatever it does, and begin no other one."""
        self._closed = True
        self._kill()

    def _start(self) -> None:
        if self._closed:
            raise Died
        self._process = subprocess.Popen(
            [sys.executable, "-c", _BOOT, json.dumps(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | dict.fromkeys(ONE_THREAD, "1"),
            # Ctrl-C is for this process to answer.
            process_group=0 if os.name == "posix" else None,
        )
        began = time.monotonic()
        self._replies = queue.SimpleQueue()
        threading.Thread(target=_receive, args=(self._process.stdout, self._replies), daemon=True).start()
        self._exchange(pickle.dumps((_ready, ())), _START)
        self._warm_up = max(_WARM_UP, _SLOWNESS * (time.monotonic() - began))

    def _exchange(self, message: bytes, seconds: float) -> bytes:
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            _send(self._process.stdin, message)
            answer = self._replies.get(timeout=seconds)
        except queue.Empty:
            self._kill()
            raise Overdue from None
        except (OSError, ValueError):  # the pipe is closed
            answer = None
        if answer is None:
            self._kill()
            raise Died
        return answer

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            assert process.stdin is not None
            with suppress(OSError):
                process.stdin.close()


class Lanes:
    """As many lanes as calls run at once.

    Parameters
    ----------
    idle
        The seconds after which a lane without a call ends its process; absent: never.
    """

    def __init__(self, idle: float | None = None) -> None:
        self._idle = idle
        self._lock = threading.Lock()
        self._free: list[Lane] = []
        self._every: list[Lane] = []
        self._closed = False

    def run(self, seconds: float, call: Callable[..., Any], *args: Any) -> Any:
        """Run a call in a free lane, as `Lane.run`."""
        with self._lock:
            if self._closed:
                raise Died
            lane = self._free.pop() if self._free else Lane()
            if lane not in self._every:
                self._every.append(lane)
        if lane.timer is not None:
            lane.timer.cancel()
        try:
            return lane.run(seconds, call, *args)
        finally:
            with self._lock:
                self._free.append(lane)
            if self._idle is not None:
                lane.timer = threading.Timer(self._idle, self._retire, (lane,))
                lane.timer.daemon = True
                lane.timer.start()

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            self._closed = True
            every = list(self._every)
        for lane in every:
            lane.close()

    def _retire(self, lane: Lane) -> None:
        with self._lock:
            if lane not in self._free:
                return
            self._free.remove(lane)
            self._every.remove(lane)
        lane.close()


_OF_WORKER = Lanes(_IDLE)


def run_timed(seconds: float, call: Callable[..., Any], *args: Any) -> Any:
    """Run a call in a process beside this one, as `Lane.run`; for workers of Dask."""
    return _OF_WORKER.run(seconds, call, *args)


def _ready() -> None:
    """Load what samples are run with."""
    import dynid.study.work  # noqa: F401


def serve() -> None:
    """Run the calls that come in, in the process of a lane."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1):
        os.dup2(nothing, descriptor)  # what is printed is no answer
    calls: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(requests, calls, True), daemon=True).start()
    while (message := calls.get()) is not None:
        try:
            call, args = pickle.loads(message)
            answer: tuple[bool, Any] = True, call(*args)
        except Exception as error:
            answer = False, error
        _send(replies, pickle.dumps(answer))


def _send(stream: IO[bytes], message: bytes) -> None:
    stream.write(_LENGTH.pack(len(message)))
    stream.write(message)
    stream.flush()


def _receive(stream: IO[bytes], arrived: queue.SimpleQueue[bytes | None], last: bool = False) -> None:
    """Pass on messages until the other side is gone; then this process may end, too."""
    with stream:
        while len(head := stream.read(_LENGTH.size)) == _LENGTH.size:
            (length,) = _LENGTH.unpack(head)
            if len(message := stream.read(length)) < length:
                break
            arrived.put(message)
    if last:
        os._exit(0)
    arrived.put(None)
