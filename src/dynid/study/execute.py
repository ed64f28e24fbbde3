"""A study from its scene to its file, in as many goes as it takes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NumericalError
from dynid.scene.outcomes import Block, Outcomes
from dynid.study.drive import Chunk, drive
from dynid.study.file import Heading, write_study
from dynid.study.journal import Journal
from dynid.study.keys import Keys, as_texts, found_in, sample_keys
from dynid.study.lock import locked
from dynid.study.packing import packed
from dynid.study.stored import open_study
from dynid.study.work import Job

if TYPE_CHECKING:
    from dynid.study.executors import Crew
    from dynid.study.plan import Plan


@dataclass(frozen=True)
class Progress:
    """How far a study is.

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


class TooManyFailures(NumericalError):
    """More samples failed than were to be tolerated."""


def shard_of(plan: Plan, shard: tuple[int, int] | None) -> range:
    """Return the numbers of the samples of shard I of N (from 1), or of the whole plan."""
    if shard is None:
        return range(plan.size)
    index, count = shard
    return range(index - 1, plan.size, count)


def run_study(
    plan: Plan,
    target: str | os.PathLike[str],
    crew: Crew,
    *,
    shard: tuple[int, int] | None = None,
    max_failures: int | None = None,
    retry_failed: bool = False,
    report: Report | None = None,
) -> Progress:
    """Run what is not finished of a study, and write its file.

    Whatever interrupts it, every sample that was reported as finished is safe in `<target>.journal`, and
    the next call goes on from there.

    Parameters
    ----------
    plan
        The study's plan.
    target
        The HDF5 file.
    crew
        What runs samples; see `dynid.study.executors.hire`. It is dismissed at the end.
    shard
        (I, N): run every Nth sample only, from the Ith (from 1).
    max_failures
        How many samples may fail; absent: any number.
    retry_failed
        Whether samples that failed before are run again.
    report
        Is told how far the study is.

    Returns
    -------
    Progress
        How far it is: all is finished.

    Raises
    ------
    TooManyFailures
        When more than `max_failures` samples fail; the rest are pending in the file then.
    FileError
        When the file cannot be written, is another study's at the moment, or holds something else.
    KeyboardInterrupt
        As it came; the file has been written with pending samples.
    """
    name = os.fspath(target)
    numbers = shard_of(plan, shard)
    with ExitStack() as stack:
        stack.enter_context(locked(name))
        stack.callback(crew.dismiss)
        heading = heading_of(plan, numbers, sample_keys(plan, numbers))
        done = _finished_file(name, heading) if not retry_failed else None
        if done is not None:
            Journal.discard(journal_name(name))
            if report is not None:
                report(done)
            return _judged(done, max_failures)
        journal = Journal(journal_name(name))
        stack.callback(journal.close)
        _import(name, heading.keys, journal, retry_failed)
        run = _Run(plan, numbers, heading, journal, max_failures, report, retry_failed)
        try:
            run.go(crew)
        except (KeyboardInterrupt, TooManyFailures):
            crew.dismiss()
            write_study(name, heading, run, complete=run.is_complete)
            raise
        write_study(name, heading, run)
        Journal.discard(journal.path)
        return run.progress


def journal_name(target: str) -> str:
    """Return the name of the journal of a study's file."""
    return f"{target}.journal"


def heading_of(plan: Plan, numbers: range, keys: Keys) -> Heading:
    """Return what the file of a plan, or of a shard of it, says beside the outcomes."""
    rows = np.arange(plan.size)[numbers.start :: numbers.step]
    return Heading(
        title=plan.study.title,
        text=plan.study.source.resolved_text(),
        base=plan.base.source.resolved_text(),
        seed=plan.seed,
        numbers=np.asarray(rows, dtype=np.int64),
        columns={path: values[rows] for path, values in plan.arrays.items()},
        keys=keys,
        attrs={**plan.attrs, "plan": _digest(plan)},
        folder=str(plan.base.folder.resolve()),
    )


