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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.result import Result, Scalar
from dynid.scene.outcomes import Block
from dynid.store import hollow, write_blocks
from dynid.study.analysis.table import RESULTS, SAMPLES
from dynid.study.layout import Layout
from dynid.study.statistics import computed, declare

_BLOCK_BYTES = 32 * 2**20
_BLOCK_ROWS = 4096
_STATUS = np.array(["pending", "done", "failed"], dtype=object)


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


class Rows(Protocol):
    """Where the outcomes of a study are."""

    def between(self, start: int, stop: int) -> Iterator[Block]:
        """Yield the samples of rows start … stop - 1, in any order; what is pending does not come."""


def write_study(
    path: str | os.PathLike[str], heading: Heading, outcomes: Rows, complete: bool = True
) -> None:
    """Write the file of a study, whole or not at all.

    Parameters
    ----------
    path
        The file; an existing one is replaced.
    heading
        What it says beside the outcomes.
    outcomes
        The outcome of each row. They are gone through twice.
    complete
        Whether this is the end of the study.

    Raises
    ------
    FileError
        When it cannot be written. An existing file is untouched then.
    """
    count, layout = len(heading.numbers), Layout()
    for start in range(0, count, _BLOCK_ROWS):
        for block in outcomes.between(start, min(start + _BLOCK_ROWS, count)):
            layout.see(block)
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
    write_blocks(result, path, _blocks(heading, layout, outcomes), complete, computed)


def _blocks(heading: Heading, layout: Layout, outcomes: Rows) -> Iterator[tuple[str, int, NDArray[Any]]]:
    """Yield the rows of all arrays, as many at a time as memory shall hold."""
    size = max(1, min(_BLOCK_ROWS, _BLOCK_BYTES // layout.row_bytes))
    for start in range(0, len(heading.numbers), size):
        stop = min(start + size, len(heading.numbers))
        keys = [key.tobytes().hex() for key in heading.keys[start:stop]]
        yield "study/key", start, np.array(keys, dtype=object)
        for name, rows in _rows(layout, outcomes.between(start, stop), start, stop).items():
            yield name, start, rows


def _rows(layout: Layout, blocks: Iterator[Block], start: int, stop: int) -> dict[str, NDArray[Any]]:
    """Return some rows of all arrays."""
    count = stop - start
    codes, errors = np.full(count, -1), np.full(count, "", dtype=object)
    met = np.zeros((layout.expectations, count), dtype=bool)
    data, lengths = _blank(layout, count)
    for block in blocks:
        own = block.rows - start
        codes[own] = block.exit_codes if block.errors else 0
        errors[own] = block.errors if block.errors else ""
        met[: block.met.shape[1], own] = block.met.T
        for path, column in block.values.items():
            array = layout.array(path, column)
            if array.path in data:
                within: tuple[Any, ...] = tuple(map(slice, column.data.shape[1:]))
                data[array.path][(own, *within)] = column.data
            if array.path in lengths:
                lengths[array.path][own] = column.data.shape[1:]
    found = {"study/status": _STATUS[np.sign(codes) + 1], "study/error": errors, "study/exit_code": codes}
    found |= {f"study/expect/{number}": column for number, column in enumerate(met)}
    found |= {f"{RESULTS}/{path}": rows for path, rows in data.items()}
    return found | {f"{RESULTS}/{path}_length": rows for path, rows in lengths.items()}


def _blank(layout: Layout, count: int) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[np.int64]]]:
    """Return rows without values of all arrays that have rows, and the lengths of those that are padded."""
    arrays = [array for array in layout.arrays if array.shared is None]
    data = {array.path: np.full((count, *array.shape), array.blank, array.dtype) for array in arrays}
    ragged = [array for array in arrays if array.ragged]
    return data, {array.path: np.zeros((count, len(array.shape)), np.int64) for array in ragged}
