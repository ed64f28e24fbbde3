"""Statistics of a study, beside its results in its file: `study/statistics/<path>/<name>`.

They are computed from the file when all samples are in it, one array at a time, and depend on the samples
alone: the same however the study was run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import Result, Variable
from dynid.study.analysis.moments import NAMES, statistics
from dynid.study.analysis.table import RESULTS, STATISTICS, StudyTable, as_numbers

_VALUES = 2**22  # values that are in memory at a time


def declare(result: Result) -> None:
    """Add the arrays of all statistics to a study whose results are declared; values come with `computed`.

    Of complex numbers they are those of the magnitude, which the attribute `of` says.
    """
    table = StudyTable(result)
    for path in filter(table.is_number, table.paths):
        variable = table.variable(path)
        dims, shape = variable.dims[1:], variable.shape[1:]
        _copy_coordinates(result, path, dims)
        attrs = {"of": "magnitude"} if variable.dtype.kind == "c" else {}
        for name in NAMES:
            values = np.zeros(shape, np.int64 if name == "count" else np.float64)
            units = "" if name == "count" else variable.units
            result.add(f"{STATISTICS}/{path}/{name}", values, dims, units, **attrs)


def computed(result: Result) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the values of all statistics of a study whose results are there."""
    table = StudyTable(result)
    for path in filter(table.is_number, table.paths):
        for name, values in _of_entries(table.variable(path)).items():
            yield f"{STATISTICS}/{path}/{name}", values


def _of_entries(variable: Variable) -> dict[str, NDArray[Any]]:
    """Return the statistics of every entry, from some of the entries at a time."""
    samples, *entries = variable.shape
    if not entries or not math.prod(entries):
        return dict(statistics(as_numbers(variable.data)))
    step = max(1, _VALUES // max(1, samples * math.prod(entries[1:])))
    parts = [
        statistics(as_numbers(variable.entries(start, start + step))) for start in range(0, entries[0], step)
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in NAMES}


def _copy_coordinates(result: Result, path: str, dims: tuple[str, ...]) -> None:
    """Bring the coordinates of an array's axes beside its statistics, so that the group stands alone."""
    for dim in dims:
        group = path
        while group and dim not in NAMES:
            group = group.rpartition("/")[0]
            coordinate = result.get(f"{RESULTS}/{group}/{dim}" if group else f"{RESULTS}/{dim}")
            if coordinate is not None:
                if coordinate.dims == (dim,) and f"{STATISTICS}/{path}/{dim}" not in result:
                    result.put(f"{STATISTICS}/{path}/{dim}", coordinate)
                break
