"""Samples in this process, one after another."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from dynid.study.executors.executor_base import StudyExecutor


class _AtOnce(Executor):
    """Runs a call when it is submitted."""

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(call(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class SerialExecutor(StudyExecutor):
    """The process that the study runs in."""

    @property
    def ahead(self) -> int:
        """One chunk: it is done when it has been submitted."""
        return 1

    def _start(self) -> Executor:
        return _AtOnce()
