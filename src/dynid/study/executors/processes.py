"""Executor in processes that run one call at a time, and are killed if it exceeds a time limit.

No standard pool would do (`docs/decisions/process_pool.md`): in `concurrent.futures` one process cannot end
without the others, and workers of Dask, which are daemons, may not have children of `multiprocessing`.
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

from dynid.study.executors.base import StudyExecutor, cores

#: Environment that limits linear algebra to one thread: the processes already share the cores.
ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)

_LENGTH = struct.Struct("<Q")
_BOOT = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from dynid.study.executors.processes import serve; serve()"
)
# Added to the limit of the first call, which imports modules: seconds, or this many
# times what the process took to start, if that is longer.
_WARM_UP_SECONDS, _WARM_UP_STARTS = 10.0, 5.0
_START_SECONDS = 600.0  # limit of the start of a process
_IDLE_SECONDS = 60.0  # until an idle process of a Dask worker ends


class TimeLimitExceeded(Exception):
    """A call exceeded its time limit."""


class WorkerDied(Exception):
    """The process of a call ended before the call."""


class Worker:
    """Process that runs one call at a time, and is replaced when it has ended."""

    def __init__(self) -> None:
        self.timer: threading.Timer | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._replies: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._completed: bytes | None = None  # a call that ended in time
        self._warm_up = 0.0
        self._closed = False

    def run(self, seconds: float | None, call: Callable[..., Any], *args: Any) -> Any:
        """Return the value of a call, or raise its exception.

        A new process first repeats a call that ended in time before, so that the time for imports does not
        count for the next call.

        Raises
        ------
        TimeLimitExceeded
            If the call takes longer than `seconds`, unless that is None. Its process is killed.
        WorkerDied
            If its process ends.
        """
        message = pickle.dumps((call, args))
        if self._process is None:
            self._start()
            if self._completed is not None and seconds is not None:
                try:
                    self._exchange(self._completed, seconds + self._warm_up)
                except (TimeLimitExceeded, WorkerDied):
                    self._completed = None
                    self._start()
        if seconds is not None and self._completed is None:
            seconds += self._warm_up
        done, answer = pickle.loads(self._exchange(message, seconds))
        if not done:
            raise answer
        if seconds is not None:
            self._completed = self._completed or message
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
        self._exchange(pickle.dumps((_ready, ())), _START_SECONDS)
        self._warm_up = max(_WARM_UP_SECONDS, _WARM_UP_STARTS * (time.monotonic() - began))

    def _exchange(self, message: bytes, seconds: float | None) -> bytes:
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


class WorkerPool:
    """Pool of workers, one for each call that runs at a time.

    Parameters
    ----------
    idle
        Seconds after which the process of an idle worker ends; default: never.
    """

    def __init__(self, idle: float | None = None) -> None:
        self._idle = idle
        self._lock = threading.Lock()
        self._free: list[Worker] = []
        self._workers: list[Worker] = []
        self._closed = False

    def run(self, seconds: float | None, call: Callable[..., Any], *args: Any) -> Any:
        """Run a call in a free worker; see `Worker.run`."""
        with self._lock:
            if self._closed:
                raise WorkerDied
            worker = self._free.pop() if self._free else Worker()
            if worker not in self._workers:
                self._workers.append(worker)
        if worker.timer is not None:
            worker.timer.cancel()
        try:
            return worker.run(seconds, call, *args)
        finally:
            with self._lock:
                self._free.append(worker)
            if self._idle is not None:
                worker.timer = threading.Timer(self._idle, self._retire, (worker,))
                worker.timer.daemon = True
                worker.timer.start()

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            self._closed = True
            workers = list(self._workers)
        for worker in workers:
            worker.close()

    def _retire(self, worker: Worker) -> None:
        with self._lock:
            if worker not in self._free:
                return
            self._free.remove(worker)
            self._workers.remove(worker)
        worker.close()


class ProcessExecutor(StudyExecutor):
    """Executor in processes of this machine.

    Parameters
    ----------
    workers
        Number of processes; default: one per core.
    timeout
        Time limit of a chunk of samples, s, whose process is killed then; default: no limit.
    """

    def __init__(self, workers: int | None = None, timeout: float | None = None) -> None:
        super().__init__()
        self.width = workers or cores()
        self.timeout = timeout
        self._pool = WorkerPool()

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Submit a call to a worker, which a thread waits for."""
        return super().submit(self._run, call, args)

    def _run(self, call: Callable[..., Any], args: tuple[Any, ...]) -> Any:
        return self._pool.run(self.timeout, call, *args)  # the pool exists when the threads have started

    def replace(self) -> None:
        """Do nothing: each worker replaces its own process."""

    def has_died(self, error: BaseException) -> bool:
        """Return whether the process of a call ended before the call."""
        return isinstance(error, WorkerDied)

    def _start(self) -> Executor:
        self._pool = WorkerPool()
        return ThreadPoolExecutor(self.width)

    def _stop(self, executor: Executor) -> None:
        executor.shutdown(wait=False, cancel_futures=True)
        self._pool.close()
        executor.shutdown(wait=True)


_DASK_POOL = WorkerPool(_IDLE_SECONDS)


def run_timed(seconds: float, call: Callable[..., Any], *args: Any) -> Any:
    """Run a call of a Dask worker in a child process with a time limit; see `Worker.run`."""
    return _DASK_POOL.run(seconds, call, *args)


def _ready() -> None:
    """Import what samples need."""
    import dynid.study.work  # noqa: F401


def serve() -> None:
    """Run calls from standard input, in the process of a worker."""
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
