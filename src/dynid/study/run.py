"""Runs of a study: from its plan to its file, resumed after interruptions; and their explanation."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError, NumericalError, UsageError
from dynid.number_format import counted
from dynid.progress import report_progress
from dynid.scene.batch import why_alone
from dynid.scene.explanation import (
    Cost,
    Explanation,
    Fact,
    explain,
    file_kilobytes,
    peak_megabytes,
)
from dynid.scene.outcomes import SampleBlock, SampleOutcomes
from dynid.study.executors import cores
from dynid.study.file import StudyHeading, locked, write_study
from dynid.study.journal import Journal
from dynid.study.keys import SIZE, Keys, as_texts, found_in, sample_keys
from dynid.study.plan import Plan
from dynid.study.scheduler import Chunk, Notice, Scheduler
from dynid.study.stored import open_study
from dynid.study.work import Job, packed, prepare, run_chunk, unpacked

if TYPE_CHECKING:
    from dynid.study.executors import StudyExecutor


@dataclass(frozen=True)
class Progress:
    """Progress of a study in numbers of samples."""

    total: int
    finished: int  # and stored
    failed: int  # of the finished ones
    kept: int  # finished before this run began


#: Receiver of the progress of a study.
Report = Callable[[Progress], None]


class TooManyFailures(NumericalError):
    """More samples failed than `max_failures`."""


def judged(progress: Progress, max_failures: int | None) -> Progress:
    """Return the progress of a study; raise `TooManyFailures` if more samples failed than allowed."""
    if max_failures is not None and progress.failed > max_failures:
        raise TooManyFailures(
            f"{counted(progress.failed, 'sample')} failed, more than the {max_failures} of --max-failures",
            remedy="Their errors are in study/error.",
        )
    return progress


@dataclass
class Run:
    """One run of a study, and its outcomes in the order of the plan.

    Of samples with equal keys, only the first is run; all have its outcome.
    """

    plan: Plan
    numbers: range
    heading: StudyHeading
    journal: Journal
    max_failures: int | None
    report: Report | None
    retry_failed: bool

    def __post_init__(self) -> None:
        heading, journal = self.heading, self.journal
        _, first, self.one = np.unique(as_texts(heading.keys), return_index=True, return_inverse=True)
        self.first = first  # row of the first sample of each key
        self.keys = heading.keys
        self.where = journal.numbers(heading.keys[first])  # in the journal; -1: not finished
        self.failed = np.zeros(len(first), dtype=bool)
        finished = self.where >= 0
        self.failed[finished] = journal.failed[self.where[finished]]
        if self.retry_failed:
            self.where[self.failed], self.failed[:] = -1, False
        self.kept = self._count(self.where >= 0)

    def between(self, start: int, stop: int) -> Iterator[SampleBlock]:
        """Yield the finished samples of rows start … stop - 1, one record of the journal at a time."""
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
        return int(np.count_nonzero(which[self.one]))

    def go(self, pool: StudyExecutor, notice: Notice | None = None) -> None:
        """Run the samples that are not finished."""
        self._report()
        todo = np.sort(self.first[self.where < 0])
        if len(todo):
            job = Job.of(self.plan.base, self.plan.collect)
            numbers = self.numbers.start + todo * self.numbers.step
            Scheduler(pool, job, self.plan, numbers, self._store, notice).run()

    def _store(self, chunks: list[Chunk]) -> None:
        """Append finished chunks to the journal."""
        rows = [(numbers - self.numbers.start) // self.numbers.step for numbers, _ in chunks]
        number = self.journal.append(
            [
                (self.keys[rows_of_chunk], outcomes)
                for rows_of_chunk, (_, outcomes) in zip(rows, chunks, strict=True)
            ]
        )
        for rows_of_chunk, (_, outcomes) in zip(rows, chunks, strict=True):
            ones = self.one[rows_of_chunk]
            self.where[ones] = np.arange(number, number + len(rows_of_chunk))
            self.failed[ones] = outcomes.failed
            number += len(rows_of_chunk)
        self._report()

    def _report(self) -> None:
        progress = self.progress
        if self.report is not None:
            self.report(progress)
        judged(progress, self.max_failures)


def shard_of(plan: Plan, shard: tuple[int, int] | None) -> range:
    """Return the numbers of the samples of shard I of N (from 1), or of the whole plan."""
    if shard is None:
        return range(plan.size)
    index, count = shard
    return range(index - 1, plan.size, count)


def run_study(
    plan: Plan,
    target: str | os.PathLike[str],
    pool: StudyExecutor,
    *,
    shard: tuple[int, int] | None = None,
    max_failures: int | None = None,
    retry_failed: bool = False,
    force: bool = False,
    report: Report | None = None,
    notice: Notice | None = None,
) -> Progress:
    """Run the samples of a study that are not finished, write its file, and return the progress at the end.

    Every sample that was reported as finished is stored in `<target>.journal`; after an interruption, the
    next call resumes from there. `pool` is shut down at the end. `shard` is (I, N): only every Nth sample is
    run, from the Ith (counted from 1). `retry_failed` runs samples again that failed before; `force` discards
    finished samples of the file that do not belong to this study. `report` is called with the progress,
    `notice` with sentences for the user: a damaged journal, samples that take long.

    Raises
    ------
    TooManyFailures
        If more than `max_failures` samples fail; the others are pending in the file.
    UsageError
        If the file holds finished samples that do not belong to this study.
    FileError
        If the file cannot be written, is being written by another study, or is no file of a study.
    KeyboardInterrupt
        If interrupted; the file has been written with pending samples.
    """
    name = os.fspath(target)
    numbers = shard_of(plan, shard)
    with ExitStack() as stack:
        stack.enter_context(locked(name))
        stack.callback(pool.dismiss)
        pool.prepare(prepare, Job.of(plan.base, plan.collect), tuple(plan.settings))
        heading = heading_of(plan, numbers, sample_keys(plan, numbers))
        if not force and (foreign := foreign_samples(name, heading.keys)):
            raise UsageError(
                f"{name} holds {counted(foreign, 'finished sample')} that "
                f"{'does' if foreign == 1 else 'do'} not belong to this study, and would be lost",
                remedy="Write another file with -o, or discard them with --force.",
                names=[name],
            )
        done = _finished_file(name, heading) if not retry_failed else None
        if done is not None:
            Journal.discard(journal_name(name))
            if report is not None:
                report(done)
            return judged(done, max_failures)
        journal = Journal(journal_name(name))
        stack.callback(journal.close)
        if journal.damage_text and notice is not None:
            notice(journal.damage_text)
        _import(name, heading.keys, journal, retry_failed)
        run = Run(plan, numbers, heading, journal, max_failures, report, retry_failed)
        try:
            run.go(pool, notice)
        except (KeyboardInterrupt, TooManyFailures):
            pool.dismiss()
            _write(name, heading, run, complete=run.is_complete)
            raise
        _write(name, heading, run)
        journal.close()  # Windows removes no open file
        Journal.discard(journal.path)
        return run.progress


def _write(name: str, heading: StudyHeading, run: Run, complete: bool = True) -> None:
    """Write the file; an error of it mentions the journal that holds the finished samples."""
    try:
        write_study(name, heading, run.between, complete)
    except FileError as error:
        remedy = (
            f"{run.journal.path} holds {counted(run.progress.finished, 'finished sample')}. "
            "Free space on the disk, or repair it, and run the study again to resume it."
        )
        raise FileError(error.problem, remedy=remedy, names=error.names) from error


def foreign_samples(name: str, keys: Keys) -> int:
    """Return the number of finished samples of a file and its journal that have none of these keys.

    Failed samples of the file hold nothing that would be lost, and are not counted.
    """
    return int(np.sum(found_in(keys, _finished(name, failed=False)) < 0))


def _finished(name: str, *, failed: bool = True) -> Keys:
    """Return the distinct keys of the finished samples of a file and its journal."""
    keys = [np.empty((0, SIZE), np.uint8)]
    if Path(name).exists():
        keys.append(finished_keys(name, failed=failed))
    if Path(journal_name(name)).exists():
        keys.append(Journal.read_keys(journal_name(name)))
    return np.unique(np.concatenate(keys), axis=0)


def finished_keys(name: str, *, failed: bool = True) -> Keys:
    """Return the keys of the finished samples of a file, with or without the failed ones."""
    with open_study(name) as study:
        if study.keys.shape[1] != SIZE:
            raise ValueError("keys of another length")
        return study.keys[(study.exit_codes >= 0) if failed else (study.exit_codes == 0)]


def journal_name(target: str) -> str:
    """Return the name of the journal of a study's file."""
    return f"{target}.journal"


