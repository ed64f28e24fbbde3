"""HDF5 files, MATLAB 7.3 included: matrices, and datasets as tables.

Sparse matrices are read as MATLAB, SciPy or AnnData store them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError, FileError
from dynid.files.matrix_data import COMPLEX, Container, compressed, numeric_matrix
from dynid.files.table import TIME, ColumnRequest, DataFile, DataTable, are_numbers, unit_and_doubt
from dynid.files.untrusted import check_claim, read_errors
from dynid.hdf5 import Refused, check_stored, inside, open_hdf5
from dynid.structure.matrices import Matrix
from dynid.suggestions import did_you_mean, shortened
from dynid.units import si_factor, unit_fits

if TYPE_CHECKING:
    from dynid.files.recordings import Recording

_MAX_NAMES = 1000
_MAX_ELEMENTS = 1000  # of a structure array that is read


def _hdf5_members(path: Path) -> dict[str, tuple[int, ...] | str]:
    """Return the shapes of the matrices of a file, and what else stands there, by their paths."""
    import h5py

    members: dict[str, tuple[int, ...] | str] = {}

    def visit(name: str, item: Any) -> bool | None:
        if "#" not in name and not any(name.startswith(f"{above}/") for above in members):
            what = _contents(item)
            if not what and isinstance(item, h5py.Dataset):
                members[name] = tuple(item.shape)
            elif what or (isinstance(item, h5py.Group) and _is_sparse(item)):
                members[name] = what or _sparse_shape(item)
            for number in range(1, 1 + _elements(item)):
                above, _, field = name.rpartition("/")
                element = _object(item.file, f"{above}({number})/{field}")
                if isinstance(element, h5py.Dataset):
                    members[f"{above}({number})/{field}"] = _contents(element) or tuple(element.shape)
        return True if len(members) > _MAX_NAMES else None

    with read_errors(path, "HDF5"), open_hdf5(path) as store:
        store.visititems(visit)
    return members


def _elements(item: Any) -> int:
    """Return the number of elements of the structure array whose field a dataset of references is, else 0."""
    import h5py

    if not isinstance(item, h5py.Dataset) or h5py.check_ref_dtype(item.dtype) is None:
        return 0
    above = item.parent.attrs.get("MATLAB_class", b"")
    return int(item.size) if above == b"struct" and item.size <= _MAX_ELEMENTS else 0


def _object(store: Any, name: str) -> Any:
    """Return the object at a path, which may be a field of an element, ``part(2)/M``; None: there is none."""
    item = inside(store, name)
    match = re.fullmatch(r"(.+)\((\d+)\)[/.]([^/]+)", name) if item is None else None
    if match is None:
        return item
    field, number = inside(store, f"{match[1]}/{match[3]}"), int(match[2])
    if not 1 <= number <= _elements(field):
        return None
    check_stored(field)
    return store[field[()].ravel()[number - 1]]  # in MATLAB's order, as its axes are turned


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


def _load_hdf5(path: Path, name: str) -> Matrix:
    """Return one matrix of a file. MATLAB's matrices are stored transposed."""
    import h5py

    with read_errors(path, "HDF5"), open_hdf5(path) as store:
        item = _object(store, name)
        if isinstance(item, h5py.Group) and _is_sparse(item):
            return _hdf5_sparse(path, item)
        if not isinstance(item, h5py.Dataset):
            raise FileError(f"{path} has no matrix '{name}'")
        check_claim(path, item.shape or (1,))
        check_stored(item)
        if (what := _contents(item)) and what != COMPLEX:
            raise FileError(f"{path}: '{name}' holds {what}; a structural matrix is real")
        values = numeric_matrix(path, name, _as_numbers(item[()]))
        return np.asarray(values).T if "MATLAB_class" in item.attrs else values


MATRICES = Container(_hdf5_members, _load_hdf5)
"""The reader of the matrices of a file."""


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
    indices, pointers = (np.asarray(array).astype(np.int64) for array in parts[1:])
    return compressed(
        path, shape, (_as_numbers(parts[0]), indices, pointers), layout.replace("matlab", "csc")
    )


def _as_numbers(values: Any) -> Any:
    """Return numbers; pairs of real and imaginary parts, as MATLAB stores them, as complex ones."""
    parts = values.dtype.names
    return values if parts is None else values[parts[0]] + 1j * values[parts[1]]


def _member(group: Any, name: str) -> Any:
    """Return the values of a dataset of a group."""
    import h5py

    dataset = inside(group, name)
    if not isinstance(dataset, h5py.Dataset):
        raise ValueError(f"'{group.name}' has no dataset '{name}'")
    check_stored(dataset)
    return dataset[()]


def _value(group: Any, name: str, default: Any) -> Any:
    return _member(group, name) if group.get(name, getlink=True) is not None else default


