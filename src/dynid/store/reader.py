"""Results read from HDF5 files, without trusting their contents.

Every format ever released is read, each by one step to the next. Today there is one; a second one comes with
the step `STEPS[1]` from results of the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.hdf5 import Refused, check_stored
from dynid.result import REJECTED, Result, Scalar, Variable, VariableView, as_kept
from dynid.units import FrequencyUnit

#: Format of the files that are written.
CURRENT = 1

#: For an older format: the step from its results to those of the next format.
STEPS: dict[int, Callable[[Result], Result]] = {}

INTERRUPTED = "interrupted"
SCALE_ATTRS = frozenset({"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"})
OWN_ATTRS = frozenset({"units", "dynid_dims", "dynid_index"})
ROOT_ATTRS = frozenset({"format", "kind", "title", "status", "scene"})
_MAX_GROUP_DEPTH = 64
_BLOCK = 2**20  # values that are read at a time


@contextmanager
def reading(name: str) -> Iterator[None]:
    """Turn any failure to read a file into a `FileError`."""
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


class StoredVariable(VariableView):
    """An array that stays in its open file: values are read on request, and not kept."""

    _dataset: Any
    _file: str

    def __init__(self, dataset: Any, path: str, name: str) -> None:
        _check_stored(dataset, path, name)
        units = str(dataset.attrs.get("units", ""))
        super().__init__(_dims(dataset), units, _attrs(dataset), _dataset=dataset, _file=name)

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

    def _take(self, selection: Any) -> NDArray[Any]:
        with reading(self._file):
            return as_kept(_read(self._dataset, selection))


def read_root(file: Any, name: str, stored: bool = False, partial: bool = False) -> Result:
    """Read the result that an open file holds; its name is for messages.

    `stored` leaves arrays in the file, which must stay open, until they are requested; `partial` accepts an
    interrupted result.

    Raises
    ------
    FileError
        When it holds none, an incomplete one, or one of a newer format.
    """
    root = _attrs(file)
    number = root.get("format")
    if not isinstance(number, int) or "kind" not in root:
        raise FileError(f"{name} is HDF5, but not a result of dynid", names=[name])
    refuse_unknown(number, name)
    if root.get("status") not in ("complete", REJECTED, INTERRUPTED if partial else "complete"):
        raise FileError(f"{name} is not complete", remedy="Run its scene again.", names=[name])
    attrs = {key: value for key, value in root.items() if key not in ROOT_ATTRS}
    if root["status"] == REJECTED:
        attrs["status"] = REJECTED
    scene = file.get("scene", getlink=True)
    if scene is not None:
        text = _hard_item(file, "scene")
        _check_stored(text, "scene", name)
        attrs["scene"] = str(_read(text, ...).item())
    result = Result(str(root["kind"]), str(root.get("title", "")), attrs)
    for path, item in _items(file):
        if hasattr(item, "shape"):
            if path != "scene" and "dynid_index" not in item.attrs:
                variable = StoredVariable(item, path, name)
                result.put(path, variable if stored else variable.loaded())
        elif attrs := _attrs(item):
            result.annotate(path, **attrs)
    return as_current(result, int(root["format"]))


def refuse_unknown(number: int, name: str) -> None:
    """Raise `FileError` for a file of a format that this version cannot read, with those that it can."""
    if number > CURRENT:
        problem = f"{name} has format {number}; this dynid reads formats up to {CURRENT}"
        raise FileError(problem, remedy="Update dynid to read it.", names=[name])
    if number < CURRENT and number not in STEPS:
        problem = f"{name} has format {number}, which no dynid has ever written"
        raise FileError(problem, remedy="Run its scene again.", names=[name])


def as_current(result: Result, number: int) -> Result:
    """Return a result read from a file of an older format as the current format holds it."""
    for older in range(number, CURRENT):
        result = STEPS[older](result)
    return result


def _items(file: Any) -> Iterator[tuple[str, Any]]:
    """Yield groups and arrays; soft and external links are skipped, and cycles end."""
    stack = [("", file)]
    seen = {hash(file.id)}
    while stack:
        above, group = stack.pop()
        below = []
        for key in sorted(group):
            path = f"{above}/{key}" if above else key
            item = _hard_item(group, key)
            if item is None or path.count("/") >= _MAX_GROUP_DEPTH:
                continue
            if not hasattr(item, "shape"):
                if hash(item.id) in seen:
                    continue
                seen.add(hash(item.id))
                below.append((path, item))
            yield path, item
        stack += reversed(below)


def _hard_item(group: Any, key: str) -> Any:
    import h5py

    if not isinstance(group.get(key, getlink=True), h5py.HardLink):
        return None
    item = group[key]
    return item if isinstance(item, h5py.Group | h5py.Dataset) else None


def _dims(dataset: Any) -> tuple[str, ...]:
    if "dynid_dims" in dataset.attrs:
        return tuple(str(dataset.attrs["dynid_dims"]).split("\n"))
    # Like H5DSis_scale, which frees its buffer twice in HDF5 2.0 for another class, and aborts.
    if dataset.attrs.get("CLASS") in (b"DIMENSION_SCALE", "DIMENSION_SCALE"):
        return (str(dataset.name).rsplit("/", 1)[-1],)
    names = []
    for axis, dim in enumerate(dataset.dims, 1):
        # A scale has its name as an attribute; requesting its path from HDF5 would search the whole file.
        name = dim[0].attrs.get("NAME", "") if len(dim) else ""
        names.append((name.decode() if isinstance(name, bytes) else str(name)) or f"axis_{axis}")
    return tuple(names)


def _check_stored(dataset: Any, path: str, name: str) -> None:
    if dataset is None or not hasattr(dataset, "shape"):
        raise FileError(f"{name}: '{path}' is not an array stored in the file itself", names=[name])
    try:
        check_stored(dataset)
    except Refused as error:
        raise FileError(f"{name}: {error}", names=[name]) from error


def _read(dataset: Any, selection: Any) -> NDArray[Any]:
    """Return some entries of an array, with texts decoded."""
    if dataset.dtype.kind in "OS":
        return np.array(dataset.asstr()[selection], dtype=object)
    data: NDArray[Any] = np.asarray(dataset[selection])
    if not data.dtype.names:
        return data
    names = data.dtype.names
    texts = [name for name in names if data.dtype[name].kind in "OS"]
    fields = [(name, np.dtype(object) if name in texts else data.dtype[name]) for name in names]
    decoded = np.empty(data.shape, fields)
    for name in names:
        column = data[name]
        decoded[name] = np.vectorize(bytes.decode, otypes=[object])(column) if name in texts else column
    return decoded


def _attrs(item: Any) -> dict[str, Scalar]:
    """Return an object's own attributes; those with several values belong to other tools."""
    scalars: dict[str, Scalar] = {}
    for name in item.attrs.keys() - SCALE_ATTRS - OWN_ATTRS:
        value = item.attrs[name]
        value = value.item() if isinstance(value, np.generic) else value
        if isinstance(value, str | bool | int | float):
            scalars[name] = value
    return scalars