def heading_of(plan: Plan, numbers: range, keys: Keys) -> StudyHeading:
    """Return the heading of the file of a plan, or of a shard of it."""
    digest = hashlib.sha256(plan.base.source.resolved_text().encode())  # equal for all shards of a study
    digest.update(plan.study.source.resolved_text().encode())
    rows = slice(numbers.start, None, numbers.step)  # of columns as views
    return StudyHeading(
        title=plan.study.title,
        text=plan.study.source.resolved_text(),
        base=plan.base.source.resolved_text(),
        seed=plan.seed,
        numbers=np.arange(plan.size, dtype=np.int64)[rows],
        columns={path: values[rows] for path, values in plan.arrays.items()},
        keys=keys,
        attrs={**plan.attrs, "plan": digest.hexdigest()[:32]},
        folder=str(plan.base.folder.resolve()),
    )


def _finished_file(name: str, heading: StudyHeading) -> Progress | None:
    """Return the progress of a file that holds the whole study; None if anything is missing."""
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


def _import(name: str, keys: Keys, journal: Journal, retry_failed: bool) -> None:
    """Copy the finished samples of an existing file that belong to the study into the journal."""
    if not Path(name).exists():
        return
    with open_study(name) as study:
        valid = (found_in(keys, study.keys) >= 0) & (journal.numbers(study.keys) < 0)
        valid &= (study.exit_codes == 0) if retry_failed else (study.exit_codes >= 0)
        step = study.rows_at_a_time
        for start in range(0, len(study) if valid.any() else 0, step):
            rows = start + np.flatnonzero(valid[start : start + step])
            if len(rows):
                blocks = list(study.picked(rows, np.arange(len(rows))))
                journal.append([(study.keys[rows], packed(SampleOutcomes(blocks, len(rows))))])


