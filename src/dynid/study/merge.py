"""Merge of the shards of a study into one file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.number_format import counted
from dynid.scene.outcomes import SampleBlock
from dynid.study.file import StudyHeading, locked, write_study
from dynid.study.keys import found_in
from dynid.study.run import finished_keys
from dynid.study.stored import StudyFile, open_study

_PENDING = 2
_RANKS = np.array([_PENDING, 0, 1])  # of pending, done and failed samples


def merge_studies(
    files: Sequence[str | os.PathLike[str]],
    target: str | os.PathLike[str],
    partial: bool = False,
    *,
    force: bool = False,
) -> int:
    """Merge the shards of a study into one file, equal to that of the study run in one piece.

    Of equal samples the finished one is used. `partial` accepts missing samples, `force` discards finished
    samples of an existing target that are in none of the files. Returns the number of samples in the file.

    Raises
    ------
    UsageError
        If the files are not of one study, samples are missing, or finished samples of the target would be
        lost.
    FileError
        If a file cannot be read or written, or the target is no file of a study.
    """
    with ExitStack() as stack:
        stack.enter_context(locked(os.fspath(target)))
        studies = [stack.enter_context(open_study(file)) for file in files]
        about = [study.result.group_attrs["study"] for study in studies]
        for attrs, file in zip(about, files, strict=True):
            if attrs["plan"] != about[0]["plan"]:
                problem = f"{os.fspath(file)} is of another study than {os.fspath(files[0])}"
                raise UsageError(problem, remedy="Merge the shards of one study, run from the same scenes.")
        rows = _Rows(studies)
        size = int(about[0]["size"])
        missing = np.setdiff1d(np.arange(size), rows.numbers[rows.finished])
        if len(missing) and not partial:
            listed = ", ".join(map(str, missing[:5])) + (", …" if len(missing) > 5 else "")
            raise UsageError(
                f"{len(missing)} of {size} samples are finished in none of the files: {listed}",
                remedy="Run their shards, or merge what there is with --partial.",
            )
        heading = rows.heading()
        if not force and Path(target).exists():
            keys = heading.keys[rows.finished]
            lost = int(np.sum(found_in(keys, finished_keys(os.fspath(target))) < 0))
            if lost:
                raise UsageError(
                    f"{os.fspath(target)} holds {counted(lost, 'finished sample')} that "
                    f"{'is' if lost == 1 else 'are'} in none of the files, and would be lost",
                    remedy="Write another file with -o, or discard them with --force.",
                    names=[os.fspath(target)],
                )
        write_study(target, heading, rows.between, complete=not len(missing))
        return len(rows.numbers)


class _Rows:
    """Outcomes of several files, in the order of the plan."""

    def __init__(self, studies: Sequence[StudyFile]) -> None:
        self.studies = studies
        numbers = np.concatenate([study.numbers for study in studies])
        # Of several files with a sample, a done one is preferred to a failed one, that to a pending one.
        ranks = np.concatenate([_RANKS[np.sign(study.exit_codes) + 1] for study in studies])
        holders = np.repeat(np.arange(len(studies)), [len(study) for study in studies])
        order = np.lexsort((holders, ranks, numbers))
        chosen = order[np.unique(numbers[order], return_index=True)[1]]
        self.numbers: NDArray[np.int64] = numbers[chosen]
        self.finished = ranks[chosen] < _PENDING
        self._holders = holders[chosen]
        self._chosen = chosen  # rows of all files, one after another
        self._rows = (
            chosen - np.concatenate([[0], np.cumsum([len(study) for study in studies])])[self._holders]
        )

    def between(self, start: int, stop: int) -> Iterator[SampleBlock]:
        """Yield the finished samples of rows start … stop - 1, file by file."""
        for holder, study in enumerate(self.studies):
            target_rows = start + np.flatnonzero(self._holders[start:stop] == holder)
            if len(target_rows):
                yield from study.picked(self._rows[target_rows], target_rows)

    def heading(self) -> StudyHeading:
        """Return the content of the files except the outcomes."""
        first = self.studies[0].result
        columns = [study.columns() for study in self.studies]
        return StudyHeading(
            title=first.title,
            text=str(first.attrs["scene"]),
            base=str(first.value("study/scene")),
            seed=int(first.attrs["seed"]),
            numbers=self.numbers,
            columns={
                path: np.concatenate([inputs[path] for inputs in columns])[self._chosen]
                for path in columns[0]
            },
            keys=np.concatenate([study.keys for study in self.studies])[self._chosen],
            attrs=first.group_attrs["study"],
            folder=str(first.attrs.get("folder", ".")),
        )
