"""The numbers under a plot: all of them where they are few, else evenly thinned out, which is said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.report.figure import Cell, Table

#: The most rows of a table; the file of the result has all of them.
MOST_ROWS = 200


def thinned(count: int, most: int = MOST_ROWS) -> NDArray[np.intp]:
    """Return which of a number of rows are shown: the first, the last, and others evenly between them."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).round().astype(np.intp)


def listed(columns: Mapping[str, ArrayLike], most: int = MOST_ROWS) -> Table:
    """Return columns of equal length as a table of at most `most` rows.

    Values are those of the result, unrounded.
    """
    arrays = [np.asarray(values) for values in columns.values()]
    count = len(arrays[0]) if arrays else 0
    shown = thinned(count, most)
    rows = tuple(zip(*(_cells(values[shown]) for values in arrays), strict=True))
    note = f"{len(shown)} of {count:,} rows, evenly spread; the file has all" if len(shown) < count else ""
    return Table(tuple(columns), rows, note)


def _cells(values: NDArray[Any]) -> Sequence[Cell]:
    return [str(value) for value in values] if values.dtype.kind == "O" else values.tolist()
