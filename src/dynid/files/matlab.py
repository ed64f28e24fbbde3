"""MATLAB files of versions 4 to 7.2 (`.mat`): their numeric variables, full and sparse, and nothing else.

SciPy's reader ends the process at some damaged files, at others only sometimes. It runs in a separate
process, which copies what is numbers into a NumPy archive; this process reads nothing but the archive.
Fields of a structure are variables ``structure/field``, of a structure array ``structure(2)/field``.
Version 7.3 is HDF5.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid import trial
from dynid.arrays import Array
from dynid.errors import FileError
from dynid.files.matrix_data import Container, compressed, numeric_matrix, real_matrix
from dynid.files.table import ColumnRequest, DataFile, DataTable, are_numbers
from dynid.files.untrusted import MOST_NUMBERS, DiedError, archived, check_claim, check_size, read_errors
from dynid.structure.matrices import Matrix, is_sparse
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.files.recordings import Recording

_WHAT = "a MATLAB file"
_REMEDY = "Save it again, with -v7."
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
#: Classes of variables that hold no numbers, and are not read.
_PASSED_OVER = {"char", "function", "object", "opaque", "unknown"}
_DEEPEST = 4  # how deep structures within structures are read
_MAX_ELEMENTS = 1000  # of a structure array that is read
_MAX_DECOMPRESSION_RATIO = 1032  # of stored bytes by decompression, at most
#: Memory of the separate process, bytes: of itself, and at most.
_LEAST_MEMORY, _MOST_MEMORY = 2**31, 24 * MOST_NUMBERS
_MATLAB_BYTES_A_SECOND = 10_000_000  # of a file, read at least


class _MatlabVariable(NamedTuple):
    """A variable: ``full``, ``sparse`` or ``cell``, its shape, and the names of its arrays in the archive.

    Those of a sparse one are data, row indices and column starts; a cell that holds no numbers has ``""``.
    `kind` is ``struct`` or a class of MATLAB of what is not read.
    """

    kind: str
    shape: tuple[int, ...]
    arrays: list[str]


def is_hdf5(start: bytes) -> bool:
    """Return True if the first bytes of a file are those of HDF5, also behind the header of version 7.3."""
    return start.startswith(_HDF5_SIGNATURE) or start[512:].startswith(_HDF5_SIGNATURE)


def _members(path: Path) -> dict[str, tuple[int, ...] | str]:
    """Return the shapes of the numeric variables of a file, and what else stands there, by name."""
    members: dict[str, tuple[int, ...] | str] = {}
    for name, (kind, shape, _) in _variables(path).items():
        size = " x ".join(map(str, shape))
        known = {
            "cell": f"a cell array of {size} cells",
            "struct": f"a {size} structure array",
            "char": "text",
        }
        if 0 in shape:
            members[name] = "an empty array"
        elif kind in ("full", "sparse"):
            members[name] = shape
        else:
            members[name] = known.get(kind, f"an object of the class {kind}")
    return members


def names(path: Path) -> list[str]:
    """Return the names of the full numeric variables, those of fields included, and the cell arrays."""
    return [name for name, variable in _variables(path).items() if variable.kind in ("full", "cell")]


def recording(file: DataFile) -> Recording:
    """Return the vectors of a file, and the columns of its matrices, as channels; structures are groups."""
    from dynid.files.recordings import Recording, array_channels

    channels = []
    for name, variable in _variables(file.path).items():
        group, _, field = name.rpartition("/")
        if variable.kind == "full" and 0 not in variable.shape:
            real = np.dtype(float)  # complex ones are refused when they are read
            channels += array_channels(field, name, variable.shape, real, group=group)

    def array(key: str) -> Any:
        name, column = key.rsplit(":", 1)
        values = _values(file.path, _variables(file.path)[name].arrays)[0]
        return values.reshape(-1) if column == "0" else values[:, int(column) - 1]

    return Recording(file, tuple(channels), array)


def _load(path: Path, name: str) -> Matrix:
    """Return one variable of a file; no objects, functions or structures are read."""
    variable = _variables(path)[name]
    check_claim(path, variable.shape, 0 if variable.kind == "sparse" else None)
    values = _values(path, variable.arrays)
    if variable.kind == "sparse":
        return compressed(path, variable.shape, (values[0], values[1], values[2]), "csc")
    return numeric_matrix(path, name, values[0])


MATRICES = Container(_members, _load)
"""The reader of the matrices of a file."""


def _variables(path: Path) -> dict[str, _MatlabVariable]:
    """Return the numeric variables of a file by name."""
    with np.load(_archive(path), allow_pickle=False) as stored:
        if "problem" in stored:
            raise FileError(f"{path} cannot be read as {_WHAT}: {stored['problem']}", remedy=_REMEDY)
        index = json.loads(str(stored["index"]))
    return {name: _MatlabVariable(kind, tuple(shape), parts) for name, (kind, shape, parts) in index.items()}


def _values(path: Path, parts: list[str]) -> list[np.ndarray[Any, np.dtype[Any]]]:
    """Return arrays of the archive of a file; what is no numbers as text."""
    with np.load(_archive(path), allow_pickle=False) as stored:
        return [stored[array] if array else np.asarray("") for array in parts]


def _archive(path: Path) -> Path:
    """Return the archive of a file, which is written anew only where the file has changed."""
    with read_errors(path, _WHAT):
        facts = path.stat()
        check_size(path)
        with path.open("rb") as stream:
            version_7_3 = is_hdf5(stream.read(1024))
        if version_7_3:
            raise FileError(
                f"{path} is a MATLAB file of version 7.3, of which only matrices and records are read",
                remedy=_REMEDY,
            )
        seconds = trial.SECONDS + facts.st_size / _MATLAB_BYTES_A_SECOND
        memory = min(_LEAST_MEMORY + 2 * _MAX_DECOMPRESSION_RATIO * facts.st_size, _MOST_MEMORY)
        try:
            return archived(path, archive, seconds=seconds, memory=memory)
        except DiedError:
            raise FileError(
                f"{path} cannot be read as {_WHAT}: it is damaged, so that SciPy does not survive it",
                remedy=_REMEDY,
            ) from None


def archive(path: str, target: str) -> None:
    """Write the numeric variables of a MATLAB file, or why there are none, into a NumPy archive."""
    import warnings

    from scipy.io.matlab import loadmat, whosmat

    index: dict[str, _MatlabVariable] = {}
    members: dict[str, Any] = {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of two variables of one name the first is read
            bytes_held = _MAX_DECOMPRESSION_RATIO * Path(path).stat().st_size
            for name, shape, kind in whosmat(path):
                if kind in _PASSED_OVER or name.startswith("__"):
                    if name and not name.startswith("__"):
                        index.setdefault(name, _MatlabVariable(kind, shape, []))
                    continue
                count = int(np.prod(shape, dtype=object))
                if kind != "sparse" and count * (8 if kind in ("cell", "struct") else 1) > bytes_held:
                    raise ValueError(f"'{name}' claims {count} entries, more than its bytes")
                # What is too large is refused where it is asked for.
                index.setdefault(
                    name,
                    _MatlabVariable("full" if count > MOST_NUMBERS and kind != "sparse" else "", shape, []),
                )
            names = [name for name, variable in index.items() if not variable.kind]
            stored = loadmat(path, variable_names=names)
            variables = {name: variable for name, variable in index.items() if variable.kind}
            for name in names:
                _add(name, stored[name], 0, variables, members)
        np.savez(target, index=json.dumps(variables), **members)
    except Exception as error:  # whatever SciPy raises on a damaged file
        said = " ".join(str(error).split())[:200] or type(error).__name__
        lack = "it claims more than the memory"
        np.savez(target, problem=lack if isinstance(error, MemoryError) else said)


def _add(
    name: str, value: Any, depth: int, index: dict[str, _MatlabVariable], members: dict[str, Any]
) -> None:
    """Add a variable as SciPy returns it, with the fields of a structure, and of those within it."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    def kept(*parts: Any) -> list[str]:
        places = [f"a{len(members) + k}" for k in range(len(parts))]
        members.update(zip(places, parts, strict=True))
        return places

    if is_sparse(value):
        value = value.tocsc()
        index[name] = _MatlabVariable("sparse", value.shape, kept(value.data, value.indices, value.indptr))
    elif isinstance(value, MatlabFunction | MatlabObject | MatlabOpaque) or not isinstance(value, np.ndarray):
        return
    elif value.dtype.names:
        alone = value.shape == (1, 1)
        if not alone:
            index[name] = _MatlabVariable("struct", value.shape, [])
        elements = value.ravel(order="F")
        if depth >= _DEEPEST or len(elements) > _MAX_ELEMENTS:
            return
        for number, element in enumerate(elements, 1):
            for field in value.dtype.names:
                where = f"{name}/{field}" if alone else f"{name}({number})/{field}"
                _add(where, element[field], depth + 1, index, members)
    elif value.dtype.kind == "O":
        if not depth:
            contents = value.ravel(order="F")
            places = [kept(cell)[0] if _is_numeric(cell) else "" for cell in contents]
            index[name] = _MatlabVariable("cell", value.shape, places)
    elif _is_numeric(value):
        index[name] = _MatlabVariable("full", value.shape, kept(value))


