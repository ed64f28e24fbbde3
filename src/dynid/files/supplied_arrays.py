"""Arrays in place of a file, from Python code: columns by name, matrices, frequency responses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import UsageError
from dynid.file_access import supplied
from dynid.files.matrix_data import numeric_matrix
from dynid.files.recordings import Recording, array_channels, not_numbers
from dynid.files.table import DataFile
from dynid.structure.matrices import Matrix, is_sparse

#: The name of an array that stands alone in place of a file.
_ALONE = "matrix"


def arrays_of(name: str, data: Any) -> dict[str, Any]:
    """Return the arrays that stand in place of a file, by name; one alone has a name of its own.

    Raises `UsageError` where they are no arrays of numbers, of one or two axes.
    """
    arrays = {}
    for key, values in (data if isinstance(data, Mapping) else {_ALONE: data}).items():
        array = values if is_sparse(values) else np.asarray(values)
        what = not_numbers(array.dtype) if array.dtype.kind != "c" else ""
        if what or array.ndim not in (1, 2) or not isinstance(key, str):
            said = what or f"an array of {array.ndim} axes"
            remedy = "Supply columns by name: {'time': t, 'acc': a}, or matrices."
            raise UsageError(f"the data of '{name}' have {said} in '{key}'", remedy=remedy)
        if 0 in array.shape:
            raise UsageError(f"the data of '{name}' are empty in '{key}'")
        arrays[key] = array
    return arrays


def recording(file: DataFile) -> Recording:
    """Return the arrays of a file as channels: vectors, and the columns of matrices as ``NAME:NUMBER``."""
    arrays: dict[str, Any] = {
        key: values for key, values in supplied(file.path).items() if not is_sparse(values)
    }
    channels = [
        channel
        for name, values in arrays.items()
        for channel in array_channels("" if name == _ALONE else name, name, values.shape, values.dtype)
    ]

    def array(key: str) -> Any:
        name, column = key.rsplit(":", 1)
        return arrays[name].reshape(-1) if column == "0" else arrays[name][:, int(column) - 1]

    return Recording(file, tuple(channels), array)


def members(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the arrays that stand in place of a file."""
    return {name: values.shape for name, values in supplied(path).items()}


def load(path: Path, name: str) -> Matrix:
    """Return one matrix that stands in place of a file."""
    return numeric_matrix(path, "" if name == _ALONE else name, supplied(path)[name])
