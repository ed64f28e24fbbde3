"""An open HDF5 file to a result, trusting nothing in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.result import Result, Scalar, Variable, as_kept
from dynid.store.formats import as_current, refuse_unknown

INTERRUPTED = "interrupted"
SCALE_ATTRS = frozenset({"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"})
OWN_ATTRS = frozenset({"units", "dynid_dims", "dynid_index"})
ROOT_ATTRS = frozenset({"format", "kind", "title", "status", "scene"})
_MAX_DEPTH = 64
_MAX_EXPANSION = 2000  # what a compressed array may grow by on reading; deflate reaches 1032
_BLOCK = 2**20  # values that are read at a time


@contextmanager
def reading(name: str) -> Iterator[None]:
    """Turn whatever goes wrong in reading a file into a `FileError`."""
    try:
        yield
    except FileNotFoundError:
        raise FileError(f"{name}: no such file", names=[name]) from None
    except PermissionError:
        raise FileError(f"{name} cannot be read: permission denied", names=[name]) from None
    except (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError, MemoryError) as error:
        # A damaged file can make h5py raise nearly anything.
        if name.endswith((".yaml", ".yml")):
            remedy = f"If it is a scene, name the file that `dynid run {name}` writes."
            raise FileError(f"{name} is not a result", remedy=remedy, names=[name]) from error
        problem = f"{name} is not an HDF5 file, or a damaged one"
        raise FileError(problem, remedy="Run its scene again.", names=[name]) from error


class StoredVariable(Variable):
    """An array that stays in its open file: what is asked for is read, and not kept."""

    _dataset: Any
    _file: str

    def __init__(self, dataset: Any, path: str, name: str) -> None:
        _check_stored(dataset, path, name)
        for key, value in (
            ("dims", _dims(dataset)),
            ("units", str(dataset.attrs.get("units", ""))),
            ("attrs", _attrs(dataset)),
            ("_dataset", dataset),
            ("_file", name),
        ):
            object.__setattr__(self, key, value)  # variables do not change

    @property
    def data(self) -> NDArray[Any]:
        """All values, read now."""
        return self._take(...)

    def loaded(self) -> Variable:
        """Return the same with its values in memory."""
        return Variable(self.dims, self.data, self.units, self.attrs)

    @property
    def shape(self) -> tuple[int, ...]:
        """The length of every axis."""
        shape: tuple[int, ...] = self._dataset.shape
        return shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the values."""
        return self.rows(0, 0).dtype if self.shape else self.data.dtype

    def blocks(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield all values as (first entry along the first axis, values), some megabytes at a time."""
        if not self.shape:
            yield 0, self.data
            return
        step = max(1, _BLOCK // max(1, int(np.prod(self.shape[1:], dtype=np.int64))))
        for start in range(0, self.shape[0], step):
            yield start, self.rows(start, start + step)

    def rows(self, start: int, stop: int) -> NDArray[Any]:
        """Return the entries start … stop - 1 along the first axis."""
        return self._take(slice(start, stop))

    def entries(self, start: int, stop: int) -> NDArray[Any]:
        """Return the entries start … stop - 1 along the second axis, of all along the first."""
        return self._take((slice(None), slice(start, stop)))

    def _take(self, place: Any) -> NDArray[Any]:
        with reading(self._file):
            return as_kept(_read(self._dataset, place))


def read_root(file: Any, name: str, stored: bool = False, partial: bool = False) -> Result:
    """Read the result that an open file holds.

    Parameters
    ----------
    file
        The open file.
    name
        Its name, for messages.
    stored
        Whether arrays stay in the file until they are asked for, which the file must stay open for.
    partial
        Whether a result that was interrupted will do.

    Raises
    ------
    FileError
        When it holds none, an incomplete one, or one of a newer format.
    """
    root = _attrs(file)
    _check_root(root, name, partial)
    attrs = {key: value for key, value in root.items() if key not in ROOT_ATTRS}
    scene = file.get("scene", getlink=True)
    if scene is not None:
        attrs["scene"] = str(_values(_hard_item(file, "scene"), "scene", name).item())
    result = Result(str(root["kind"]), str(root.get("title", "")), attrs)
    for path, item in _items(file):
        if hasattr(item, "shape"):
            if path != "scene" and "dynid_index" not in item.attrs:
                variable = StoredVariable(item, path, name)
                result.put(path, variable if stored else variable.loaded())
        elif attrs := _attrs(item):
            result.annotate(path, **attrs)
    return as_current(result, int(root["format"]))


def _check_root(root: dict[str, Scalar], name: str, partial: bool) -> None:
    number = root.get("format")
    if not isinstance(number, int) or "kind" not in root:
        raise FileError(f"{name} is HDF5, but not a result of dynid", names=[name])
    refuse_unknown(number, name)
    if root.get("status") not in ("complete", INTERRUPTED if partial else "complete"):
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


def _dims(dataset: Any) -> tuple[str, ...]:
    if "dynid_dims" in dataset.attrs:
        return tuple(str(dataset.attrs["dynid_dims"]).split("\n"))
    if _is_scale(dataset):
        return (str(dataset.name).rsplit("/", 1)[-1],)
    return tuple(_dim_name(dim) or f"axis_{axis}" for axis, dim in enumerate(dataset.dims, 1))


def _is_scale(dataset: Any) -> bool:
    # As H5DSis_scale, which frees its buffer twice in HDF5 2.0 where the class is another one, and aborts.
    return dataset.attrs.get("CLASS") in (b"DIMENSION_SCALE", "DIMENSION_SCALE")


def _dim_name(dim: Any) -> str:
    # A scale bears its name as an attribute; asking HDF5 for its path would search the whole file.
    name = dim[0].attrs.get("NAME", "") if len(dim) else ""
    return name.decode() if isinstance(name, bytes) else str(name)


def _values(dataset: Any, path: str, name: str) -> NDArray[Any]:
    _check_stored(dataset, path, name)
    return _read(dataset, ...)


def _check_stored(dataset: Any, path: str, name: str) -> None:
    if dataset is None or dataset.is_virtual or dataset.external or dataset.shape is None:
        raise FileError(f"{name}: '{path}' is not an array stored in the file itself", names=[name])
    if dataset.nbytes > _MAX_EXPANSION * dataset.id.get_storage_size():
        raise FileError(f"{name}: '{path}' claims more values than the file holds", names=[name])


def _read(dataset: Any, place: Any) -> NDArray[Any]:
    """Read some entries of an array, with texts as such."""
    if dataset.dtype.kind in "OS":
        return np.array(dataset.asstr()[place], dtype=object)
    data: NDArray[Any] = np.asarray(dataset[place])
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