def _is_numeric(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "iufcb"


def read_columns(file: DataFile, request: ColumnRequest) -> DataTable:
    """Return named vectors as one table, or the columns of one variable.

    Of a cell array a row is a table, its cells the columns. Columns of a matrix are named ``NAME:NUMBER``.
    """
    columns, layout = request.columns, request.layout
    named = columns is not None and not are_numbers(columns)
    if columns is not None and named:
        layout.only(file, "time", "group")
        columns_read = [str(name) for name in columns]
        parts = [_column(file, layout.inside(name), "columns") for name in columns_read]
        if isinstance(layout.time, str):
            columns_read.append(layout.time)
            parts.append(_column(file, layout.inside(layout.time), "time"))
    else:
        layout.only(file, "variable", "row", "time")
        top = [name for name in names(file.path) if "/" not in name]
        variables = top or names(file.path) if layout.variable is None else [layout.variable]
        if len(variables) != 1:
            listed = f": {', '.join(variables[:20])}" if variables else ""
            file.refuse(f"has {len(variables) or 'no'} variables{listed}", "Name it: variable: NAME.")
        variable = variables[0]
        columns_read, parts = [], _cells(file, variable, "variable", layout.row)
        if len(parts) > 1:
            numbers = {number for number in (*(columns or ()), layout.time) if isinstance(number, int)}
            used = numbers if columns else set()
            rows = max((parts[k - 1].size for k in used if 1 <= k <= len(parts)), default=0)
            parts = [
                _vector(file, variable, cell) if not used or k in used else np.full(rows, np.nan)
                for k, cell in enumerate(parts, 1)
            ]
        elif min(parts[0].shape) == 1:
            parts = [parts[0].reshape(-1, 1)]
    if any(len(column) != len(parts[0]) for column in parts):
        lengths = ", ".join(str(len(column)) for column in parts)
        file.refuse(f"has columns of different lengths: {lengths}", key="columns" if named else "variable")
    table = DataTable(file, columns_read, np.column_stack(parts), selected=named)
    return table if layout.time is None else table.timed_by(table.find(layout.time, "time"))


def complex_columns(file: DataFile, candidates: Sequence[str], key: str) -> NDArray[Any]:
    """Return the first variable of these names as columns of real or complex numbers."""
    name = _existing(file, candidates, key)
    variable = _variables(file.path)[name]
    if variable.kind != "full":
        raise FileError(f"{file.path}: '{name}' is no full matrix of numbers")
    check_claim(file.path, variable.shape)
    values = _values(file.path, variable.arrays)[0]
    values = values.astype(complex if values.dtype.kind == "c" else float)
    return values.reshape(-1, 1) if min(values.shape) == 1 else values


def _existing(file: DataFile, candidates: Sequence[str], key: str) -> str:
    """Return the first of these names that a variable has; that of a field may have dots."""
    variables = names(file.path)
    candidates = [name if name in variables else name.replace(".", "/") for name in candidates]
    name = next((name for name in candidates if name in variables), candidates[0])
    if name not in variables:
        hint = did_you_mean(name, variables) or (f"; it has {', '.join(variables[:20])}" if variables else "")
        file.refuse(f"has no variable '{name}'{hint}", key=key)
    return name


def whole_numbers(file: DataFile, name: str, key: str) -> list[int]:
    """Return a variable of whole numbers, such as those of DOFs."""
    values = complex_columns(file, [name], key).ravel()
    if len(broken := values[values != np.round(values.real)]):
        file.refuse(
            f"has {broken[0]:g} in '{name}', no whole number",
            "Number the DOFs, or name them in the scene: modes: {sensors: [12:z, …]}.",
            key=key,
        )
    return [int(value) for value in values.real]


def _cells(file: DataFile, name: str, key: str, row: int | None) -> list[Array]:
    """Return the arrays of a variable: one, or those of a row of cells."""
    variable = _variables(file.path)[_existing(file, [name], key)]
    check_claim(file.path, variable.shape)
    shape, cells = variable.shape, variable.kind == "cell"
    contents: list[Array] = []
    for number, values in enumerate(_values(file.path, variable.arrays), 1):  # of cells column by column
        label = f"{name}{{{number}}}" if cells else name
        if values.dtype.kind not in "iufb":
            raise FileError(f"{file.path}: '{label}' is no matrix of real numbers")
        contents.append(np.asarray(real_matrix(file.path, label, values)))
    if not cells:
        if row is not None:
            file.refuse(f"holds a matrix in '{name}', no rows of cells", key="row")
        return contents
    if row is None and shape[0] > 1:
        file.refuse(f"has {shape[0]} rows of cells in '{name}'", "Give it: row: NUMBER.", key=key)
    if row is not None and row > shape[0]:
        file.refuse(f"has {shape[0]} rows of cells in '{name}', no row {row}", key="row")
    return contents[(row or 1) - 1 :: shape[0]]


def _column(file: DataFile, name: str, key: str) -> Array:
    """Return a vector, or a column of a matrix."""
    stem, colon, number = name.rpartition(":")
    if not colon or not number.isdecimal() or name in names(file.path):
        return _vector(file, name, _cells(file, name, key, None)[0])
    values = _cells(file, stem, key, None)[0]
    if not 1 <= int(number) <= values.shape[1]:
        file.refuse(f"has {values.shape[1]} columns in '{stem}', no column {number}", key=key)
    return np.asarray(values[:, int(number) - 1])


def _vector(file: DataFile, name: str, values: Array) -> Array:
    if values.size != max(values.shape):
        remedy = f"Name one of its columns: {name}:1."
        file.refuse(
            f"has {values.shape[0]} x {values.shape[1]} numbers in '{name}', not a column of them", remedy
        )
    return np.asarray(values.ravel())
