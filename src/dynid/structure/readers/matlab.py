"""MATLAB files of versions 5 to 7.2 (`.mat`): their numeric variables, full and sparse, and nothing else.

SciPy's compiled reader ends the process at some damaged files; here every length is checked before it is
used, and nothing is unpacked beyond what a variable's sizes allow. Fields of a structure are variables
``structure/field``. Version 7.3 is HDF5.
Source: The MathWorks, "MAT-File Format", 2019.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dynid.errors import FileError
from dynid.structure.matrices import Array, Matrix
from dynid.structure.readers.imported_matrix import (
    MOST_NUMBERS,
    as_numbers,
    check_claim,
    compressed,
    read_errors,
)

_WHAT = "a MATLAB file"
_MATRIX, _COMPRESSED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CELL, _STRUCTURE, _SPARSE, _FULL = 1, 2, 5, range(6, 16)
# How deep structures within structures are read.
_DEEPEST = 4
_COMPLEX = 0x800
# A variable's flags, sizes and name stand in its first bytes.
_HEAD = 4096


class _MatlabVariable(NamedTuple):
    """A variable: its name, sizes, class and flags, most entries if sparse, and its bytes as stored."""

    name: str
    shape: tuple[int, ...]
    kind: int
    is_complex: bool
    most: int
    payload: memoryview
    packed: bool


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the numeric variables of a file, by name."""
    with read_errors(path, _WHAT):
        return {variable.name: variable.shape for variable in _variables(path)[1] if variable.kind != _CELL}


def names(path: Path) -> list[str]:
    """Return the names of the full numeric variables and the cell arrays of a file."""
    with read_errors(path, _WHAT):
        found = (variable for variable in _variables(path)[1] if variable.kind != _SPARSE)
        return [variable.name for variable in found if "/" not in variable.name]


def arrays(path: Path, name: str) -> tuple[tuple[int, ...] | None, list[Array]]:
    """Return the arrays of a variable: of a matrix None and itself, of cells their shape and contents.

    Cells come column by column, as the file holds them. They must hold matrices of real numbers.
    """
    with read_errors(path, _WHAT):
        order, variables = _variables(path)
        variable = next(item for item in variables if item.name == name)
        if variable.kind != _CELL:
            return None, [_full(path, variable, order)]
        content = variable.payload
        if variable.packed:
            content = _unpacked(content, 8 * MOST_NUMBERS)[8:]
        cells = [payload for kind, payload in list(_elements(content, order))[3:] if kind == _MATRIX]
        found = []
        for number, payload in enumerate(cells, 1):
            cell = _described(payload, payload, packed=False, order=order)._replace(
                name=f"{name}{{{number}}}"
            )
            found.append(_full(path, cell, order))
        if len(found) != np.prod(variable.shape, dtype=object):
            raise ValueError(f"{name} has {len(found)} cells, not {' x '.join(map(str, variable.shape))}")
        return variable.shape, found


def _full(path: Path, variable: _MatlabVariable, order: str) -> Array:
    """Return a full matrix of real numbers."""
    if variable.kind not in _FULL or variable.is_complex:
        raise FileError(f"{path}: '{variable.name}' is no matrix of real numbers")
    check_claim(path, variable.shape)
    values = _array(*_parts(variable, order)[0], order)
    return np.asarray(as_numbers(path, variable.name, values.reshape(variable.shape, order="F")))


def complex_matrix(path: Path, name: str) -> np.ndarray[Any, np.dtype[Any]]:
    """Return a full matrix of real or complex numbers."""
    with read_errors(path, _WHAT):
        order, variables = _variables(path)
        variable = next(item for item in variables if item.name == name)
        if variable.kind not in _FULL:
            raise FileError(f"{path}: '{name}' is no full matrix of numbers")
        check_claim(path, variable.shape)
        parts = [_array(*part, order).astype(float) for part in _parts(variable, order)]
        values = parts[0] + 1j * parts[1] if variable.is_complex else parts[0]
        return values.reshape(variable.shape, order="F")


def load(path: Path, name: str) -> Matrix:
    """Return one variable of a file; no objects, functions or structures are read."""
    with read_errors(path, _WHAT):
        order, variables = _variables(path)
        variable = next(item for item in variables if item.name == name and item.kind != _CELL)
        if variable.is_complex:
            raise FileError(f"{path}: '{name}' holds complex numbers; a structural matrix is real")
        check_claim(path, variable.shape, variable.most if variable.kind == _SPARSE else None)
        parts = [_array(*part, order) for part in _parts(variable, order)]
        if variable.kind == _SPARSE:
            indices, starts, values = parts[:3]
            count = int(starts[-1]) if len(starts) else 0  # what is allocated beyond holds nothing
            return compressed(path, variable.shape, (values[:count], indices[:count], starts), "csc")
        return as_numbers(path, name, parts[0].reshape(variable.shape, order="F"))


