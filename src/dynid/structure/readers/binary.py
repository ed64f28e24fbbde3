"""Matrices in binary files that a library reads: NumPy (`.npz`, `.npy`) and HDF5.

HDF5 includes MATLAB 7.3; sparse matrices are read as `scipy.sparse.save_npz`, MATLAB, SciPy or AnnData store
them.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import FileError
from dynid.hdf5 import check_stored, inside, open_hdf5
from dynid.structure.matrices import Matrix
from dynid.structure.readers.imported_matrix import (
    COMPLEX,
    MOST_NUMBERS,
    as_numbers,
    check_claim,
    compressed,
    read_errors,
)

#: The name of the one matrix in a file that holds a sparse matrix or a single array.
ONLY = "matrix"

_SPARSE = {"data", "format", "shape"}
_PARTS = {"coo": ("data", "row", "col")}


def numpy_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the arrays of a file, by name."""
    with read_errors(path, "NumPy file"):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as stream:
                return {ONLY: _numpy_header(stream)[0]}
        with zipfile.ZipFile(path) as archive:
            found = {}
            for info in archive.infolist():
                if info.filename.endswith(".npy"):
                    if info.file_size > 8 * MOST_NUMBERS:
                        raise FileError(f"{path}: {info.filename} claims {info.file_size} bytes")
                    with archive.open(info) as stream:
                        found[info.filename.removesuffix(".npy")] = _numpy_header(stream)[0]
            if not set(found) >= _SPARSE:
                return found
            with archive.open("shape.npy") as stream:
                _check_numpy(path, stream, archive.getinfo("shape.npy").file_size)
        with np.load(path, allow_pickle=False) as stored:
            return {ONLY: tuple(int(number) for number in np.ravel(stored["shape"])[:2])}


def load_numpy(path: Path, name: str) -> Matrix:
    """Return one matrix of a file. Nothing pickled is ever loaded."""
    with read_errors(path, "NumPy file"):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as stream:
                _check_numpy(path, stream, path.stat().st_size)
            return as_numbers(path, "", np.load(path, allow_pickle=False))
        with zipfile.ZipFile(path) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            sparse = name == ONLY and set(members) >= _SPARSE
            for part in members if sparse else [name]:
                with archive.open(members[part]) as stream:
                    _check_numpy(path, stream, members[part].file_size)
        with np.load(path, allow_pickle=False) as stored:
            if not sparse:
                return as_numbers(path, name, stored[name])
            layout = stored["format"].item()
            layout = layout.decode() if isinstance(layout, bytes) else str(layout)
            names = _PARTS.get(layout, ("data", "indices", "indptr"))
            data, one, other = (stored.get(part) for part in names)
            return compressed(path, stored["shape"], (data, one, other), layout)


