"""Executor that runs samples in processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait

from dynid.study.executors.base import ONE_THREAD, StudyExecutor, cores


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
