"""Matrices in NumPy files (`.npz`, `.npy`); sparse ones as `scipy.sparse.save_npz` stores them."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import FileError
from dynid.files.matrix_data import Container, compressed, numeric_matrix
from dynid.files.untrusted import MOST_NUMBERS, check_claim, read_errors
from dynid.structure.matrices import Matrix

#: The name of the one matrix in a file that holds a sparse matrix or a single array.
ONLY = "matrix"

_SPARSE = {"data", "format", "shape"}

_PARTS = {"coo": ("data", "row", "col")}


def _numpy_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the arrays of a file, by name."""
    with read_errors(path, "NumPy file"):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as stream:
                return {ONLY: _numpy_header(stream)[0]}
        with zipfile.ZipFile(path) as archive:
            shapes = {}
            for info in archive.infolist():
                if info.filename.endswith(".npy"):
                    if info.file_size > 8 * MOST_NUMBERS:
                        raise FileError(f"{path}: {info.filename} claims {info.file_size} bytes")
                    with archive.open(info) as stream:
                        shapes[info.filename.removesuffix(".npy")] = _numpy_header(stream)[0]
            if not set(shapes) >= _SPARSE:
                return shapes
            with archive.open("shape.npy") as stream:
                _check_numpy(path, stream, archive.getinfo("shape.npy").file_size)
        with np.load(path, allow_pickle=False) as stored:
            return {ONLY: tuple(int(number) for number in np.ravel(stored["shape"])[:2])}


def _load_numpy(path: Path, name: str) -> Matrix:
    """Return one matrix of a file. Nothing pickled is ever loaded."""
    with read_errors(path, "NumPy file"):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as stream:
                _check_numpy(path, stream, path.stat().st_size)
            return numeric_matrix(path, "", np.load(path, allow_pickle=False))
        with zipfile.ZipFile(path) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            sparse = name == ONLY and set(members) >= _SPARSE
            for member in members if sparse else [name]:
                with archive.open(members[member]) as stream:
                    _check_numpy(path, stream, members[member].file_size)
        with np.load(path, allow_pickle=False) as stored:
            if not sparse:
                return numeric_matrix(path, name, stored[name])
            layout = stored["format"].item()
            layout = layout.decode() if isinstance(layout, bytes) else str(layout)
            names = _PARTS.get(layout, ("data", "indices", "indptr"))
            data, indices, pointers = (stored.get(member) for member in names)
            return compressed(path, stored["shape"], (data, indices, pointers), layout)


MATRICES = Container(_numpy_shapes, _load_numpy)
"""The reader of the matrices of a file."""


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