def _variables(path: Path) -> tuple[str, list[_MatlabVariable]]:
    """Return the byte order of a file, and its numeric variables."""
    if path.stat().st_size > 8 * MOST_NUMBERS:
        raise FileError(f"{path} is larger than the {8 * MOST_NUMBERS} bytes that are read")
    data = memoryview(path.read_bytes())
    mark = bytes(data[126:128])
    if len(data) < 128 or mark not in (b"IM", b"MI"):
        raise FileError(f"{path} is no MATLAB file of version 5 or later", remedy="Save it with -v7.")
    order = "<" if mark == b"IM" else ">"
    found = []
    for outer, payload in _elements(data[128:], order):
        packed = outer == _COMPRESSED
        head = _unpacked(payload, _HEAD) if packed else payload
        kind = struct.unpack_from(f"{order}I", head)[0] if packed else outer
        head = head[8:] if packed else head
        if kind == _MATRIX:
            variable = _described(head, payload, packed, order)
            if variable.kind in (_CELL, _SPARSE) or variable.kind in _FULL:
                found.append(variable)
            elif variable.kind == _STRUCTURE:
                found += _fields(variable, order, 1)
    return order, found


def _fields(variable: _MatlabVariable, order: str, depth: int) -> Iterator[_MatlabVariable]:
    """Yield the numeric fields of a structure, and of those within it; none of an array of structures."""
    if variable.shape != (1, 1) or depth > _DEEPEST:
        return
    content = variable.payload
    if variable.packed:
        content = _unpacked(content, 8 * MOST_NUMBERS)[8:]
    _, _, _, width, names, *payloads = _elements(content, order)
    size = int(_array(*width, order)[0])
    text = bytes(names[1])
    if size < 1 or len(text) != size * len(payloads):
        raise ValueError(f"the structure {variable.name} has other fields than names")
    for place, (kind, payload) in enumerate(payloads):
        name = text[place * size : (place + 1) * size].partition(b"\0")[0].decode("latin-1")
        if kind != _MATRIX or not len(payload):
            continue
        field = _described(payload, payload, packed=False, order=order)
        field = field._replace(name=f"{variable.name}/{name}")
        if field.kind == _SPARSE or field.kind in _FULL:
            yield field
        elif field.kind == _STRUCTURE:
            yield from _fields(field, order, depth + 1)


def _described(head: memoryview, payload: memoryview, packed: bool, order: str) -> _MatlabVariable:
    elements = _elements(head, order)
    flags, most = struct.unpack_from(f"{order}II", next(elements)[1])
    shape = tuple(int(size) for size in _array(*next(elements), order))
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError("a variable has no sizes")
    name = bytes(next(elements)[1]).decode("latin-1")
    return _MatlabVariable(name, shape, flags & 0xFF, bool(flags & _COMPLEX), most, payload, packed)


def _parts(variable: _MatlabVariable, order: str) -> list[tuple[int, memoryview]]:
    """Return the numeric parts of a variable: of a sparse one row indices, column starts, values."""
    content = variable.payload
    if variable.packed:
        sparse = variable.kind == _SPARSE
        full = int(np.prod(variable.shape)) * (1 + variable.is_complex)
        numbers = 2 * variable.most + variable.shape[-1] if sparse else full
        content = _unpacked(content, 8 * numbers + _HEAD)[8:]
    return list(_elements(content, order))[3:]


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of the elements one after the other."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if kind >> 16:  # up to four bytes stand within the tag
            kind, size, start, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        else:
            start = at + 8
            after = start + size + (-size % 8 if kind != _COMPRESSED else 0)
        if size > len(data) - start:
            raise ValueError("it is truncated")
        yield kind, data[start : start + size]
        at = after


def _unpacked(payload: memoryview, most: int) -> memoryview:
    return memoryview(zlib.decompressobj().decompress(payload, most))


def _array(kind: int, content: memoryview, order: str) -> np.ndarray[Any, np.dtype[Any]]:
    if kind not in _TYPES:
        raise ValueError(f"numbers of an unknown type {kind}")
    return np.frombuffer(content, dtype=f"{order}{_TYPES[kind]}")