def valid_samples(plan: Plan, target: str | os.PathLike[str], shard: tuple[int, int] | None = None) -> int:
    """Return the number of samples of a plan that are finished in a file and its journal.

    The files are only read, without a lock.
    """
    name = os.fspath(target)
    return int(np.sum(found_in(_finished(name), sample_keys(plan, shard_of(plan, shard))) >= 0))


#: Time of the first sample above which no others are tried, s.
_SLOW_SAMPLE = 1.0
#: Samples that are tried after the first, whose preparation they share.
_TRIED = 4


def explain_study(plan: Plan, target: str) -> Explanation:
    """Explain a study: its scene, and how the samples are run that are not finished in the file to write."""
    base = explain(plan.base)
    paths = list(plan.settings)
    report_progress("how samples are run")
    reason = why_alone(plan.base, paths, plan.collect) if base.obstacle is None else "the scene fails"
    done = valid_samples(plan, target)
    facts = [
        Fact("scene", f"{plan.attrs['base']} ({plan.base.kind}); what follows is at its own values"),
        Fact("samples", f"{plan.size:,} by {plan.attrs['method']} over {', '.join(plan.arrays)}"),
        Fact("finished", f"{done:,} of them, in {target}" if done else f"none in {target}"),
        Fact("batched", f"no, one by one: {reason}" if reason else "yes, samples share their preparation"),
        Fact("processes", f"at most {cores()}, one per core, unless --workers or --scheduler is given"),
        *base.facts,
    ]
    return Explanation(base.result, facts, base.obstacle)


def study_cost(plan: Plan, target: str) -> Cost:
    """Return the cost of the samples of a study that are not finished, from a trial of the first few."""
    remaining = plan.size - valid_samples(plan, target)
    count = min(plan.size, 1 + _TRIED)
    report_progress(f"trying {count} samples")
    job = Job.of(plan.base, plan.collect)
    began = time.thread_time()
    chunks = [run_chunk(job, plan.overrides([0]))]
    first = seconds_per_sample = time.thread_time() - began
    if count > 1 and first < _SLOW_SAMPLE:
        chunks.append(run_chunk(job, plan.overrides([*range(1, count)])))
        seconds_per_sample = chunks[-1].seconds / (count - 1)
    size = max(
        sum(value.data.nbytes for value in outcome.values.values())
        for chunk in chunks
        for outcome in unpacked(chunk.outcomes.content)
    )
    workers = min(cores(), max(1, remaining))
    seconds = (
        max(0.0, first - seconds_per_sample) + seconds_per_sample * remaining / workers if remaining else 0.0
    )
    sample = size + 8 * (6 + len(plan.columns))
    return Cost(
        seconds,
        peak_megabytes() * (1 + workers),
        file_kilobytes(40, sample * plan.size),
        "from a trial of its first samples",
    )
