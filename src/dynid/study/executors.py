"""Executors of samples: in this process, in several processes, or on a Dask cluster.

Processes run one call at a time, and are killed if it exceeds a time limit. No standard pool would do
(`docs/decisions/process_pool.md`): in `concurrent.futures` one process cannot end without the others, and
workers of Dask, which are daemons, may not have children of `multiprocessing`.
"""

from __future__ import annotations

import logging
import math
import os
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from dynid.errors import FileError, UsageError
from dynid.trial import ONE_THREAD, ChildProcess, ProcessDied, TimeLimitExceeded


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class StudyExecutor(ABC):
    """Executor of chunks of samples, with workers that are started and shut down as needed.

    `width` chunks run at once; a chunk may have a time limit, s.
    """

    width: int = 1
    timeout: float | None = None

    def __init__(self) -> None:
        self._executor: Executor | None = None

    @property
    def ahead(self) -> int:
        """Maximum number of chunks submitted at a time."""
        return 2 * self.width

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Submit a call to a worker."""
        if self._executor is None:
            self._executor = self._start()
        return self._executor.submit(call, *args)

    def dismiss(self) -> None:
        """Shut down all workers, also those that run."""
        if self._executor is not None:
            executor, self._executor = self._executor, None
            self._stop(executor)

    @abstractmethod
    def _start(self) -> Executor:
        """Start the workers."""

    def _stop(self, executor: Executor) -> None:
        executor.shutdown(wait=False, cancel_futures=True)

    def start(self) -> None:
        """Start the workers, where they will be needed."""
        self.prepare(_ready)

    def prepare(self, call: Callable[..., Any], *args: Any) -> None:  # noqa: B027
        """Prepare each worker by a call, whatever becomes of it."""

    def has_died(self, error: BaseException) -> bool:  # noqa: ARG002
        """Return whether an error of a call means that its worker died."""
        return False

    def expect(self, seconds: float) -> None:  # noqa: B027
        """Take note of the time that the samples that are left would take in one process, s."""

    def trouble(self) -> str | None:
        """Return what prevents the workers from running; None for nothing."""
        return None

    def refuse(self, error: BaseException) -> None:  # noqa: B027
        """Raise an error of the whole executor, if an error of a call or of a submission indicates one."""


class _AtOnce(Executor):
    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(call(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class SerialExecutor(StudyExecutor):
    """Executor in the process that the study runs in, one sample after another."""

    @property
    def ahead(self) -> int:
        """One chunk, which is finished when it has been submitted."""
        return 1

    def _start(self) -> Executor:
        return _AtOnce()


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
        if self._closed:  # meanwhile
            self.close()
            raise ProcessDied
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

    def prepare(self, call: Callable[..., Any], *args: Any) -> None:
        """Prepare the workers while this process reads the scene; with a time limit the first chunk does."""
        if self.timeout is None:
            for _ in range(self.width):
                self.submit(call, *args)

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


# Samples that take less time in one process, s, are left in this one: starting others takes a second of each.
_MIN_SECONDS_FOR_PROCESSES = 3.0


class AutoExecutor(ProcessExecutor):
    """Executor in this process, and in several where so much is left to do that they are faster.

    Until they have started, this process goes on with the samples.
    """

    def __init__(self) -> None:
        super().__init__()
        self._at_once = _AtOnce()
        self._starts: list[Future[Any]] = []
        self._first: tuple[Callable[..., Any], tuple[Any, ...]] = _ready, ()  # call of a process

    @property
    def ahead(self) -> int:
        """One chunk in this process, which is finished when it has been submitted; then as of processes."""
        return 1 if self._is_alone else super().ahead

    @property
    def _is_alone(self) -> bool:
        return not self._starts or not all(start.done() for start in self._starts)

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Run a call, or submit it to a worker."""
        return self._at_once.submit(call, *args) if self._is_alone else super().submit(call, *args)

    def prepare(self, call: Callable[..., Any], *args: Any) -> None:
        """Take note of the call that prepares processes, if they are started."""
        self._first = call, args

    def expect(self, seconds: float) -> None:
        """Start processes, if so much is left to do."""
        if not self._starts and seconds > _MIN_SECONDS_FOR_PROCESSES:
            start, (call, args) = super().submit, self._first
            self._starts = [start(call, *args) for _ in range(self.width)]


_DASK_POOL = WorkerPool(_IDLE_SECONDS)


def _run_timed(seconds: float, call: Callable[..., Any], *args: Any) -> Any:
    """Run a call of a Dask worker in a child process with a time limit; see `Worker.run`."""
    return _DASK_POOL.run(seconds, call, *args)


def _ready() -> None:
    """Import what samples need."""
    import dynid.study.work  # noqa: F401


_CONNECT_SECONDS = 10.0  # seconds to connect to the scheduler
_TALKATIVE = ("distributed", "tornado", "asyncio")  # loggers
_QUERY_SECONDS = 2.0  # seconds between two queries of the number of threads