#: The datasets of the columns where a scene names none.
_MEASURED = ("measured", "identification/measurement/measured")


def read_columns(file: DataFile, request: ColumnRequest) -> DataTable:
    """Return datasets as one table: the named ones, else the columns of the measured ones.

    Where no dataset of times is named, it is `time` or `t` beside the first one.
    """
    columns, single, layout = request.columns, request.single, request.layout
    layout.only(file, "time", "group")
    time = layout.time
    if isinstance(time, int):
        file.refuse("has datasets, no numbered columns of times", "Give its name.", key="time")
    rows = None if request.rows is None else request.rows + (layout.first or 1) - 1
    with _opened(file) as store:
        named = columns is not None and not are_numbers(columns)
        if columns is not None and named:
            names = [layout.inside(str(name)) for name in columns]
        elif single and columns is None:
            names = [name for name in _numeric(store) if name not in TIME]
            if len(names) != 1:
                listed = f": {', '.join(names)}" if names else ""
                file.refuse(
                    f"has {len(names) or 'no'} datasets of numbers beside the time{listed}",
                    "Name the one that drives: column: NAME.",
                    key="column",
                )
        else:
            names = [next((name for name in _MEASURED if inside(store, name) is not None), _MEASURED[0])]
        key = "column" if single else "columns"
        datasets = [_found(file, store, name, key, "iuf") for name in names]
        lengths = {dataset.shape[0] for dataset in datasets}
        parts = [np.asarray(dataset.read(rows), dtype=float) for dataset in datasets]
        if (
            len(lengths) > 1
            or any(len(column) != len(parts[0]) for column in parts)
            or (len(parts) > 1 and any(column.ndim != 1 for column in parts))
        ):
            file.refuse(f"has no columns of one length in {', '.join(names)}", key=key)
        if single and (named or columns is None) and parts[0][:1].size > 1:
            file.refuse(f"has {parts[0].shape[1]} columns in '{names[0]}'", "Give a number.", key=key)
        values = np.column_stack(parts)
        time = None if time is None else layout.inside(time)
        times = _times(file, store, names, lengths.pop(), time, rows)
        if not named:
            return DataTable(file, [], values, None, *times)
        if len(datasets) < values.shape[1]:  # all columns of one
            names, datasets = names * values.shape[1], datasets * values.shape[1]
        units, doubts = zip(*(unit_and_doubt(dataset.unit) for dataset in datasets), strict=True)
        table = DataTable(file, names, values, None, *times, timed=-1, units=units, selected=True)
        return replace(table, doubts=doubts)


@contextmanager
def _opened(file: DataFile) -> Iterator[Any]:
    """Open a file; errors of reading it name the file."""
    try:
        with open_hdf5(file.path) as store:
            yield store
    except Refused as error:
        file.refuse(str(error), colon=True)
    except DynidError:
        raise
    except Exception as error:  # a damaged file makes h5py raise nearly anything
        file.refuse(f"cannot be read as HDF5: {' '.join(str(error).split())}")


def _numeric(group: Any, kinds: str = "iuf") -> list[str]:
    """Return the datasets of numbers beside others, or where there are none those of all groups."""
    return [name for name in group if _is_table(_unless_elsewhere(group, name), kinds)] or [
        name for name, dataset in _datasets(group) if _is_table(dataset, kinds)
    ]


def _datasets(store: Any) -> list[tuple[str, Any]]:
    """Return the datasets of all groups by their paths, up to a number of them."""
    import h5py

    datasets: list[tuple[str, Any]] = []

    def visit(name: str, item: Any) -> bool | None:
        if isinstance(item, h5py.Dataset) and "#" not in name:
            datasets.append((name, item))
        return True if len(datasets) > _MAX_NAMES else None

    store.visititems(visit)
    return datasets


class _Table:
    """A dataset of one or two axes, or one column of it; MATLAB's have their axes turned."""

    def __init__(self, dataset: Any, column: int | None = None) -> None:
        self.dataset, self.column = dataset, column
        shape = tuple(dataset.shape)
        self._turned = "MATLAB_class" in dataset.attrs and len(shape) == 2
        self.shape = shape[::-1] if self._turned else shape
        if self._turned and min(self.shape) == 1:
            self.shape = (max(self.shape),)
        if column is not None:
            self.shape = self.shape[:1]

    @property
    def unit(self) -> str:
        """The unit in its attribute `unit` or `units`; empty without one."""
        return _unit_of(self.dataset)

    def read(self, rows: int | None = None) -> NDArray[Any]:
        """Return its first rows; default: all."""
        check_stored(self.dataset)
        values = self.dataset[:, :rows].T if self._turned else self.dataset[:rows]
        if self.column is not None:
            values = values[:, self.column - 1]
        return np.asarray(values.reshape(-1)[:rows] if len(self.shape) == 1 else values)


