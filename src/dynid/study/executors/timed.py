"""Executor with a time limit: processes that run one call at a time, and are killed if it takes too long.

A pool of `multiprocessing` would not do: there one process cannot end without the others, and workers of
Dask, which are daemons, may not have such children.
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
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from typing import IO, Any

from dynid.study.executors.base import ONE_THREAD, StudyExecutor

_LENGTH = struct.Struct("<Q")
_BOOT = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from dynid.study.executors.timed import serve; serve()"
)
_WARM_UP = 10.0  # s added to the limit of the first call, which imports modules; or
_SLOWNESS = 5.0  # times the time that the process took to start, if that is longer
_START = 600.0  # limit of the start of a process, s
_IDLE = 60.0  # s until an idle process of a Dask worker ends


class TimeLimitExceeded(Exception):
    """A call exceeded its time limit."""


class WorkerDied(Exception):
    """The process of a call ended before the call."""


class Lane:
    """Process that runs one call at a time, and is replaced when it has ended."""

    def __init__(self) -> None:
        self.timer: threading.Timer | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._replies: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._known: bytes | None = None  # a call that ended in time
        self._warm_up = 0.0
        self._closed = False

    def run(self, seconds: float, call: Callable[..., Any], *args: Any) -> Any:
        """Return the value of a call, or raise its exception.

        A new process first repeats a call that ended in time before, so that the time for imports does not
        count for the next call.

        Raises
        ------
        TimeLimitExceeded
            If the call takes longer than `seconds`. Its process is killed.
        WorkerDied
            If its process ends.
        """
        message = pickle.dumps((call, args))
        if self._process is None:
            self._start()
            if self._known is not None:
                try:
                    self._exchange(self._known, seconds + self._warm_up)
                except (TimeLimitExceeded, WorkerDied):
                    self._known = None
                    self._start()
        allowed = seconds + (0.0 if self._known else self._warm_up)
        done, answer = pickle.loads(self._exchange(message, allowed))
        if not done:
            raise answer
        self._known = self._known or message
        return answer

    def close(self) -> None:
        """Kill the process, and start no other one."""
        self._closed = True
        self._kill()

    def _start(self) -> None:
        if self._closed:
            raise WorkerDied
        self._process = subprocess.Popen(
            [sys.executable, "-c", _BOOT, json.dumps(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | dict.fromkeys(ONE_THREAD, "1"),
            # Ctrl-C is handled by this process.
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
            raise TimeLimitExceeded from None
        except (OSError, ValueError):  # the pipe is closed
            answer = None
        if answer is None:
            self._kill()
            raise WorkerDied
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
    """Pool of lanes, one for each call that runs at a time.

    Parameters
    ----------
    idle
        Seconds after which the process of an idle lane ends; None for never.
    """

    def __init__(self, idle: float | None = None) -> None:
        self._idle = idle
        self._lock = threading.Lock()
        self._free: list[Lane] = []
        self._every: list[Lane] = []
        self._closed = False

    def run(self, seconds: float, call: Callable[..., Any], *args: Any) -> Any:
        """Run a call in a free lane; see `Lane.run`."""
        with self._lock:
            if self._closed:
                raise WorkerDied
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


class TimedExecutor(StudyExecutor):
    """Executor in processes of this machine that are killed when a chunk exceeds its time limit.

    Parameters
    ----------
    width
        Number of processes.
    seconds
        Time limit of a chunk of samples, s.
    """

    def __init__(self, width: int, seconds: float) -> None:
        super().__init__()
        self.width = width
        self.timeout = seconds
        self._lanes = Lanes()

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Submit a call to a worker, which a thread waits for."""
        return super().submit(self._run, call, args)

    def _run(self, call: Callable[..., Any], args: tuple[Any, ...]) -> Any:
        assert self.timeout is not None
        return self._lanes.run(self.timeout, call, *args)  # the lanes exist when the workers have started

    def replace(self) -> None:
        """Do nothing: each lane replaces its own process."""

    def has_died(self, error: BaseException) -> bool:
        """Return whether the process of a call ended before the call."""
        return isinstance(error, WorkerDied)

    def _start(self) -> Executor:
        self._lanes = Lanes()
        return ThreadPoolExecutor(self.width)

    def _stop(self, executor: Executor) -> None:
        executor.shutdown(wait=False, cancel_futures=True)
        self._lanes.close()
        executor.shutdown(wait=True)


_OF_WORKER = Lanes(_IDLE)


def run_timed(seconds: float, call: Callable[..., Any], *args: Any) -> Any:
    """Run a call of a Dask worker in a child process with a time limit; see `Lane.run`."""
    return _OF_WORKER.run(seconds, call, *args)


def _ready() -> None:
    """Import what samples need."""
    import dynid.study.work  # noqa: F401


def serve() -> None:
    """Run calls from standard input, in the process of a lane."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1):
        os.dup2(nothing, descriptor)  # output of calls must not mix with replies
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
    """Queue messages until the other side has closed; then end this process, if it is `last`."""
    with stream:
        while len(head := stream.read(_LENGTH.size)) == _LENGTH.size:
            (length,) = _LENGTH.unpack(head)
            if len(message := stream.read(length)) < length:
                break
            arrived.put(message)
    if last:
        os._exit(0)
    arrived.put(None)