class DaskExecutor(StudyExecutor):
    """Executor with the workers of a Dask scheduler at an address, or at that in a file.

    It uses `workers` threads of the cluster, by default all, with a time limit of a chunk, s.
    """

    def __init__(
        self, address: str | None, file: str | None, workers: int | None, timeout: float | None = None
    ) -> None:
        super().__init__()
        self.timeout = timeout
        if address is None and file is None:
            raise UsageError(
                "there is no scheduler to ask",
                remedy="Give --scheduler ADDRESS or --scheduler-file FILE, or set DASK_SCHEDULER_ADDRESS.",
            )
        self._where = address or str(file)
        self._options = {"address": address} if file is None else {"scheduler_file": file}
        self._workers = workers
        self._client: Any = None
        self._threads = 0
        self._asked = -math.inf

    @property
    def width(self) -> int:  # type: ignore[override]
        """Number of threads of the cluster, which changes as workers join and leave."""
        return max(1, self._workers or self._counted())

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Submit a call to a worker; with a time limit, it runs in a child process of the worker."""
        if self.timeout is not None:
            return super().submit(_run_timed, self.timeout, call, *args)
        return super().submit(call, *args)

    def trouble(self) -> str | None:
        """Return a sentence if the scheduler has no workers."""
        if self._client is None or self._counted():
            return None
        return f"the Dask scheduler at {self._where} has no workers; the study waits for the first one"

    def _counted(self) -> int:
        """Return the number of threads of the cluster, queried every few seconds."""
        if self._client is not None and time.monotonic() > self._asked + _QUERY_SECONDS:
            try:
                self._threads = sum(self._client.nthreads().values())
            except (OSError, TimeoutError, CancelledError) as error:
                raise self._gone() from error
            self._asked = time.monotonic()
        return self._threads

    def _start(self) -> Executor:
        try:
            from distributed import Client
        except ImportError:
            raise UsageError(
                "the executor 'dask' needs the package distributed",
                remedy="Install it with: pip install 'dynid[cluster]'",
            ) from None
        # Our sentence replaces the tracebacks that Dask logs; its loggers have their own levels.
        for name in [*logging.root.manager.loggerDict, *_TALKATIVE]:
            if name.partition(".")[0] in _TALKATIVE:
                logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        try:
            self._client = Client(  # type: ignore[no-untyped-call]
                **self._options, timeout=_CONNECT_SECONDS, set_as_default=False
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise self._gone() from error
        executor: Executor = self._client.get_executor(pure=False)
        return executor

    def _stop(self, executor: Executor) -> None:
        client, self._client = self._client, None
        try:
            executor.shutdown(wait=False)
        finally:
            client.close(timeout=_CONNECT_SECONDS)

    def has_died(self, error: BaseException) -> bool:
        """Return whether every worker that ran a chunk died with it."""
        return isinstance(error, ProcessDied) or type(error).__name__ == "KilledWorker"

    def refuse(self, error: BaseException) -> None:
        """Raise an error if the scheduler is lost."""
        lost = isinstance(error, CancelledError | OSError) or type(error).__name__ == "FutureCancelledError"
        if lost or (self._client is not None and self._client.status not in ("running", "connecting")):
            raise self._gone() from error

    def _gone(self) -> FileError:
        return FileError(
            f"the Dask scheduler at {self._where} does not answer",
            remedy="Start it, and run the study again to resume it.",
        )


def _configured_address() -> str | None:
    """Return the address of a scheduler from Dask's configuration; None if it names none."""
    if address := os.environ.get("DASK_SCHEDULER_ADDRESS"):
        return address
    # Dask is imported, for half a second, only if a file of its configuration names a scheduler.
    paths = [
        Path(os.environ.get("DASK_ROOT_CONFIG", "/etc/dask")),
        Path(sys.prefix) / "etc" / "dask",
        Path(os.environ.get("DASK_CONFIG", "~/.config/dask")).expanduser(),
    ]
    files = [file for path in paths for file in ([path] if path.is_file() else path.glob("*.y*ml"))]
    if not any("scheduler" in file.read_text(encoding="utf-8", errors="replace") for file in files):
        return None
    try:
        import dask
    except ImportError:
        return None
    address_in_config = dask.config.get("scheduler-address", None)
    return None if address_in_config is None else str(address_in_config)


__all__ = ["EXECUTORS", "StudyExecutor", "make_executor"]

EXECUTORS = ("serial", "processes", "dask")


def make_executor(
    executor: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    scheduler_file: str | None = None,
    sample_timeout: float | None = None,
) -> StudyExecutor:
    """Return the executor of the samples of a study: `serial`, `processes` or `dask`.

    By default it is `dask` if a scheduler is named here (its address, or the file with its address) or in
    Dask's configuration (such as DASK_SCHEDULER_ADDRESS), else `processes`, which are started once their
    samples are seen to take longer than these would. `workers` is the number of processes, by default one per
    core; on a cluster, the number of its threads to use. With a time limit of a sample (s), `serial` runs
    samples in a second process, which can be killed.

    Raises
    ------
    UsageError
        If these are contradictory, or no scheduler is named.
    """
    if scheduler and scheduler_file:
        raise UsageError("--scheduler and --scheduler-file name two schedulers", remedy="Give one of them.")
    named = scheduler or scheduler_file
    if executor is None:
        executor = "dask" if named or _configured_address() else "processes"
        if executor == "processes" and workers is None and sample_timeout is None and cores() > 1:
            return AutoExecutor()
    if executor != "dask" and named:
        raise UsageError(
            f"a scheduler is of no use to the executor '{executor}'", remedy="Use --executor dask."
        )
    if executor == "dask":
        return DaskExecutor(scheduler or _configured_address(), scheduler_file, workers, sample_timeout)
    if executor == "processes" or sample_timeout is not None:
        return ProcessExecutor(1 if executor == "serial" else workers, sample_timeout)
    return SerialExecutor()
