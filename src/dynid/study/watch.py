"""Notices of what a study waits for: samples that take long, workers that are not there."""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from dynid.study.executors import StudyExecutor
    from dynid.study.plan import Plan
    from dynid.study.running import Notice

_LONG = 30.0  # s after which samples are named; then after twice as long, and so on


class Watch:
    """Chunks in progress, with their start times.

    Parameters
    ----------
    pool
        What runs samples.
    plan
        Their plan.
    notice
        Is given a sentence on what takes long; absent: nobody is.
    """

    def __init__(self, pool: StudyExecutor, plan: Plan, notice: Notice | None) -> None:
        self._crew, self._plan, self._notice = pool, plan, notice
        self._long = _LONG if pool.timeout is None else min(_LONG, pool.timeout / 2)
        self._trouble: str | None = None
        self._since: dict[Future[Any], float] = {}
        self._due: dict[Future[Any], float] = {}  # the age at which it is named next

    def look(self, flying: Mapping[Future[Any], NDArray[np.int64]]) -> None:
        """Give notice of what takes long, and of trouble of the executor that is new."""
        if self._notice is None or not flying:
            return
        trouble, before = self._crew.trouble(), self._trouble
        self._trouble = trouble
        if trouble is not None:
            if trouble != before:
                self._notice(trouble)
            self._since.clear()  # nothing runs
            return
        now = time.monotonic()
        running = list(flying)[: self._crew.width]  # the others wait for their turn
        self._since = {one: self._since.get(one, now) for one in running}
        self._due = {one: self._due.get(one, self._long) for one in running}
        for one in running:
            age = now - self._since[one]
            if age >= self._due[one]:
                self._due[one] = 2 * age
                self._notice(f"{self._named(flying[one])} been running for {age:.2g} s")

    def _named(self, numbers: NDArray[np.int64]) -> str:
        first, last = int(numbers[0]), int(numbers[-1])
        if len(numbers) > 1:
            return f"{len(numbers)} samples between {first} and {last} have"
        values = self._plan.overrides(numbers)[0]
        return f"sample {first} ({', '.join(f'{path}={value}' for path, value in values.items())}) has"
