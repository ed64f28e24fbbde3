"""Tables in Universal Files: functions at nodal DOFs (data sets 58), as text or binary, through pyuff."""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.structure.readers.imported_matrix import MOST_NUMBERS, read_errors
from dynid.tables.table import DataFile, DataTable

#: Types of functions of time, general or not.
_TIME = (0, 1)
#: Digits of an increment as the format prints it.
_DIGITS = 1e-5


class UniversalFunction(NamedTuple):
    """A data set 58: its name, type, abscissa and values; evenly spaced or not, type of the ordinate."""

    name: str
    kind: int
    x: NDArray[np.float64]
    values: NDArray[Any]
    even: bool
    ordinate: int


def read_uff(file: DataFile) -> DataTable:
    """Return the time histories of a Universal File as columns, in order."""
    found = [function for function in read_functions(file) if function.kind in _TIME]
    if not found:
        file.refuse("holds no time history", "Data sets 58 of function type 1 are read.")
    times = found[0].x
    for number, function in enumerate(found, 1):
        if np.iscomplexobj(function.values):
            file.refuse(f"function {number} ({function.name}) is complex; a record is real")
        if function.x.shape != times.shape or not np.allclose(function.x, times, rtol=1e-9, atol=0):
            file.refuse(
                f"function {number} ({function.name}) has other times than the first",
                "Put records of different sampling into files of their own.",
            )
    coarse = 0.0 if found[0].even else _DIGITS
    names = [function.name for function in found]
    values = np.column_stack([function.values for function in found])
    # Names of functions repeat in practice; numbers distinguish them. None of them is a column of times.
    return DataTable(file, names, values, None, times, coarse * np.abs(times), timed=-1)


def read_functions(file: DataFile) -> list[UniversalFunction]:
    """Return all data sets 58 of a Universal File.

    Raises
    ------
    FileError
        If pyuff is not installed, or the file is damaged.
    """
    try:
        pyuff: Any = import_module("pyuff")  # an extra: only users of this format need it
    except ImportError:
        file.refuse("is a Universal File, and pyuff is not installed", "Install it: dynid[formats].")
    if file.path.stat().st_size > 8 * MOST_NUMBERS:
        file.refuse(f"is larger than the {8 * MOST_NUMBERS} bytes that are read")
    try:
        with read_errors(file.path, "a Universal File"), np.errstate(all="ignore"):
            source = pyuff.UFF(str(file.path))
            places = [k for k, kind in enumerate(source.get_set_types()) if int(kind) == 58]
            return [_function(file, number, source.read_sets(k)) for number, k in enumerate(places, 1)]
    except FileError as error:
        if error.names:
            raise
        raise FileError(error.problem, remedy=error.remedy, names=[f"{file.place}.path"]) from None


def _function(file: DataFile, number: int, data_set: Any) -> UniversalFunction:
    """Return a data set that has as many points as it claims."""
    values, x = np.asarray(data_set["data"]), np.asarray(data_set["x"], dtype=float)
    claimed = int(data_set["num_pts"])
    if values.ndim != 1 or len(values) != claimed or x.shape != values.shape or not claimed:
        file.refuse(
            f"function {number} claims {claimed} points, but {values.size} can be read", "It is damaged."
        )
    name = str(data_set.get("id1", "")).strip() or f"function {number}"
    even = int(data_set["abscissa_spacing"]) == 1
    ordinate = int(data_set.get("ordinate_spec_data_type", 0))
    return UniversalFunction(name, int(data_set["func_type"]), x, values, even, ordinate)
