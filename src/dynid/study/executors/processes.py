"""Executor in processes that run one call at a time, and are killed if it exceeds a time limit.

No standard pool would do (`docs/decisions/process_pool.md`): in `concurrent.futures` one process cannot end
without the others, and workers of Dask, which are daemons, may not have children of `multiprocessing`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from dynid.study.executors.base import StudyExecutor, cores
from dynid.trial import ONE_THREAD, ChildProcess, ProcessDied, TimeLimitExceeded

# Added to the limit of the first call, which imports modules: seconds, or this many
# times what the process took to start, if that is longer.
_WARM_UP_SECONDS, _WARM_UP_STARTS = 10.0, 5.0
_START_SECONDS = 600.0  # limit of the start of a process
_IDLE_SECONDS = 60.0  # until an idle process of a Dask worker ends


class Worker:
    """Process that runs one call at a time, and is replaced when it has ended."""

    def __init__(self) -> None:
        self.timer: threading.Timer | None = None
        self._process: ChildProcess | None = None
        self._completed: tuple[Callable[..., Any], tuple[Any, ...]] | None = None  # a call that ended in time
        self._warm_up = 0.0
        self._closed = False

    def run(self, seconds: float | None, call: Callable[..., Any], *args: Any) -> Any:
        """Return the value of a call, or raise its exception, as `ChildProcess.run` does.

        A new process first repeats a call that ended in time before, so that the time for imports does not
        count for the next call.
        """
        if self._process is None:
            self._start()
            if self._completed is not None and seconds is not None:
                with suppress(Exception):
                    self._exchange(seconds + self._warm_up, *self._completed)
                if self._process is None:
                    self._completed = None
                    self._start()
        if seconds is None:
            return self._exchange(None, call, args)
        answer = self._exchange(seconds + (0.0 if self._completed else self._warm_up), call, args)
        self._completed = self._completed or (call, args)
        return answer

    def close(self) -> None:
        """Kill the process, and start no other one."""
        self._closed = True
        process, self._process = self._process, None
        if process is not None:
            process.close()

    def _start(self) -> None:
        if self._closed:
            raise ProcessDied
        # The processes already share the cores.
        self._process = ChildProcess(ONE_THREAD)
        began = time.monotonic()
        self._exchange(_START_SECONDS, _ready, ())
        self._warm_up = max(_WARM_UP_SECONDS, _WARM_UP_STARTS * (time.monotonic() - began))

    def _exchange(self, seconds: float | None, call: Callable[..., Any], args: tuple[Any, ...]) -> Any:
        process = self._process
        if process is None:  # closed meanwhile
            raise ProcessDied
        try:
            return process.run(seconds, call, *args)
        except (TimeLimitExceeded, ProcessDied):
            self._process = None
            raise


class WorkerPool:
    """Pool of workers, one for each call that runs at a time; idle ones end after `idle` seconds."""

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
                raise ProcessDied
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
    """Executor in processes of this machine, by default one per core, with a time limit of a chunk, s."""

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

    def has_died(self, error: BaseException) -> bool:
        """Return whether the process of a call ended before the call."""
        return isinstance(error, ProcessDied)

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
