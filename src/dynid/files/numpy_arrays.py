"""Matrices in NumPy files (`.npz`, `.npy`); sparse ones as `scipy.sparse.save_npz` stores them."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.errors import FileError
from dynid.files.matrix_data import Container, compressed, numeric_matrix
from dynid.files.table import DataFile
from dynid.files.untrusted import MOST_NUMBERS, check_claim, read_errors
from dynid.structure.matrices import Matrix

if TYPE_CHECKING:
    from dynid.files.recordings import Recording

#: The name of the one matrix in a file that holds a sparse matrix or a single array.
ONLY = "matrix"

_SPARSE = {"data", "format", "shape"}

_PARTS = {"coo": ("data", "row", "col")}


def _numpy_headers(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Return shape and type of the arrays of a file, by name."""
    with read_errors(path, "NumPy file"):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as stream:
                return {ONLY: _numpy_header(stream)}
        headers = {}
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                if info.filename.endswith(".npy"):
                    if info.file_size > 8 * MOST_NUMBERS:
                        raise FileError(f"{path}: {info.filename} claims {info.file_size} bytes")
                    with archive.open(info) as stream:
                        headers[info.filename.removesuffix(".npy")] = _numpy_header(stream)
        return headers


def _numpy_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the matrices of a file, by name."""
    headers = _numpy_headers(path)
    if not set(headers) >= _SPARSE:
        return {name: shape for name, (shape, _) in headers.items()}
    with read_errors(path, "NumPy file"):
        return {ONLY: tuple(int(number) for number in np.ravel(_checked_array(path, "shape"))[:2])}


def _load_numpy(path: Path, name: str) -> Matrix:
    """Return one matrix of a file. Nothing pickled is ever loaded."""
    members = _numpy_headers(path)
    with read_errors(path, "NumPy file"):
        if not (name == ONLY and set(members) >= _SPARSE):
            return numeric_matrix(path, "" if name == ONLY else name, _checked_array(path, name))
        stored = {member: _checked_array(path, member) for member in members}
        layout = stored["format"].item()
        layout = layout.decode() if isinstance(layout, bytes) else str(layout)
        names = _PARTS.get(layout, ("data", "indices", "indptr"))
        data, indices, pointers = (stored.get(member) for member in names)
        return compressed(path, stored["shape"], (data, indices, pointers), layout)


def _checked_array(path: Path, name: str) -> Any:
    """Return one array of a file that holds as much as its header claims."""
    if not zipfile.is_zipfile(path):
        with path.open("rb") as stream:
            _check_numpy(path, stream, path.stat().st_size)
        return np.load(path, allow_pickle=False)
    with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as stream:
        _check_numpy(path, stream, archive.getinfo(f"{name}.npy").file_size)
    with np.load(path, allow_pickle=False) as stored:
        return stored[name]


MATRICES = Container(_numpy_shapes, _load_numpy)
"""The reader of the matrices of a file."""


def recording(file: DataFile) -> Recording:
    """Return the arrays of a file as channels: vectors, fields, and columns as ``NAME:NUMBER``."""
    from dynid.files.recordings import RecordedChannel, Recording, array_channels, not_numbers

    path = file.path
    try:
        headers = _numpy_headers(path)
    except FileError as error:
        file.refuse(error.problem.removeprefix(f"{path} "), error.remedy)
    alone = path.suffix.lower() == ".npy"
    channels: list[RecordedChannel] = []
    for name, (shape, dtype) in headers.items():
        fields = dtype.names if dtype.names and len(shape) == 1 else ()
        if not fields:
            channels += array_channels("" if alone else name, name, shape, dtype)
        for k, field in enumerate(fields, 1):
            what = not_numbers(dtype[field])
            group, values = "" if alone else name, f"{name}:{k}"
            channels.append(RecordedChannel(field, group, "", shape[0], values=values, what=what))

    def array(key: str) -> Any:
        name, column = key.rsplit(":", 1)
        with read_errors(path, "NumPy file"):
            values = np.asarray(_checked_array(path, name))
        if values.dtype.names:
            return values[values.dtype.names[int(column) - 1]]
        return values.reshape(-1) if column == "0" else values[:, int(column) - 1]

    return Recording(file, tuple(channels), array)


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
