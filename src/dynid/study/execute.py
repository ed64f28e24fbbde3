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
from dynid.scene.batch import Outcome
from dynid.study.drive import Arrived, drive
from dynid.study.file import Heading, write_study
from dynid.study.journal import Journal
from dynid.study.keys import sample_keys
from dynid.study.lock import locked
from dynid.study.stored import StudyFile, open_study
from dynid.study.work import Job

if TYPE_CHECKING:
    from dynid.study.executors import Crew
    from dynid.study.plan import Plan

_IMPORTED = 1000  # outcomes that go from a file into a journal at a time


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
        keys = sample_keys(plan, numbers)
        heading = heading_of(plan, numbers, keys)
        done = _finished_file(name, heading) if not retry_failed else None
        if done is not None:
            Journal.discard(journal_name(name))
            if report is not None:
                report(done)
            return _judged(done, max_failures)
        journal = Journal(journal_name(name))
        stack.callback(journal.close)
        _import(name, keys, journal, retry_failed)
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


def heading_of(plan: Plan, numbers: range, keys: NDArray[np.uint8]) -> Heading:
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
            and study.keys == [key.tobytes() for key in heading.keys]
            and "pending" not in study.status
            and np.array_equal(study.numbers, heading.numbers)
        )
        count = len(study)
        return Progress(count, count, study.status.count("failed"), count) if same else None


def _judged(progress: Progress, max_failures: int | None) -> Progress:
    """Return how far a study is, unless too much of it failed."""
    if max_failures is not None and progress.failed > max_failures:
        raise TooManyFailures(
            f"{progress.failed} samples failed, more than the {max_failures} of --max-failures",
            remedy="Their errors are in study/error.",
        )
    return progress


def _import(name: str, keys: NDArray[np.uint8], journal: Journal, retry_failed: bool) -> None:
    """Bring what is still valid of an older file into the journal."""
    if not Path(name).exists():
        return
    wanted = {key.tobytes() for key in keys} - journal.places.keys()
    with open_study(name) as study:
        for some in _batches(_valid(study, wanted, retry_failed)):
            journal.append(some)


def _valid(study: StudyFile, wanted: set[bytes], retry_failed: bool) -> Iterator[tuple[bytes, Outcome]]:
    if wanted.isdisjoint(study.keys):
        return
    for key, outcome in zip(study.keys, study.outcomes(), strict=True):
        if key in wanted and outcome is not None and not (retry_failed and outcome.error):
            wanted.discard(key)
            yield key, outcome


def _batches(pairs: Iterator[tuple[bytes, Outcome]]) -> Iterator[list[tuple[bytes, Outcome]]]:
    some = []
    for pair in pairs:
        some.append(pair)
        if len(some) == _IMPORTED:
            yield some
            some = []
    if some:
        yield some


class _Run:
    """One go at a study; also its outcomes, in the order of the plan."""

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
        self.keys = [key.tobytes() for key in heading.keys]
        self.journal = journal
        self.max_failures = max_failures
        self.report = report
        self.failures = set(journal.failures)
        if retry_failed:
            journal.forget(self.failures)
            self.failures = set()
        self.copies = _copies(self.keys)
        self.finished = self.kept = sum(key in journal for key in self.keys)
        self.failed = sum(key in self.failures for key in self.keys)

    def __iter__(self) -> Iterator[Outcome | None]:
        for key in self.keys:
            yield self.journal.outcome(key) if key in self.journal else None

    @property
    def progress(self) -> Progress:
        return Progress(len(self.keys), self.finished, self.failed, self.kept)

    @property
    def is_complete(self) -> bool:
        return self.finished == len(self.keys)

    def go(self, crew: Crew) -> None:
        """Run what is not finished."""
        self._tell()
        todo = self._todo()
        if todo:
            job = Job.of(self.plan.base, self.plan.collect, self.plan.size)
            drive(crew, job, self.plan, todo, self._arrived)

    def _todo(self) -> list[int]:
        """Return the samples to run: of those that are the same, the first."""
        waiting = {key for key in self.keys if key not in self.journal}
        todo = []
        for number, key in zip(self.numbers, self.keys, strict=True):
            if key in waiting:
                waiting.discard(key)
                todo.append(number)
        return todo

    def _arrived(self, outcomes: Arrived) -> None:
        pairs = [(self.keys[self.numbers.index(number)], outcome) for number, outcome in outcomes]
        self.journal.append(pairs)
        self.finished += sum(self.copies.get(key, 1) for key, _ in pairs)
        self.failed += sum(self.copies.get(key, 1) for key, outcome in pairs if outcome.error)
        self._tell()

    def _tell(self) -> None:
        if self.report is not None:
            self.report(self.progress)
        _judged(self.progress, self.max_failures)


def _copies(keys: list[bytes]) -> dict[bytes, int]:
    """Return how many samples a key stands for, of those that stand for several."""
    once: set[bytes] = set()
    counts: dict[bytes, int] = {}
    for key in keys:
        if key in once:
            counts[key] = counts.get(key, 1) + 1
        once.add(key)
    return counts


def valid_samples(plan: Plan, target: str | os.PathLike[str], shard: tuple[int, int] | None = None) -> int:
    """Return how many samples of a plan are finished already, in a file and its journal.

    Nothing is changed, and no lock is needed.
    """
    name = os.fspath(target)
    known: set[bytes] = set()
    if Path(name).exists():
        with open_study(name) as study:
            known |= {
                key for key, status in zip(study.keys, study.status, strict=True) if status != "pending"
            }
    if Path(journal_name(name)).exists():
        known |= Journal.read_keys(journal_name(name))
    keys = sample_keys(plan, shard_of(plan, shard))
    return sum(key.tobytes() in known for key in keys)