def _numpy_header(stream: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return tuple(shape), dtype


def _check_numpy(path: Path, stream: Any, size: int) -> None:
    """Refuse an array whose header claims more than the file holds."""
    shape, dtype = _numpy_header(stream)
    check_claim(path, shape or (1,))
    needed = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if needed > size:
        raise FileError(f"{path} claims {needed} bytes of numbers, but holds {size}: it is truncated")


_MOST_NAMES = 1000


def hdf5_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the matrices of a file, by their paths in it."""
    return {name: shape for name, shape in _hdf5_members(path).items() if isinstance(shape, tuple)}


def hdf5_others(path: Path) -> dict[str, str]:
    """Return what stands in a file beside its matrices, by path."""
    return {name: what for name, what in _hdf5_members(path).items() if isinstance(what, str)}


def _hdf5_members(path: Path) -> dict[str, tuple[int, ...] | str]:
    """Return the shapes of the matrices of a file, and what else stands there, by their paths."""
    import h5py

    found: dict[str, tuple[int, ...] | str] = {}

    def visit(name: str, item: Any) -> bool | None:
        if "#" not in name and not any(name.startswith(f"{above}/") for above in found):
            what = _contents(item)
            if not what and isinstance(item, h5py.Dataset):
                found[name] = tuple(item.shape)
            elif what or (isinstance(item, h5py.Group) and _is_sparse(item)):
                found[name] = what or _sparse_shape(item)
        return True if len(found) > _MOST_NAMES else None

    with read_errors(path, "HDF5"), open_hdf5(path) as store:
        store.visititems(visit)
    return found


_CLASSES = {"char": "text", "function_handle": "a function", "string": "text", "cell": "a cell array"}
#: Classes of numbers in MATLAB.
_NUMBERS = (
    "double",
    "single",
    "logical",
    "int8",
    "int16",
    "int32",
    "int64",
    "uint8",
    "uint16",
    "uint32",
    "uint64",
)


def _contents(item: Any) -> str:
    """Return what an object is that is no matrix of real numbers; empty of such a matrix and of a group."""
    import h5py

    named = item.attrs.get("MATLAB_class", b"")
    name = named.decode(errors="replace") if isinstance(named, bytes) else str(named)
    if item.attrs.get("MATLAB_empty", 0):
        return f"an empty {'array' if name in _NUMBERS else name or 'array'}"
    if isinstance(item, h5py.Group):
        complex_parts = _is_sparse(item) and _is_complex(item.get("data"))
        return COMPLEX if complex_parts else ""
    size = " x ".join(map(str, reversed(item.shape or ())))  # of MATLAB, whose axes stand the other way round
    if name in _CLASSES:
        return _CLASSES[name] + (f" of {size} cells" if name == "cell" else "")
    if h5py.check_ref_dtype(item.dtype) is not None:
        above = item.parent.attrs.get("MATLAB_class", b"")
        if above == b"struct":
            return f"a field of a {size} structure array"
        return f"references to other objects ({name})" if name else "references to other objects"
    if name and name not in _NUMBERS:
        return f"an object of the class {name}"
    if _is_complex(item):
        return COMPLEX
    if item.dtype.kind not in "iuf":
        return "text" if item.dtype.kind in "SO" else "no plain numbers"
    if item.shape is None or not item.size:
        return "no numbers"
    return "" if item.ndim == 2 else f"an array of the shape {tuple(item.shape)}"


def _is_complex(dataset: Any) -> bool:
    """Return True of complex numbers, also as pairs of parts, as MATLAB stores them."""
    dtype = getattr(dataset, "dtype", None)
    if dtype is None:
        return False
    fields = {name.lower()[:1] for name in dtype.names or ()}
    return dtype.kind == "c" or fields == {"r", "i"}


def load_hdf5(path: Path, name: str) -> Matrix:
    """Return one matrix of a file. MATLAB's matrices are stored transposed."""
    import h5py

    with read_errors(path, "HDF5"), open_hdf5(path) as store:
        item = inside(store, name)
        if isinstance(item, h5py.Group) and _is_sparse(item):
            return _hdf5_sparse(path, item)
        if not isinstance(item, h5py.Dataset):
            raise FileError(f"{path} has no matrix '{name}'")
        check_claim(path, item.shape or (1,))
        check_stored(item)
        if what := _contents(item):
            raise FileError(f"{path}: '{name}' holds {what}; a structural matrix is real")
        values = as_numbers(path, name, item[()])
        return np.asarray(values).T if "MATLAB_class" in item.attrs else values


def _is_sparse(group: Any) -> bool:
    """Return True of a group that holds a sparse matrix, as MATLAB, SciPy or AnnData store it."""
    return "MATLAB_sparse" in group.attrs or {"data", "indices", "indptr"} <= set(group)


def _sparse_shape(group: Any) -> tuple[int, ...]:
    if "MATLAB_sparse" in group.attrs:
        columns = len(inside(group, "jc")) - 1 if "jc" in group else 0
        return int(group.attrs["MATLAB_sparse"]), columns
    shape = group.attrs.get("shape", _value(group, "shape", ()))
    return tuple(int(number) for number in np.ravel(shape)[:2])


def _hdf5_sparse(path: Path, group: Any) -> Matrix:
    layout, shape = "matlab", _sparse_shape(group)
    if "MATLAB_sparse" not in group.attrs:
        named = group.attrs.get("encoding-type", _value(group, "format", "csc"))
        layout = str(named.decode(errors="replace") if isinstance(named, bytes) else named)[:3]
    names = ("data", "ir", "jc") if layout == "matlab" else ("data", "indices", "indptr")
    if len(shape) != 2:
        raise FileError(f"{path}: the sparse matrix '{group.name}' has no shape")
    if layout == "matlab" and "data" not in group:  # MATLAB stores no entries where there are none
        return compressed(path, shape, (np.empty(0), np.empty(0, dtype=int), _member(group, "jc")), "csc")
    for name in names:
        check_claim(path, getattr(inside(group, name), "shape", None) or (1,))
    parts = tuple(_member(group, name) for name in names)
    indices, pointers = (np.asarray(part).astype(np.int64) for part in parts[1:])
    return compressed(path, shape, (parts[0], indices, pointers), layout.replace("matlab", "csc"))


def _member(group: Any, name: str) -> Any:
    """Return the values of a dataset of a group."""
    import h5py

    found = inside(group, name)
    if not isinstance(found, h5py.Dataset):
        raise ValueError(f"'{group.name}' has no dataset '{name}'")
    check_stored(found)
    return found[()]


def _value(group: Any, name: str, default: Any) -> Any:
    return _member(group, name) if group.get(name, getlink=True) is not None else default
