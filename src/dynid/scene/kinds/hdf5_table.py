"""Tables out of HDF5 files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.hdf5 import open_hdf5
from dynid.scene.kinds.table import TIME, DataFile, Table, are_numbers
from dynid.words import did_you_mean

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Where the columns are looked for when a scene names none.
_MEASURED = ("measured", "identification/measurement/measured")


def read_datasets(
    file: DataFile, columns: Sequence[str | int] | None, single: bool = False, time: str | None = None
) -> Table:
    """Read datasets as one table: those that are named, else the columns of the measured ones.

    `time` is the dataset of the times; absent: `time` or `t` beside the first one.
    """
    with _opened(file) as store:
        named = columns is not None and not are_numbers(columns)
        if columns is not None and named:
            names = [str(name) for name in columns]
        elif single and columns is None:
            names = [_only_dataset(file, store)]
        else:
            names = [next((name for name in _MEASURED if name in store), _MEASURED[0])]
        key = "column" if single else "columns"
        parts = [_dataset(file, store, name, key) for name in names]
        if any(len(part) != len(parts[0]) for part in parts) or (
            len(parts) > 1 and any(part.ndim != 1 for part in parts)
        ):
            file.refuse(f"has no columns of one length in {', '.join(names)}", key=key)
        if single and (named or columns is None) and parts[0][:1].size > 1:
            file.refuse(f"has {parts[0].shape[1]} columns in '{names[0]}'", "Give a number.", key=key)
        values = np.column_stack(parts)
        return Table(file, [], values, None, *_times(file, store, names, len(values), time))


@contextmanager
def _opened(file: DataFile) -> Iterator[Any]:
    """Open a file, and say of this file whatever goes wrong with reading it."""
    try:
        with open_hdf5(file.path) as store:
            yield store
    except (OSError, RuntimeError, ValueError) as error:
        file.refuse(f"cannot be read as HDF5: {error}")


def _only_dataset(file: DataFile, store: Any) -> str:
    known = [name for name in _numeric(store) if name not in TIME]
    if len(known) != 1:
        named = f": {', '.join(known)}" if known else ""
        file.refuse(
            f"has {len(known) or 'no'} datasets of numbers beside the time{named}",
            "Say which one drives: column: NAME.",
            key="column",
        )
    return known[0]


def _numeric(group: Any, kinds: str = "iuf") -> list[str]:
    import h5py

    return [
        name
        for name, value in group.items()
        if isinstance(value, h5py.Dataset) and value.dtype.kind in kinds and value.ndim in (1, 2)
    ]


def _times(
    file: DataFile, store: Any, names: Sequence[str], rows: int, time: str | None
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Return the times beside the data, and what they are rounded by."""
    group = store[names[0]].parent
    if time is not None and _dataset(file, store, time, "time").shape != (rows,):
        file.refuse(f"has {rows} rows of data, but another number of times in '{time}'", key="time")
    if time is not None:
        group = store[time].parent
    for name in TIME if time is None else (time.rpartition("/")[2],):
        if name in _numeric(group) and group[name].shape == (rows,):
            stored = group[name][()]
            times = np.asarray(stored, dtype=float)
            coarse = float(np.finfo(stored.dtype).eps) if stored.dtype.kind == "f" else 0.0
            return times, np.abs(np.nan_to_num(times, posinf=0, neginf=0)) * coarse
    return None, None


def _dataset(file: DataFile, store: Any, name: str, key: str) -> NDArray[np.float64]:
    return np.asarray(_numbers(file, store, name, key), dtype=float)


def present(file: DataFile, names: Sequence[str]) -> list[str]:
    """Return which of these names a file has."""
    with _opened(file) as store:
        return [name for name in names if name in store]


def complex_datasets(file: DataFile, name: str, key: str) -> NDArray[Any]:
    """Return a dataset of real or complex numbers as columns."""
    with _opened(file) as store:
        found = _numbers(file, store, name, key, "iufc")
    return found.reshape(len(found), -1)


def _numbers(file: DataFile, store: Any, name: str, key: str, kinds: str = "iuf") -> NDArray[Any]:
    """Return a dataset of one or two axes, of numbers of these NumPy kinds."""
    import h5py

    found = store.get(name)
    if not isinstance(found, h5py.Dataset) or found.dtype.kind not in kinds or found.ndim not in (1, 2):
        known = _numeric(store, kinds)
        hint = did_you_mean(name, known) or (f"; it has {', '.join(known)}" if known else "")
        file.refuse(f"has no dataset of numbers '{name}'{hint}", key=key)
    return np.asarray(found[()])
