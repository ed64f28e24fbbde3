"""What an analysis returns: named arrays with axes, units and a status.

A `Result` is the only thing that crosses the floors: the store writes it, figures draw it, checks
compare it. It follows the netCDF model: a `Variable` whose only dimension bears its own name is the
coordinate of that dimension within its group.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import control
    import xarray

Scalar = str | bool | int | float

# Root attributes that tell how a result came about, and not what it is.
PROVENANCE = frozenset({"created", "dynid_version", "folder", "packages", "python", "scene"})
# Arrays that do: what the samples of a study are known by, and the text of the scene they vary.
PROVENANCE_ARRAYS = frozenset({"study/key", "study/scene"})
# Attributes of groups that tell what the work cost: they differ from run to run.
COSTS = frozenset({"seconds", "peak_megabytes"})
# Arrays of alternatives that do so.
COST_COLUMNS = frozenset({"time", "memory", "pareto", "runs"})


@dataclass(frozen=True, eq=False)
class Variable:
    """One named array: its axes, values, SI units and attributes.

    Values are float64, complex128, int64, bool, text (object array of str), or a structured array
    whose fields are such.
    """

    dims: tuple[str, ...]
    data: NDArray[Any]
    units: str = ""
    attrs: Mapping[str, Scalar] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.data.ndim != len(self.dims):
            raise ValueError(f"{self.data.ndim} axes, but dimensions {self.dims}")

    @property
    def shape(self) -> tuple[int, ...]:
        """The length of every axis."""
        return self.data.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the values."""
        return self.data.dtype

    def blocks(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield all values as (first entry along the first axis, values), in pieces that fit the memory."""
        yield 0, self.data

    def rows(self, start: int, stop: int) -> NDArray[Any]:
        """Return the entries start … stop - 1 along the first axis."""
        return self.data[start:stop]

    def entries(self, start: int, stop: int) -> NDArray[Any]:
        """Return the entries start … stop - 1 along the second axis, of all along the first."""
        return self.data[:, start:stop]

    def equals(self, other: Variable) -> bool:
        """Tell whether axes, units, attributes, type and every value are the same (NaN equals NaN)."""
        return (
            self.dims == other.dims
            and self.units == other.units
            and _same_attrs(self.attrs, other.attrs)
            and self.data.dtype == other.data.dtype
            and self.data.shape == other.data.shape
            and _same_values(self.data, other.data)
        )


def without_costs(attrs: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """Return the attributes that a run gives again."""
    return {name: value for name, value in attrs.items() if name not in COSTS}


def _same_values(a: NDArray[Any], b: NDArray[Any]) -> bool:
    if a.dtype.names:
        return all(_same_values(a[name], b[name]) for name in a.dtype.names)
    return bool(np.array_equal(a, b, equal_nan=a.dtype.kind in "fc"))


def _same_attrs(a: Mapping[str, Scalar], b: Mapping[str, Scalar]) -> bool:
    return a.keys() == b.keys() and all(_same_scalar(a[name], b[name]) for name in a)


def _same_scalar(a: Scalar, b: Scalar) -> bool:
    return type(a) is type(b) and (a == b or (a != a and b != b))


def as_kept(data: ArrayLike) -> NDArray[Any]:
    """Return values under one of the types that a result holds."""
    array = np.asarray(data)
    if array.dtype.names:
        return array.astype([(name, _stored_type(array.dtype[name])) for name in array.dtype.names])
    return array.astype(_stored_type(array.dtype), copy=False)


def _stored_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Give the type under which values of a type are kept."""
    kept = {
        "b": np.bool_,
        "i": np.int64,
        "u": np.int64,
        "f": np.float64,
        "c": np.complex128,
        "U": object,
        "O": object,
    }
    if dtype.kind not in kept:
        raise TypeError(f"a result holds numbers, truth values and texts, not {dtype}")
    return np.dtype(kept[dtype.kind])


def is_cost(path: str) -> bool:
    """Tell whether an array says what work cost, or follows from it: of benchmarks, and of alternatives."""
    holder, _, rest = path.partition("/")
    return holder in ("accuracy", "bench") and rest.rpartition("/")[2] in COST_COLUMNS


class Result(Mapping[str, Variable]):
    """Named arrays by path (`bond_graph/frequency_response/omega`), with attributes of the whole.

    Parameters
    ----------
    kind
        The kind of scene that produced it.
    title
        The scene's title.
    attrs
        Further root attributes (the seed; provenance: versions, creation time, the scene's text).
    """

    def __init__(self, kind: str, title: str = "", attrs: Mapping[str, Scalar] | None = None) -> None:
        self.kind = kind
        self.title = title
        self.attrs: dict[str, Scalar] = dict(attrs or {})
        self.group_attrs: dict[str, dict[str, Scalar]] = {}
        self._variables: dict[str, Variable] = {}

    def wants(self, path: str) -> bool:  # noqa: ARG002 - a selection looks at it
        """Tell whether an array is kept: what is not wanted need not be computed."""
        return True

    def wants_below(self, group: str) -> bool:  # noqa: ARG002 - a selection looks at it
        """Tell whether anything in a group is kept."""
        return True

    def add(
        self, path: str, data: ArrayLike, dims: tuple[str, ...] = (), units: str = "", **attrs: Scalar
    ) -> None:
        """Store one array under `path`; a path is written once."""
        self.put(path, Variable(dims, as_kept(data), units, attrs))

    def put(self, path: str, variable: Variable) -> None:
        """Store a variable as it is under `path`; a path is written once."""
        if path in self._variables:
            raise ValueError(f"{path} is already in the result")
        self._variables[path] = variable

    def add_axis(self, path: str, data: ArrayLike, units: str = "", **attrs: Scalar) -> None:
        """Store a coordinate: its dimension is the last part of its path."""
        self.add(path, data, (path.rsplit("/", 1)[-1],), units, **attrs)

    def annotate(self, group: str, **attrs: Scalar) -> None:
        """Set attributes of a group (the root result's own are in `attrs`)."""
        self.group_attrs.setdefault(group, {}).update(attrs)

    def value(self, path: str) -> Any:
        """Return the array at `path`, or the Python scalar where it has no axes."""
        data = self._variables[path].data
        return data.item() if data.ndim == 0 else data

    def to_control(self) -> control.StateSpace:
        """Return the state equations of a bond graph as a system of python-control.

        Signals keep their names, with an underscore for the dot that python-control does not allow:
        `m_s.f` is `m_s_f`.

        Raises
        ------
        UsageError
            Where the result holds no state equations, or an output differentiates an input.
        """
        from dynid.result.to_control import state_space

        return state_space(self)

    def to_xarray(self, group: str = "") -> xarray.Dataset:
        """Return the arrays of a group as a dataset of xarray, each dimension with its coordinate.

        Parameters
        ----------
        group
            Its path (`bond_graph/frequency_response`); absent: the arrays at the root.

        Raises
        ------
        UsageError
            Where the result has no such group.
        ImportError
            Where xarray is not installed.
        """
        from dynid.result.to_xarray import dataset

        return dataset(self, group)

    def merge(self, other: Result) -> None:
        """Take over every array and group attribute of another result."""
        for path, variable in other.items():
            self.put(path, variable)
        for group, attrs in other.group_attrs.items():
            self.annotate(group, **attrs)

    def equals(self, other: Result) -> bool:
        """Tell whether two results hold the same arrays, attributes and names, wherever they came from."""
        mine, theirs = self._annotations(), other._annotations()
        return (
            (self.kind, self.title) == (other.kind, other.title)
            and mine.keys() == theirs.keys()
            and all(_same_attrs(mine[group], theirs[group]) for group in mine)
            and self._variables.keys() == other._variables.keys()
            and all(
                variable.equals(other[path])
                for path, variable in self._variables.items()
                if not is_cost(path)
            )
        )

    def _annotations(self) -> dict[str, dict[str, Scalar]]:
        groups = {group: without_costs(attrs) for group, attrs in self.group_attrs.items()}
        groups = {group: attrs for group, attrs in groups.items() if attrs}
        root = {name: value for name, value in self.attrs.items() if name not in PROVENANCE}
        return groups | {"": groups.get("", {}) | root}

    def __getitem__(self, path: str) -> Variable:
        return self._variables[path]

    def __iter__(self) -> Iterator[str]:
        return iter(self._variables)

    def __len__(self) -> int:
        return len(self._variables)

    def __repr__(self) -> str:
        return f"<Result of {self.kind} {self.title!r}: {len(self)} arrays>"


class Selection(Result):
    """A result that keeps only some of what is added to it.

    Parameters
    ----------
    kind
        The kind of scene that produced it.
    wanted
        The paths of the arrays to keep.
    """

    def __init__(self, kind: str, wanted: Collection[str]) -> None:
        super().__init__(kind)
        self._wanted = wanted

    def wants(self, path: str) -> bool:
        """Tell whether an array is kept."""
        return path in self._wanted

    def wants_below(self, group: str) -> bool:
        """Tell whether anything in a group is kept."""
        return any(path.startswith(f"{group}/") for path in self._wanted)

    def add(
        self, path: str, data: ArrayLike, dims: tuple[str, ...] = (), units: str = "", **attrs: Scalar
    ) -> None:
        """Store one array under `path` if it is wanted."""
        if path in self._wanted:
            super().add(path, data, dims, units, **attrs)

    def put(self, path: str, variable: Variable) -> None:
        """Store a variable as it is under `path` if it is wanted."""
        if path in self._wanted:
            super().put(path, variable)


def common_unit(units: Iterable[str]) -> str:
    """Return the unit that all share, or nothing."""
    different = set(units)
    return different.pop() if len(different) == 1 else ""
