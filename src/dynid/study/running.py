"""One go at a study: what is finished and safe, what is left, and when too much of it failed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NumericalError
from dynid.scene.outcomes import SampleBlock
from dynid.study.file import Heading
from dynid.study.journal import Journal
from dynid.study.keys import as_texts
from dynid.study.scheduler import Chunk, drive
from dynid.study.work import Job

if TYPE_CHECKING:
    from dynid.study.executors import StudyExecutor
    from dynid.study.plan import Plan


@dataclass(frozen=True)
class Progress:
    """Progress of a study.

    Parameters
    ----------
    total
        Its samples.
    finished
        Those that are finished, and safe.
    failed
        Those among them that failed.
    kept
        Those among them that were finished when this run of it began.
    """

    total: int
    finished: int
    failed: int
    kept: int


Report = Callable[[Progress], None]
Notice = Callable[[str], None]


class TooManyFailures(NumericalError):
    """More samples failed than were to be tolerated."""


def judged(progress: Progress, max_failures: int | None) -> Progress:
    """Return how far a study is, unless too much of it failed."""
    if max_failures is not None and progress.failed > max_failures:
        raise TooManyFailures(
            f"{progress.failed} samples failed, more than the {max_failures} of --max-failures",
            remedy="Their errors are in study/error.",
        )
    return progress


class Run:
    """One go at a study; also its outcomes, in the order of the plan.

    Samples with one key are one: what becomes of the first is what became of all.
    """

    def __init__(
        self,
        plan: Plan,
        numbers: range,
        heading: Heading,
        journal: Journal,
        max_failures: int | None,
        report: Report | None,
        retry_failed: bool,
    ) -> None:
        self.plan = plan
        self.numbers = numbers
        self.journal = journal
        self.max_failures = max_failures
        self.report = report
        _, first, self.one, self.copies = np.unique(
            as_texts(heading.keys), return_index=True, return_inverse=True, return_counts=True
        )
        self.first = first  # the row of the first of those that are one
        self.keys = heading.keys
        self.where = journal.numbers(heading.keys[first])  # in the journal; -1: not finished
        self.failed = np.zeros(len(first), dtype=bool)
        known = self.where >= 0
        self.failed[known] = journal.failed[self.where[known]]
        if retry_failed:
            self.where[self.failed], self.failed[:] = -1, False
        self.kept = self._count(self.where >= 0)

    def between(self, start: int, stop: int) -> Iterator[SampleBlock]:
        """Yield the samples of rows start … stop - 1, one record of the journal at a time."""
        where = self.where[self.one[start:stop]]
        there = np.flatnonzero(where >= 0)
        return self.journal.blocks(where[there], there + start)

    @property
    def progress(self) -> Progress:
        """Progress so far."""
        finished, failed = self._count(self.where >= 0), self._count(self.failed)
        return Progress(len(self.keys), finished, failed, self.kept)

    @property
    def is_complete(self) -> bool:
        """True if all samples are finished."""
        return bool(np.all(self.where >= 0))

    def _count(self, which: NDArray[np.bool_]) -> int:
        return int(self.copies[which].sum())

    def go(self, pool: StudyExecutor, notice: Notice | None = None) -> None:
        """Run what is not finished."""
        self._tell()
        todo = np.sort(self.first[self.where < 0])
        if len(todo):
            job = Job.of(self.plan.base, self.plan.collect, self.plan.size)
            drive(pool, job, self.plan, self.numbers.start + todo * self.numbers.step, self._arrived, notice)

    def _arrived(self, chunks: list[Chunk]) -> None:
        rows = [(numbers - self.numbers.start) // self.numbers.step for numbers, _ in chunks]
        place = self.journal.append(
            [(self.keys[own], outcomes) for own, (_, outcomes) in zip(rows, chunks, strict=True)]
        )
        for own, (_, outcomes) in zip(rows, chunks, strict=True):
            ones = self.one[own]
            self.where[ones] = np.arange(place, place + len(own))
            self.failed[ones] = outcomes.failed
            place += len(own)
        self._tell()

    def _tell(self) -> None:
        progress = self.progress
        if self.report is not None:
            self.report(progress)
        judged(progress, self.max_failures)
