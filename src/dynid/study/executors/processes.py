"""Samples in processes of this machine."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait

from dynid.study.executors.executor_base import StudyExecutor

#: Environment that limits linear algebra to one thread: the processes share the cores already.
ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


class ProcessExecutor(StudyExecutor):
    """Processes, one for each core unless said otherwise.

    They are spawned, not forked: what runs in this process has no part in them.
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
        """Tell whether a worker was killed, which breaks the pool for all that it had."""
        return isinstance(error, BrokenProcessPool)


class _Pool(ProcessPoolExecutor):
    """A pool whose processes start with linear algebra held to one thread."""

    def submit(self, *args, **kwargs):  # type: ignore[no-untyped-def]
        with _one_thread():
            return super().submit(*args, **kwargs)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Have processes that start now inherit an environment of one thread, without keeping it here."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _begin() -> None:
    """Begin a worker: Ctrl-C is for the parent to answer, and with the parent it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    # A worker whose parent was killed would wait for work forever.
    wait([sentinel])
    os._exit(1)
