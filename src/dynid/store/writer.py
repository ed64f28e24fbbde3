"""Arrays of a result written to an open HDF5 file.

Every dimension of every array has a scale: a coordinate of the result where there is one, else the
numbers of the entries (marked `dynid_index`, and skipped on reading), so that xarray opens every group with
named coordinates.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping
from io import RawIOBase
from typing import Any

import numpy as np

from dynid.file_access import descriptor_of, read_at, write_at
from dynid.result import Result, Scalar, Variable, coordinate_path
from dynid.store.reader import OWN_ATTRS, SCALE_ATTRS

_MAX_ATTACHED = 4000  # HDF5 lists what is attached to a scale in an attribute of at most 64 KiB


def write_attrs(item: Any, attrs: Mapping[str, Scalar]) -> None:
    """Set attributes in one order, so that equal results give equal files."""
    for name in sorted(attrs):
        item.attrs[name] = attrs[name]


class ArrayWriter:
    """Writes the arrays of one result, with a scale for each dimension."""

    def __init__(self, file: Any, result: Result, hollow: Collection[str] = ()) -> None:
        self.result = result
        self.hollow = hollow  # arrays whose values come later
        self._attached: dict[str, int] = {}  # scale: arrays that use it
        # What is open already: looking a path up takes longer than writing an array.
        self._groups: dict[str, Any] = {"": file}
        self._datasets: dict[str, Any] = {}
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
            write_attrs(self._group(group), attrs)
        for path in paths:
            if not _is_coordinate(path, self.result[path]):
                variable = self.result[path]
                dataset = self._datasets[path]
                used: list[str] = []
                for axis, dim in enumerate(variable.dims):
                    scale = self._scale(path, dim, variable.data.shape[axis], used)
                    used.append(scale)
                    self._attached[scale] = self._attached.get(scale, 0) + 1
                    dataset.dims[axis].attach_scale(self._datasets[scale])
                if tuple(scale.rsplit("/", 1)[-1] for scale in used) != variable.dims:
                    dataset.attrs["dynid_dims"] = "\n".join(variable.dims)

    def _group(self, path: str) -> Any:
        if path not in self._groups:
            holder, _, name = path.rpartition("/")
            self._groups[path] = self._group(holder).require_group(name)
        return self._groups[path]

    def _dataset(self, path: str, shape: tuple[int, ...], **options: Any) -> Any:
        holder, _, name = path.rpartition("/")
        dataset = self._group(holder).create_dataset(name, shape, track_times=False, **options)
        self._datasets[path] = dataset
        return dataset

    def _write_array(self, path: str, variable: Variable) -> None:
        _check_name(path)
        if reserved := sorted(variable.attrs.keys() & (OWN_ATTRS | SCALE_ATTRS)):
            raise ValueError(f"{path}: the attribute '{reserved[0]}' is set by the store")
        dtype = _stored_type(variable.data.dtype)
        data = None if path in self.hollow else variable.data.astype(dtype)
        dataset = self._dataset(path, variable.data.shape, data=data, dtype=dtype)
        if _is_coordinate(path, variable):
            dataset.make_scale(path.rsplit("/", 1)[-1])
        write_attrs(dataset, {**variable.attrs, **({"units": variable.units} if variable.units else {})})

    def _scale(self, path: str, dim: str, length: int, used: list[str]) -> str:
        """Return the coordinate of a dimension in the nearest group, else a scale of entry numbers."""
        group = path.rpartition("/")[0]
        coordinate = coordinate_path(self.result, path, dim)
        if coordinate and self.result[coordinate].data.size == length and self._is_free(coordinate, used):
            return coordinate
        scale_path = f"{group}/{dim}" if group else dim
        _check_name(scale_path)
        name, count = scale_path, 1
        while name in self._taken:
            # An array of the same group may have brought it; a result's own names are not in `file` as index.
            existing = self._datasets.get(name)
            if (
                existing is not None
                and "dynid_index" in existing.attrs
                and existing.shape == (length,)
                and self._is_free(name, used)
            ):
                return name
            count += 1
            name = f"{scale_path}_{count}"
        dataset = self._dataset(name, (length,), data=np.arange(1, length + 1))
        dataset.make_scale(name.rsplit("/", 1)[-1])
        dataset.attrs["dynid_index"] = True
        self._taken.add(name)
        return name

    def _is_free(self, scale: str, used: list[str]) -> bool:
        return scale not in used and self._attached.get(scale, 0) < _MAX_ATTACHED


def _is_coordinate(path: str, variable: Variable) -> bool:
    return variable.dims == (path.rsplit("/", 1)[-1],)


def _check_name(path: str) -> None:
    if path == "scene" or not all(word.strip(".") and "\0" not in word for word in path.split("/")):
        raise ValueError(f"'{path}' cannot be the name of an array")


def _groups_above(group: str) -> Iterator[str]:
    while group:
        yield group
        group = group.rpartition("/")[0]
    yield ""


def _stored_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    import h5py

    if dtype.names:
        return np.dtype([(name, _stored_type(dtype[name])) for name in dtype.names])
    return h5py.string_dtype() if dtype.kind == "O" else dtype


class Sink(RawIOBase):
    """An existing file open for reading and writing, as h5py takes it."""

    _descriptor = -1  # until it is open

    def __init__(self, path: str) -> None:
        self._descriptor = descriptor_of(path, links=True)
        self._place = 0
        self._end = os.fstat(self._descriptor).st_size
        self._kept: list[tuple[int, bytes]] = []  # content that the disk did not take, in order
        self.error: OSError | None = None

    def check(self) -> None:
        """Raise the first error, if any."""
        if self.error is not None:
            raise self.error

    def close(self) -> None:
        """Close the file."""
        if self._descriptor >= 0:
            descriptor, self._descriptor = self._descriptor, -1
            os.close(descriptor)
        super().close()

    def write(self, content: Any) -> int:
        """Write at the current place."""
        view = memoryview(content).cast("B")
        done = 0
        try:
            while self.error is None and done < len(view):
                done += write_at(self._descriptor, view[done:], self._place + done)
        except OSError as error:
            self.error = error
        if done < len(view):
            self._kept.append((self._place + done, bytes(view[done:])))
        self._place += len(view)
        self._end = max(self._end, self._place)
        return len(view)

    def readinto(self, buffer: Any) -> int:
        """Read from the current place."""
        view = memoryview(buffer).cast("B")
        count = max(0, min(len(view), self._end - self._place))
        content = read_at(self._descriptor, count, self._place)
        view[:count] = content.ljust(count, b"\0")
        for offset, kept in self._kept:
            begin, end = max(offset, self._place), min(offset + len(kept), self._place + count)
            if begin < end:
                view[begin - self._place : end - self._place] = kept[begin - offset : end - offset]
        self._place += count
        return count

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move the current place."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._end}[whence]
        self._place = base + offset
        return self._place

    def truncate(self, size: int | None = None) -> int:
        """Set the length."""
        self._end = self._place if size is None else size
        try:
            if self.error is None:
                os.ftruncate(self._descriptor, self._end)
        except OSError as error:
            self.error = error
        return self._end
