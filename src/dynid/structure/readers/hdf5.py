"""HDF5 files, MATLAB 7.3 among them: datasets, and groups that hold a sparse matrix."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import FileError
from dynid.hdf5 import open_hdf5
from dynid.structure.matrices import Matrix
from dynid.structure.readers.imported import as_numbers, check_claim, compressed, read_errors

_WHAT = "HDF5"
_MOST_NAMES = 1000


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the matrices of a file, by their paths in it."""
    import h5py

    found: dict[str, tuple[int, ...]] = {}

    def visit(name: str, item: Any) -> bool | None:
        if "#" not in name and not any(name.startswith(f"{outer}/") for outer in found):
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and item.ndim == 2:
                found[name] = tuple(item.shape)
            elif isinstance(item, h5py.Group) and _is_sparse(item):
                found[name] = _sparse_shape(item)
        return True if len(found) > _MOST_NAMES else None

    with read_errors(path, _WHAT), open_hdf5(path) as store:
        store.visititems(visit)
    return found


def load(path: Path, name: str) -> Matrix:
    """Return one matrix of a file. MATLAB's matrices are stored transposed."""
    import h5py

    with read_errors(path, _WHAT), open_hdf5(path) as store:
        item = store.get(name)
        if isinstance(item, h5py.Group) and _is_sparse(item):
            return _sparse(path, item)
        if not isinstance(item, h5py.Dataset):
            raise FileError(f"{path} has no matrix '{name}'")
        check_claim(path, item.shape or (1,))
        values = as_numbers(path, name, item[()])
        return np.asarray(values).T if "MATLAB_class" in item.attrs else values


def _is_sparse(group: Any) -> bool:
    """Tell whether a group holds a sparse matrix, as MATLAB or SciPy and AnnData lay it out."""
    return "MATLAB_sparse" in group.attrs or {"data", "indices", "indptr"} <= set(group)


def _layout(group: Any) -> str:
    """Return how a group holds its sparse matrix: matlab, csc or csr."""
    if "MATLAB_sparse" in group.attrs:
        return "matlab"
    return str(_text(group.attrs.get("encoding-type", _value(group, "format", "csc"))))[:3]


def _sparse_shape(group: Any) -> tuple[int, ...]:
    if "MATLAB_sparse" in group.attrs:
        columns = len(group["jc"]) - 1 if "jc" in group else 0
        return int(group.attrs["MATLAB_sparse"]), columns
    shape = group.attrs.get("shape", _value(group, "shape", ()))
    return tuple(int(number) for number in np.ravel(shape)[:2])


def _sparse(path: Path, group: Any) -> Matrix:
    layout, shape = _layout(group), _sparse_shape(group)
    names = ("data", "ir", "jc") if layout == "matlab" else ("data", "indices", "indptr")
    if len(shape) != 2:
        raise FileError(f"{path}: the sparse matrix '{group.name}' has no shape")
    if layout == "matlab" and "data" not in group:  # MATLAB stores no entries where there are none
        return compressed(path, shape, (np.empty(0), np.empty(0, dtype=int), group["jc"][()]), "csc")
    for name in names:
        check_claim(path, group[name].shape)
    parts = tuple(group[name][()] for name in names)
    return compressed(
        path, shape, (parts[0], _signed(parts[1]), _signed(parts[2])), layout.replace("matlab", "csc")
    )


def _signed(indices: Any) -> Any:
    return np.asarray(indices).astype(np.int64)


def _value(group: Any, name: str, default: Any) -> Any:
    return group[name][()] if name in group else default


def _text(value: Any) -> Any:
    return value.decode(errors="replace") if isinstance(value, bytes) else value
