"""Executors of the samples of a study: their base class, in this process, and in processes beside it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from typing import Any

#: Environment that limits linear algebra to one thread: the processes already share the cores.
ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class StudyExecutor(ABC):
    """Executor of chunks of samples, with workers that are started and shut down as needed.

    Attributes
    ----------
    width
        Number of chunks that run at once.
    ahead
        Largest number of chunks that run or are queued for the next free worker.
    timeout
        Time limit of a chunk, s; None for no limit.
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

    def replace(self) -> None:
        """Replace the workers that died."""
        self.dismiss()

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

    def has_died(self, error: BaseException) -> bool:  # noqa: ARG002
        """Return whether an error of a call means that its worker died."""
        return False

    def trouble(self) -> str | None:
        """Return what prevents the workers from running; None for nothing."""
        return None

    def refuse(self, error: BaseException) -> None:  # noqa: B027
        """Raise an error of the whole executor, if an error of a call or of a submission indicates one."""


class _AtOnce(Executor):
    """Executor that runs a call when it is submitted."""

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


class ProcessExecutor(StudyExecutor):
    """Executor in spawned processes.

    Parameters
    ----------
    workers
        Number of processes; default one per core.
    """

    def __init__(self, workers: int | None = None) -> None:
        super().__init__()
        self.width = workers or cores()

    def _start(self) -> Executor:
        return _Pool(self.width, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)

    def _stop(self, executor: Executor) -> None:
        processes = list((getattr(executor, "_processes", None) or {}).values())
        executor.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        executor.shutdown(wait=True)

    def has_died(self, error: BaseException) -> bool:
        """Return whether a worker was killed, which breaks the whole pool."""
        return isinstance(error, BrokenProcessPool)


class _Pool(ProcessPoolExecutor):
    """Pool whose processes use one thread for linear algebra."""

    def submit(self, *args, **kwargs):  # type: ignore[no-untyped-def]
        # Processes that start now inherit the environment; this process restores its own.
        before = {name: os.environ.get(name) for name in ONE_THREAD}
        os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
        try:
            return super().submit(*args, **kwargs)
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


def _begin() -> None:
    """Initialize a worker: it ignores Ctrl-C, which the parent handles, and ends with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    # A worker whose parent was killed would wait for work forever.
    wait([sentinel])
    os._exit(1)
