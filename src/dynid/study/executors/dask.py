"""Samples on a Dask cluster."""

from __future__ import annotations

import logging
import math
import os
import time
from concurrent.futures import CancelledError, Executor
from typing import Any

from dynid.errors import FileError, UsageError
from dynid.study.executors.crew import Crew

_PATIENCE = 10.0  # seconds to find the scheduler, or to find it again
_ASK = 2.0  # seconds between two questions for the number of threads


class DaskCrew(Crew):
    """The workers of a Dask scheduler.

    Parameters
    ----------
    address
        Of the scheduler, such as `tcp://10.0.0.1:8786`.
    file
        The file in which the scheduler has written its address.
    workers
        How many of its threads to keep busy; absent: all.
    """

    def __init__(self, address: str | None, file: str | None, workers: int | None) -> None:
        super().__init__()
        if address is None and file is None:
            raise UsageError(
                "there is no scheduler to ask",
                remedy="Give --scheduler ADDRESS or --scheduler-file FILE, or set DASK_SCHEDULER_ADDRESS.",
            )
        self._where = address or str(file)
        self._options = {"address": address} if file is None else {"scheduler_file": file}
        self._workers = workers
        self._client: Any = None
        self._threads = 1
        self._asked = -math.inf

    @property
    def width(self) -> int:  # type: ignore[override]
        """How many threads the cluster has; workers may come and go."""
        if self._workers is not None or self._client is None:
            return self._workers or 1
        if time.monotonic() > self._asked + _ASK:
            try:
                self._threads = max(1, sum(self._client.nthreads().values()))
            except OSError as error:
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
        # What goes wrong is said once, in our words.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            self._client = Client(  # type: ignore[no-untyped-call]
                **self._options, timeout=_PATIENCE, set_as_default=False
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
            client.close(timeout=_PATIENCE)

    def replace(self) -> None:
        """Do nothing: the scheduler sees to its workers itself."""

    def has_died(self, error: BaseException) -> bool:
        """Tell whether every worker that was given a chunk died with it."""
        return type(error).__name__ == "KilledWorker"

    def refuse(self, error: BaseException) -> None:
        """Raise where the scheduler is gone."""
        lost = isinstance(error, CancelledError | OSError) or type(error).__name__ == "FutureCancelledError"
        if lost or (self._client is not None and self._client.status not in ("running", "connecting")):
            raise self._gone() from error

    def _gone(self) -> FileError:
        return FileError(
            f"the Dask scheduler at {self._where} does not answer",
            remedy="Start it, and run the study again: it goes on.",
        )


def configured_address() -> str | None:
    """Return the scheduler's address that Dask's own configuration names."""
    if address := os.environ.get("DASK_SCHEDULER_ADDRESS"):
        return address
    try:
        import dask
    except ImportError:
        return None
    found = dask.config.get("scheduler-address", None)
    return None if found is None else str(found)