#: Names of arrays of frequencies, and of groups that hold one with its limits. Angular velocities are none.
_NAMES = frozenset(
    {"omega", "choice_omega", "natural_frequency", "frequency", "frequencies", "reference"}
) | {
    *("frequency_start", "frequency_measured", "frequency_uncertainty", "reference_uncertainty", "counted"),
    *("frequency_standard_error", "bandwidth", "gain_crossover", "phase_crossover"),
    *("peak_frequency", "half_power_low", "half_power_high"),
}


def is_frequency(path: str, variable: Variable) -> bool:
    """Return True for an array of frequencies in rad/s."""
    *_, group, name = ("", *path.split("/"))
    return variable.units == "rad/s" and variable.dtype.kind == "f" and not _NAMES.isdisjoint((group, name))


def in_unit(path: str, variable: Variable, unit: FrequencyUnit) -> Variable:
    """Return an array, of frequencies in a unit."""
    if unit.factor == 1 or not is_frequency(path, variable):
        return variable
    return _Scaled(variable, unit)


class _Scaled(VariableView):
    """An array of frequencies in another unit; values are converted when they are read."""

    _base: Variable
    _factor: float

    def __init__(self, base: Variable, unit: FrequencyUnit) -> None:
        super().__init__(base.dims, unit.name, base.attrs, _base=base, _factor=unit.factor)

    @property
    def data(self) -> NDArray[Any]:
        """All values."""
        return np.asarray(self._base.data * self._factor)

    @property
    def shape(self) -> tuple[int, ...]:
        """The length of every axis."""
        return self._base.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the values."""
        return self._base.dtype

    def blocks(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield all values in pieces that fit the memory."""
        for start, block in self._base.blocks():
            yield start, block * self._factor

    def rows(self, start: int, stop: int) -> NDArray[Any]:
        """Return the entries start … stop - 1 along the first axis."""
        return np.asarray(self._base.rows(start, stop) * self._factor)

    def entries(self, start: int, stop: int) -> NDArray[Any]:
        """Return the entries start … stop - 1 along the second axis, of all along the first."""
        return np.asarray(self._base.entries(start, stop) * self._factor)