def _unit_of(dataset: Any) -> str:
    for key in ("unit", "units", "Unit", "Units"):
        stated = dataset.attrs.get(key)
        if isinstance(stated, np.ndarray) and stated.size == 1:
            stated = stated.reshape(-1)[0]
        if isinstance(stated, bytes | str):
            return stated.decode(errors="replace").strip() if isinstance(stated, bytes) else stated.strip()
    return ""


def recording(file: DataFile) -> Recording:
    """Return the datasets of a file, and the columns of those with two axes, as channels."""
    from dynid.files.recordings import Recording, array_channels

    channels = []
    with _opened(file) as store:
        for path, dataset in _datasets(store):
            group, _, name = path.rpartition("/")
            if not _contents(dataset) or _is_table(dataset, "iuf"):
                table = _Table(dataset)
                channels += array_channels(name, path, table.shape, dataset.dtype, table.unit, group)

    def array(key: str) -> Any:
        path, column = key.rsplit(":", 1)
        with _opened(file) as store:
            return _Table(inside(store, path), int(column) or None).read().reshape(-1)

    return Recording(file, tuple(channels), array)


def _unless_elsewhere(group: Any, name: str) -> Any:
    """Return a member of a group, None where it is in another file."""
    try:
        return inside(group, name)
    except Refused:
        return None


def _is_table(item: Any, kinds: str) -> bool:
    import h5py

    return isinstance(item, h5py.Dataset) and item.dtype.kind in kinds and item.ndim in (1, 2)


def _times(
    file: DataFile, store: Any, names: Sequence[str], length: int, time: str | None, rows: int | None
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Return the times beside the data, and their rounding."""
    if time is not None and _found(file, store, time, "time", "iuf").shape != (length,):
        file.refuse(f"has {length} rows of data, but another number of times in '{time}'", key="time")
    folder = names[0].rpartition("/")[0]
    for name in [f"{folder}/{standard}".lstrip("/") for standard in TIME] if time is None else [time]:
        dataset = _unless_elsewhere(store, name)
        if time is not None or _is_table(dataset, "iuf"):
            table = _found(file, store, name, "time", "iuf")
            if table.shape != (length,):
                continue
            stored = table.read(rows)
            if table.unit and not unit_fits(table.unit, ["s"]):
                file.refuse(f"has '{name}' in {table.unit}, which is no time", key="time")
            factor = si_factor(table.unit, ["s"]) if table.unit else 1.0
            times = factor * np.asarray(stored, dtype=float)
            coarse = float(np.finfo(stored.dtype).eps) if stored.dtype.kind == "f" else 0.0
            return times, np.abs(np.nan_to_num(times, posinf=0, neginf=0)) * coarse
    return None, None


def present(file: DataFile, names: Sequence[str]) -> list[str]:
    """Return those of these names that a file has."""
    with _opened(file) as store:
        return [name for name in names if inside(store, name) is not None]


def modal_labels(file: DataFile, group: str) -> tuple[list[str], str]:
    """Return the sensors of the shapes of a modal analysis, and their normalisation."""
    with _opened(file) as store:
        labels = np.ravel(_member(store, f"{group}/channel"))
        normalisation = inside(store, f"{group}/shape").attrs.get("normalisation", "")
    return [_text(label) for label in labels], _text(normalisation)


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def complex_datasets(file: DataFile, name: str, key: str) -> NDArray[Any]:
    """Return a dataset of real or complex numbers as columns."""
    with _opened(file) as store:
        values = _numbers(file, store, name, key, "iufc")
    return values.reshape(len(values), -1)


def _numbers(
    file: DataFile, store: Any, name: str, key: str, kinds: str = "iuf", rows: int | None = None
) -> NDArray[Any]:
    """Return the first rows of a dataset of one or two axes, of these NumPy kinds; default: all."""
    return _found(file, store, name, key, kinds).read(rows)


def _found(file: DataFile, store: Any, name: str, key: str, kinds: str) -> _Table:
    """Return a dataset of one or two axes, or a column of it (``NAME:NUMBER``), of these NumPy kinds."""
    dataset, stem, number = _object(store, name), *name.rpartition(":")[::2]
    if dataset is None and number.isdecimal() and _is_table(matrix := _object(store, stem), kinds):
        columns = _Table(matrix).shape[1:] or (1,)
        if not 1 <= int(number) <= columns[0]:
            file.refuse(f"has {columns[0]} columns in '{stem}', no column {number}", key=key)
        return _Table(matrix, int(number))
    if not _is_table(dataset, kinds):
        datasets = _numeric(store, kinds)
        hint = did_you_mean(name, datasets) or (f"; it has {shortened(datasets, 20)}" if datasets else "")
        file.refuse(f"has no dataset of numbers '{name}'{hint}", key=key)
    return _Table(dataset)
