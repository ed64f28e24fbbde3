"""Executor that runs samples on a Dask cluster."""

from __future__ import annotations

import logging
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from typing import Any

from dynid.errors import FileError, UsageError
from dynid.study.executors.base import StudyExecutor
from dynid.study.executors.processes import run_timed
from dynid.trial import ProcessDied

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
            return super().submit(run_timed, self.timeout, call, *args)
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


def configured_address() -> str | None:
    """Return the address of a scheduler from Dask's configuration; None if it names none."""
    if address := os.environ.get("DASK_SCHEDULER_ADDRESS"):
        return address
    try:
        import dask
    except ImportError:
        return None
    address_in_config = dask.config.get("scheduler-address", None)
    return None if address_in_config is None else str(address_in_config)
