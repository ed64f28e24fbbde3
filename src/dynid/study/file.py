"""The HDF5 file of a study: sample-first arrays, from outcomes that are never in memory all at once.

`study/sample` numbers the samples; `study/samples/<path>` is what was varied; `study/results/<path>` what
was gathered, where failed and pending samples are NaN (or an empty text); `study/status`, `study/error`,
`study/exit_code`, `study/key` and `study/expect/<n>` tell of each sample; `study/statistics/<path>` sums the
results up. Nothing under `study/` tells of a clock, a host or a duration.

Numbers and truth values are float64, so that what is missing can be NaN; the attribute `stored` keeps
their own type. Arrays that differ in length from sample to sample are padded; the attribute `lengths`
names the array of their lengths.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import Result, Scalar
from dynid.scene.batch import Outcome
from dynid.store import hollow, write_blocks
from dynid.study.analysis.table import RESULTS, SAMPLES
from dynid.study.layout import Layout
from dynid.study.statistics import computed, declare

_BLOCK_BYTES = 32 * 2**20
_BLOCK_ROWS = 4096


@dataclass(frozen=True)
class Heading:
    """What the file of a study says beside the outcomes.

    Parameters
    ----------
    title
        The study's title.
    text
        Its YAML text.
    base
        The YAML text of the scene it varies.
    seed
        The seed of its sampling.
    numbers
        The number of each row's sample in the plan, from 0: all of them, or those of a shard.
    columns
        What was varied, by path: a number or text for each row.
    keys
        The key of each row's sample (rows x bytes).
    attrs
        Further attributes of the group `study`.
    folder
        Where the files are that the scene names by relative paths.
    """

    title: str
    text: str
    base: str
    seed: int
    numbers: NDArray[np.int64]
    columns: Mapping[str, NDArray[Any]]
    keys: NDArray[np.uint8]
    attrs: Mapping[str, Scalar] = field(default_factory=dict)
    folder: str = "."


def write_study(
    path: str | os.PathLike[str], heading: Heading, rows: Iterable[Outcome | None], complete: bool = True
) -> None:
    """Write the file of a study, whole or not at all.

    Parameters
    ----------
    path
        The file; an existing one is replaced.
    heading
        What it says beside the outcomes.
    rows
        The outcome of each row, None where it is pending. It is gone through twice.
    complete
        Whether this is the end of the study.

    Raises
    ------
    FileError
        When it cannot be written. An existing file is untouched then.
    """
    layout = Layout()
    for outcome in rows:
        layout.see(outcome)
    count = len(heading.numbers)
    root: dict[str, Scalar] = {"scene": heading.text, "seed": heading.seed, "folder": heading.folder}
    result = Result("study", heading.title, root)
    result.add_axis("study/sample", heading.numbers)
    result.add("study/scene", np.array(heading.base, dtype=object))
    result.annotate("study", **heading.attrs)
    for name, column in heading.columns.items():
        result.add(f"{SAMPLES}/{name}", column, ("sample",))
    for name in ("status", "error", "key"):
        result.add(f"study/{name}", hollow((count,), object), ("sample",))
    result.add("study/exit_code", hollow((count,), np.int64), ("sample",))
    for number in range(layout.expectations):
        result.add(f"study/expect/{number}", hollow((count,), np.bool_), ("sample",))
    layout.declare(result, count)
    declare(result)
    write_blocks(result, path, _blocks(heading, layout, rows), complete, computed)


def _blocks(
    heading: Heading, layout: Layout, rows: Iterable[Outcome | None]
) -> Iterator[tuple[str, int, NDArray[Any]]]:
    """Yield the rows of all arrays, as many at a time as memory shall hold."""
    size = max(1, min(_BLOCK_ROWS, _BLOCK_BYTES // layout.row_bytes))
    waiting: list[Outcome | None] = []
    first = 0
    for outcome in rows:
        waiting.append(outcome)
        if len(waiting) == size:
            yield from _block(heading, layout, waiting, first)
            first, waiting = first + size, []
    if waiting:
        yield from _block(heading, layout, waiting, first)


def _block(
    heading: Heading, layout: Layout, outcomes: Sequence[Outcome | None], first: int
) -> Iterator[tuple[str, int, NDArray[Any]]]:
    status = ["pending" if one is None else "failed" if one.error else "done" for one in outcomes]
    yield "study/status", first, np.array(status, dtype=object)
    errors = ["" if one is None else one.error for one in outcomes]
    yield "study/error", first, np.array(errors, dtype=object)
    keys = [key.tobytes().hex() for key in heading.keys[first : first + len(outcomes)]]
    yield "study/key", first, np.array(keys, dtype=object)
    yield "study/exit_code", first, np.array([-1 if one is None else one.exit_code for one in outcomes])
    for number in range(layout.expectations):
        met = [one is not None and one.expectations[number : number + 1] == (True,) for one in outcomes]
        yield f"study/expect/{number}", first, np.array(met)
    yield from _values(layout, outcomes, first)


def _values(
    layout: Layout, outcomes: Sequence[Outcome | None], first: int
) -> Iterator[tuple[str, int, NDArray[Any]]]:
    arrays = [array for array in layout.arrays.values() if array.shared is None]
    data = {
        array.path: np.full((len(outcomes), *array.shape), array.blank, dtype=array.dtype) for array in arrays
    }
    lengths = {
        array.path: np.zeros((len(outcomes), len(array.shape)), dtype=np.int64)
        for array in arrays
        if array.ragged
    }
    for row, outcome in enumerate(outcomes):
        for path, variable in (outcome.values if outcome is not None else {}).items():
            array = layout.array(path, variable)
            if array.path in data:
                data[array.path][(slice(row, row + 1), *map(slice, variable.data.shape))] = variable.data
            if array.path in lengths:
                lengths[array.path][row] = variable.data.shape
    for path, values in data.items():
        yield f"{RESULTS}/{path}", first, values
        if path in lengths:
            yield f"{RESULTS}/{path}_length", first, lengths[path]
