"""An open HDF5 file to a result, trusting nothing in it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.result import Result, Scalar
from dynid.store.formats import as_current, refuse_unknown

SCALE_ATTRS = frozenset({"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"})
OWN_ATTRS = frozenset({"units", "dynid_dims", "dynid_index"})
ROOT_ATTRS = frozenset({"format", "kind", "title", "status", "scene"})
_MAX_DEPTH = 64
_MAX_EXPANSION = 2000  # what a compressed array may grow by on reading; deflate reaches 1032


def read_root(file: Any, name: str) -> Result:
    """Read the result that an open file holds.

    Raises
    ------
    FileError
        When it holds none, an incomplete one, or one of a newer format.
    """
    root = _attrs(file)
    _check_root(root, name)
    attrs = {key: value for key, value in root.items() if key not in ROOT_ATTRS}
    scene = file.get("scene", getlink=True)
    if scene is not None:
        attrs["scene"] = str(_values(_hard_item(file, "scene"), "scene", name).item())
    result = Result(str(root["kind"]), str(root.get("title", "")), attrs)
    for path, item in _items(file):
        if hasattr(item, "shape"):
            if path != "scene" and "dynid_index" not in item.attrs:
                _read_array(result, path, item, name)
        elif attrs := _attrs(item):
            result.annotate(path, **attrs)
    return as_current(result, int(root["format"]))


def _check_root(root: dict[str, Scalar], name: str) -> None:
    number = root.get("format")
    if not isinstance(number, int) or "kind" not in root:
        raise FileError(f"{name} is HDF5, but not a result of dynid", names=[name])
    refuse_unknown(number, name)
    if root.get("status") != "complete":
        raise FileError(f"{name} is not complete", remedy="Run its scene again.", names=[name])


def _items(file: Any) -> Iterator[tuple[str, Any]]:
    """Walk through groups and arrays; soft and external links are left alone, and cycles end."""
    stack = [("", file)]
    seen = {hash(file.id)}
    while stack:
        above, group = stack.pop()
        for key in sorted(group, reverse=True):
            path = f"{above}/{key}" if above else key
            item = _hard_item(group, key)
            if item is None or path.count("/") >= _MAX_DEPTH:
                continue
            if not hasattr(item, "shape"):
                if hash(item.id) in seen:
                    continue
                seen.add(hash(item.id))
                stack.append((path, item))
            yield path, item


def _hard_item(group: Any, key: str) -> Any:
    import h5py

    if not isinstance(group.get(key, getlink=True), h5py.HardLink):
        return None
    item = group[key]
    return item if isinstance(item, h5py.Group | h5py.Dataset) else None


def _read_array(result: Result, path: str, dataset: Any, name: str) -> None:
    data = _values(dataset, path, name)
    attrs = _attrs(dataset)
    units = dataset.attrs.get("units", "")
    result.add(path, data, _dims(dataset), str(units), **attrs)


def _dims(dataset: Any) -> tuple[str, ...]:
    if "dynid_dims" in dataset.attrs:
        return tuple(str(dataset.attrs["dynid_dims"]).split("\n"))
    if dataset.is_scale:
        return (str(dataset.name).rsplit("/", 1)[-1],)
    return tuple(_dim_name(dim) or f"axis_{axis}" for axis, dim in enumerate(dataset.dims, 1))


def _dim_name(dim: Any) -> str:
    # A scale bears its name as an attribute; asking HDF5 for its path would search the whole file.
    name = dim[0].attrs.get("NAME", "") if len(dim) else ""
    return name.decode() if isinstance(name, bytes) else str(name)


def _values(dataset: Any, path: str, name: str) -> NDArray[Any]:
    if dataset is None or dataset.is_virtual or dataset.external or dataset.shape is None:
        raise FileError(f"{name}: '{path}' is not an array stored in the file itself", names=[name])
    if dataset.nbytes > _MAX_EXPANSION * dataset.id.get_storage_size():
        raise FileError(f"{name}: '{path}' claims more values than the file holds", names=[name])
    if dataset.dtype.kind in "OS":
        return np.array(dataset.asstr()[...], dtype=object)
    data: NDArray[Any] = np.asarray(dataset[...])
    return _with_texts(data) if data.dtype.names else data


def _with_texts(table: NDArray[Any]) -> NDArray[Any]:
    """Decode the text fields of a table."""
    names = table.dtype.names or ()
    texts = [name for name in names if table.dtype[name].kind in "OS"]
    fields = [(name, np.dtype(object) if name in texts else table.dtype[name]) for name in names]
    decoded = np.empty(table.shape, fields)
    for name in names:
        column = table[name]
        decoded[name] = np.vectorize(bytes.decode, otypes=[object])(column) if name in texts else column
    return decoded


def _attrs(item: Any) -> dict[str, Scalar]:
    """Give an object's own attributes; what is not a single value belongs to other tools."""
    found: dict[str, Scalar] = {}
    for name in item.attrs.keys() - SCALE_ATTRS - OWN_ATTRS:
        value = item.attrs[name]
        value = value.item() if isinstance(value, np.generic) else value
        if isinstance(value, str | bool | int | float):
            found[name] = value
    return found
