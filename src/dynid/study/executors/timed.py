"""Samples in processes of this machine that are killed where a sample takes too long."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

from dynid.study.executors.executor_base import StudyExecutor
from dynid.study.executors.lanes import Died, Lanes


class TimedExecutor(StudyExecutor):
    """Processes with a time limit.

    Parameters
    ----------
    width
        How many.
    seconds
        How long a chunk of samples may take.
    """

    def __init__(self, width: int, seconds: float) -> None:
        super().__init__()
        self.width = width
        self.timeout = seconds
        self._lanes = Lanes()

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Have a call run by a worker, which a thread waits for."""
        return super().submit(self._run, call, args)

    def replace(self) -> None:
        """Do nothing: each process is replaced by itself."""

    def has_died(self, error: BaseException) -> bool:
        """Tell whether the process of a call ended with it."""
        return isinstance(error, Died)

    def _run(self, call: Callable[..., Any], args: tuple[Any, ...]) -> Any:
        assert self.timeout is not None
        return self._lanes.run(self.timeout, call, *args)

    def _start(self) -> Executor:
        self._lanes = Lanes()
        return ThreadPoolExecutor(self.width)

    def _stop(self, executor: Executor) -> None:
        executor.shutdown(wait=False, cancel_futures=True)
        self._lanes.close()
        executor.shutdown(wait=True)
