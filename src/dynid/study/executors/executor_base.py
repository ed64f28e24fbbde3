"""Base class of the executors that run the samples of a study."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class StudyExecutor(ABC):
    """Executor of chunks of samples, with workers that are started and shut down as needed.

    Attributes
    ----------
    width
        How many chunks run at once.
    ahead
        How many chunks are under way at most: those that run, and those that wait for the next free worker.
    timeout
        How long a chunk may take, s; None: any time.
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
        """Have a call run by a worker."""
        if self._executor is None:
            self._executor = self._start()
        return self._executor.submit(call, *args)

    def replace(self) -> None:
        """Take new workers for those that died."""
        self.dismiss()

    def dismiss(self) -> None:
        """Let all workers go, whatever they are at."""
        if self._executor is not None:
            executor, self._executor = self._executor, None
            self._stop(executor)

    @abstractmethod
    def _start(self) -> Executor:
        """Return what runs calls."""

    def _stop(self, executor: Executor) -> None:
        executor.shutdown(wait=False, cancel_futures=True)

    def has_died(self, error: BaseException) -> bool:  # noqa: ARG002
        """Tell whether an error of a call says that its worker died."""
        return False

    def trouble(self) -> str | None:
        """Say what keeps the workers from their work at the moment."""
        return None

    def refuse(self, error: BaseException) -> None:  # noqa: B027
        """Raise what an error of a call or of a submission says of the whole pool, if it does."""
