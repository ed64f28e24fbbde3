"""Executors of the samples of a study: their base class, and the one in this process."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


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

    def has_died(self, error: BaseException) -> bool:  # noqa: ARG002
        """Return whether an error of a call means that its worker died."""
        return False

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
