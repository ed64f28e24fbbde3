"""A study from its scene to its file, in as many goes as it takes."""

from __future__ import annotations

import hashlib
import os
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError, UsageError
from dynid.number_format import counted
from dynid.scene.outcomes import SampleBlock, SampleOutcomes
from dynid.study.file import Heading, write_study
from dynid.study.journal import Journal
from dynid.study.keys import SIZE, Keys, found_in, sample_keys
from dynid.study.lock import locked
from dynid.study.packing import packed
from dynid.study.running import Notice, Progress, Report, Run, TooManyFailures, judged
from dynid.study.stored import open_study

if TYPE_CHECKING:
    from dynid.study.executors import StudyExecutor
    from dynid.study.plan import Plan


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
    """Run what is not finished of a study, and write its file.

    Whatever interrupts it, every sample that was reported as finished is safe in `<target>.journal`, and
    the next call goes on from there.

    Parameters
    ----------
    plan
        The study's plan.
    target
        The HDF5 file.
    pool
        What runs samples; see `dynid.study.executors.make_executor`. It is dismissed at the end.
    shard
        (I, N): run every Nth sample only, from the Ith (from 1).
    max_failures
        How many samples may fail; absent: any number.
    retry_failed
        Whether samples that failed before are run again.
    force
        Whether finished samples of the file that do not belong to this study may be lost.
    report
        Is told how far the study is.
    notice
        Is given sentences for the user: what was damaged, what takes long.

    Returns
    -------
    Progress
        How far it is: all is finished.

    Raises
    ------
    TooManyFailures
        When more than `max_failures` samples fail; the rest are pending in the file then.
    UsageError
        When the file holds finished samples that do not belong to this study.
    FileError
        When the file cannot be written, is another study's at the moment, or holds something else.
    KeyboardInterrupt
        As it came; the file has been written with pending samples.
    """
    name = os.fspath(target)
    numbers = shard_of(plan, shard)
    with ExitStack() as stack:
        stack.enter_context(locked(name))
        stack.callback(pool.dismiss)
        heading = heading_of(plan, numbers, sample_keys(plan, numbers))
        _refuse_foreign(name, heading.keys, force)
        done = _finished_file(name, heading) if not retry_failed else None
        if done is not None:
            Journal.discard(journal_name(name))
            if report is not None:
                report(done)
            return judged(done, max_failures)
        journal = _opened(name, notice)
        stack.callback(journal.close)
        _import(name, heading.keys, journal, retry_failed)
        run = Run(plan, numbers, heading, journal, max_failures, report, retry_failed)
        _go(name, heading, run, pool, notice)
        Journal.discard(journal.path)
        return run.progress


def _opened(name: str, notice: Notice | None) -> Journal:
    """Open the journal of a file, and give notice of what was damaged."""
    journal = Journal(journal_name(name))
    if journal.damage is not None and notice is not None:
        notice(str(journal.damage))
    return journal


def _go(name: str, heading: Heading, run: Run, pool: StudyExecutor, notice: Notice | None) -> None:
    """Run what is not finished, and write the file; after an interruption with pending samples."""
    try:
        run.go(pool, notice)
    except (KeyboardInterrupt, TooManyFailures):
        pool.dismiss()
        _write(name, heading, run, complete=run.is_complete)
        raise
    _write(name, heading, run)


def _write(name: str, heading: Heading, run: Run, complete: bool = True) -> None:
    """Write the file; report with an error in doing so that the journal holds the finished samples."""
    try:
        write_study(name, heading, run, complete)
    except FileError as error:
        remedy = (
            f"{run.journal.path} holds {counted(run.progress.finished, 'finished sample')}. "
            "Make room, or see to the disk, and run the study again: it goes on."
        )
        raise FileError(error.problem, remedy=remedy, names=error.names) from error


def _refuse_foreign(name: str, keys: Keys, force: bool) -> None:
    """Refuse to replace finished samples that do not belong to the study."""
    if not force and (foreign := foreign_samples(name, keys)):
        raise UsageError(
            f"{name} holds {counted(foreign, 'finished sample')} that "
            f"{'does' if foreign == 1 else 'do'} not belong to this study, and would be lost",
            remedy="Write another file with -o, or discard them with --force.",
            names=[name],
        )


def foreign_samples(name: str, keys: Keys) -> int:
    """Return how many finished samples of a file and its journal have none of these keys."""
    known = [finished_keys(name)] if Path(name).exists() else []
    if Path(journal_name(name)).exists():
        known.append(Journal.read_keys(journal_name(name)))
    known = [some for some in known if len(some)]
    if not known:
        return 0
    every = np.unique(np.concatenate(known), axis=0)
    return int(np.sum(found_in(keys, every) < 0))


def finished_keys(name: str) -> Keys:
    """Return the keys of the finished samples of a file."""
    with open_study(name) as study:
        if study.keys.shape[1] != SIZE:
            raise ValueError("keys of another length")
        return study.keys[study.exit_codes >= 0]


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
                journal.append([(study.keys[rows], packed(SampleOutcomes(blocks, len(rows))))])


def _those(block: SampleBlock, rows: NDArray[np.intp]) -> SampleBlock | None:
    """Return the samples of a block that stand in rows, numbered by these rows."""
    _, places, wanted = np.intersect1d(block.rows, rows, return_indices=True)
    return block.taken(places, wanted) if len(places) else None


def valid_samples(plan: Plan, target: str | os.PathLike[str], shard: tuple[int, int] | None = None) -> int:
    """Return how many samples of a plan are finished already, in a file and its journal.

    Nothing is changed, and no lock is needed.
    """
    name = os.fspath(target)
    keys = sample_keys(plan, shard_of(plan, shard))
    finished = np.zeros(len(keys), dtype=bool)
    if Path(name).exists():
        finished |= found_in(finished_keys(name), keys) >= 0
    if Path(journal_name(name)).exists():
        finished |= found_in(Journal.read_keys(journal_name(name)), keys) >= 0
    return int(finished.sum())