def _digest(plan: Plan) -> str:
    """Return what tells the shards of one study from those of another."""
    made = hashlib.sha256(plan.base.source.resolved_text().encode())
    made.update(plan.study.source.resolved_text().encode())
    return made.hexdigest()[:32]


def _finished_file(name: str, heading: Heading) -> Progress | None:
    """Return how far a file is that holds all of this study already; None where something is missing."""
    if not Path(name).exists():
        return None
    with open_study(name) as study:
        same = (
            study.result.attrs.get("scene") == heading.text
            and np.array_equal(study.numbers, heading.numbers)
            and np.all(study.exit_codes >= 0)
            and np.array_equal(study.keys, heading.keys)
        )
        count = len(study)
        return Progress(count, count, int(np.sum(study.exit_codes > 0)), count) if same else None


def _judged(progress: Progress, max_failures: int | None) -> Progress:
    """Return how far a study is, unless too much of it failed."""
    if max_failures is not None and progress.failed > max_failures:
        raise TooManyFailures(
            f"{progress.failed} samples failed, more than the {max_failures} of --max-failures",
            remedy="Their errors are in study/error.",
        )
    return progress


def _import(name: str, keys: Keys, journal: Journal, retry_failed: bool) -> None:
    """Bring what is still valid of an older file into the journal."""
    if not Path(name).exists():
        return
    with open_study(name) as study:
        valid = (found_in(keys, study.keys) >= 0) & (journal.numbers(study.keys) < 0)
        valid &= (study.exit_codes == 0) if retry_failed else (study.exit_codes >= 0)
        step = study.rows_at_a_time
        for start in range(0, len(study) if valid.any() else 0, step):
            rows = start + np.flatnonzero(valid[start : start + step])
            if len(rows):
                blocks = [
                    part for block in study.between(start, start + step) if (part := _those(block, rows))
                ]
                journal.append([(study.keys[rows], packed(Outcomes(blocks, len(rows))))])


def _those(block: Block, rows: NDArray[np.intp]) -> Block | None:
    """Return the samples of a block that stand in rows, numbered by these rows."""
    _, places, wanted = np.intersect1d(block.rows, rows, return_indices=True)
    return block.taken(places, wanted) if len(places) else None


class _Run:
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

    def between(self, start: int, stop: int) -> Iterator[Block]:
        """Yield the samples of rows start … stop - 1, one record of the journal at a time."""
        where = self.where[self.one[start:stop]]
        there = np.flatnonzero(where >= 0)
        return self.journal.blocks(where[there], there + start)

    @property
    def progress(self) -> Progress:
        finished, failed = self._count(self.where >= 0), self._count(self.failed)
        return Progress(len(self.keys), finished, failed, self.kept)

    @property
    def is_complete(self) -> bool:
        return bool(np.all(self.where >= 0))

    def _count(self, which: NDArray[np.bool_]) -> int:
        return int(self.copies[which].sum())

    def go(self, crew: Crew) -> None:
        """Run what is not finished."""
        self._tell()
        todo = np.sort(self.first[self.where < 0])
        if len(todo):
            job = Job.of(self.plan.base, self.plan.collect, self.plan.size)
            drive(crew, job, self.plan, self.numbers.start + todo * self.numbers.step, self._arrived)

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
        _judged(progress, self.max_failures)


def valid_samples(plan: Plan, target: str | os.PathLike[str], shard: tuple[int, int] | None = None) -> int:
    """Return how many samples of a plan are finished already, in a file and its journal.

    Nothing is changed, and no lock is needed.
    """
    name = os.fspath(target)
    keys = sample_keys(plan, shard_of(plan, shard))
    finished = np.zeros(len(keys), dtype=bool)
    if Path(name).exists():
        with open_study(name) as study:
            finished |= found_in(study.keys[study.exit_codes >= 0], keys) >= 0
    if Path(journal_name(name)).exists():
        finished |= found_in(Journal.read_keys(journal_name(name)), keys) >= 0
    return int(finished.sum())
