"""Arrays of a result written to an open HDF5 file.

Every dimension of every array has a scale: a coordinate of the result where there is one, else the
numbers of the entries (marked `dynid_index`, and skipped on reading), so that xarray opens every group with
named coordinates.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from dynid.result import Result, Scalar, Variable
from dynid.store.reader import OWN_ATTRS, SCALE_ATTRS

_MAX_ATTACHED = 4000  # HDF5 lists what is attached to a scale in an attribute of at most 64 KiB


def write_attrs(item: Any, attrs: Mapping[str, Scalar]) -> None:
    """Set attributes in one order, so that equal results give equal files."""
    for name in sorted(attrs):
        item.attrs[name] = attrs[name]


class ArrayWriter:
    """Writes the arrays of one result, with a scale for each dimension."""

    def __init__(self, file: Any, result: Result, hollow: Collection[str] = ()) -> None:
        self.file = file
        self.result = result
        self.hollow = hollow  # arrays whose values come later
        self._attached: dict[str, int] = {}  # scale: arrays that use it
        self._taken: set[str] = set()  # paths of arrays and groups
        for path in (*result, *result.group_attrs):
            self._taken |= {path, *_groups_above(path)}

    def write(self) -> None:
        """Write all arrays, then the groups' attributes, then connect arrays and scales."""
        paths = sorted(self.result)
        for path in paths:
            self._write_array(path, self.result[path])
        for group, attrs in sorted(self.result.group_attrs.items()):
            if not group:
                continue
            _check_name(group)
            if reserved := sorted(attrs.keys() & OWN_ATTRS):
                raise ValueError(f"{group}: the attribute '{reserved[0]}' is set by the store")
            write_attrs(self.file.require_group(group), attrs)
        for path in paths:
            if not _is_coordinate(path, self.result[path]):
                self._attach(path, self.result[path])

    def _write_array(self, path: str, variable: Variable) -> None:
        _check_name(path)
        if reserved := sorted(variable.attrs.keys() & (OWN_ATTRS | SCALE_ATTRS)):
            raise ValueError(f"{path}: the attribute '{reserved[0]}' is set by the store")
        dtype = _stored_type(variable.data.dtype)
        data = None if path in self.hollow else variable.data.astype(dtype)
        dataset = self.file.create_dataset(
            path, variable.data.shape, data=data, dtype=dtype, track_times=False
        )
        if _is_coordinate(path, variable):
            dataset.make_scale(path.rsplit("/", 1)[-1])
        write_attrs(dataset, {**variable.attrs, **({"units": variable.units} if variable.units else {})})

    def _attach(self, path: str, variable: Variable) -> None:
        dataset = self.file[path]
        used: list[str] = []
        for axis, dim in enumerate(variable.dims):
            scale = self._scale(path, dim, variable.data.shape[axis], used)
            used.append(scale)
            self._attached[scale] = self._attached.get(scale, 0) + 1
            dataset.dims[axis].attach_scale(self.file[scale])
        if tuple(scale.rsplit("/", 1)[-1] for scale in used) != variable.dims:
            dataset.attrs["dynid_dims"] = "\n".join(variable.dims)

    def _scale(self, path: str, dim: str, length: int, used: list[str]) -> str:
        """Return the coordinate of a dimension in the nearest group, else a scale of entry numbers."""
        group = path.rpartition("/")[0]
        for holder in _groups_above(group):
            coordinate = _join(holder, dim)
            variable = self.result.get(coordinate)
            if variable is not None and _is_coordinate(coordinate, variable):
                if variable.data.size == length and self._is_free(coordinate, used):
                    return coordinate
                break
        return self._index_scale(_join(group, dim), length, used)

    def _is_free(self, scale: str, used: list[str]) -> bool:
        return scale not in used and self._attached.get(scale, 0) < _MAX_ATTACHED

    def _index_scale(self, wanted: str, length: int, used: list[str]) -> str:
        _check_name(wanted)
        name, count = wanted, 1
        while name in self._taken:
            # An array of the same group may have brought it; a result's own names are not in `file` as index.
            existing = self.file.get(name)
            is_index = existing is not None and "dynid_index" in existing.attrs
            if is_index and existing.shape == (length,) and self._is_free(name, used):
                return name
            count += 1
            name = f"{wanted}_{count}"
        dataset = self.file.create_dataset(name, data=np.arange(1, length + 1), track_times=False)
        dataset.make_scale(name.rsplit("/", 1)[-1])
        dataset.attrs["dynid_index"] = True
        self._taken.add(name)
        return name


def _is_coordinate(path: str, variable: Variable) -> bool:
    return variable.dims == (path.rsplit("/", 1)[-1],)


def _check_name(path: str) -> None:
    if path == "scene" or not all(part.strip(".") and "\0" not in part for part in path.split("/")):
        raise ValueError(f"'{path}' cannot be the name of an array")


def _groups_above(group: str) -> Iterator[str]:
    while group:
        yield group
        group = group.rpartition("/")[0]
    yield ""


def _join(group: str, name: str) -> str:
    return f"{group}/{name}" if group else name


def _stored_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    import h5py

    if dtype.names:
        return np.dtype([(name, _stored_type(dtype[name])) for name in dtype.names])
    return h5py.string_dtype() if dtype.kind == "O" else dtype
