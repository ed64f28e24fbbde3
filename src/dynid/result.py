"""Results of analyses: named arrays with axes, units and attributes.

A `Result` is the only object that crosses the layers: the store writes it, figures draw it, checks
compare it. It follows the netCDF model: a `Variable` whose only dimension has its own name is the
coordinate of that dimension within its group.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import lru_cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import UnknownPath, UsageError
from dynid.suggestions import did_you_mean_path

if TYPE_CHECKING:
    import control
    import pandas
    import xarray

T = TypeVar("T")

#: The module that shows results in notebooks, of a higher layer.
_NOTEBOOK = "dynid.report.notebook"
#: Group of the state equations of a bond graph.
_STATE_SPACE = "bond_graph/state_space"

Scalar = str | bool | int | float

# Root attributes on the origin of a result, which comparisons ignore.
PROVENANCE = frozenset({"created", "dynid_version", "folder", "packages", "python", "scene"})
# Arrays on the origin: the keys of the samples of a study, and the text of the varied scene.
PROVENANCE_ARRAYS = frozenset({"study/key", "study/scene"})
# Attributes of groups with costs and on what they were measured, which differ from run to run.
COSTS = frozenset({"seconds", "peak_megabytes", "machine"})
# Arrays of costs in tables of alternatives.
COST_COLUMNS = frozenset({"time", "memory", "pareto", "runs"})


@dataclass(frozen=True, eq=False)
class Variable:
    """One named array: its axes, values, SI units and attributes.

    Values are float64, complex128, int64, bool, text (object array of str), or a structured array
    with such fields.
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
        """Return True if axes, units, attributes, type and all values are equal (NaN equals NaN)."""
        return (
            self.dims == other.dims
            and self.units == other.units
            and _same_attrs(self.attrs, other.attrs)
            and self.data.dtype == other.data.dtype
            and self.data.shape == other.data.shape
            and _same_values(self.data, other.data)
        )


class VariableView(Variable):
    """An array whose values are computed or read on request from its source."""

    def __init__(
        self, dims: tuple[str, ...], units: str, attrs: Mapping[str, Scalar], **source: object
    ) -> None:
        for key, value in {"dims": dims, "units": units, "attrs": attrs, **source}.items():
            object.__setattr__(self, key, value)  # variables do not change


def without_costs(attrs: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """Return the attributes without costs, which are the same in every run."""
    return {name: value for name, value in attrs.items() if name not in COSTS}


def _same_values(a: NDArray[Any], b: NDArray[Any]) -> bool:
    if a.dtype.names:
        return all(_same_values(a[name], b[name]) for name in a.dtype.names)
    return bool(np.array_equal(a, b, equal_nan=a.dtype.kind in "fc"))


def _same_attrs(a: Mapping[str, Scalar], b: Mapping[str, Scalar]) -> bool:
    return a.keys() == b.keys() and all(
        type(a[name]) is type(b[name]) and (a[name] == b[name] or (a[name] != a[name] and b[name] != b[name]))
        for name in a
    )


def as_kept(data: ArrayLike) -> NDArray[Any]:
    """Return values in one of the types that a result holds."""
    array = np.asarray(data)
    if array.dtype.names:
        return array.astype([(name, _stored_type(array.dtype[name])) for name in array.dtype.names])
    return array.astype(_stored_type(array.dtype), copy=False)


def _stored_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
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
        raise TypeError(f"a result holds numbers, Booleans and texts, not {dtype}")
    return np.dtype(kept[dtype.kind])


def is_cost(path: str) -> bool:
    """Return True for arrays of costs in benchmarks and tables of alternatives, or derived from them."""
    holder, _, rest = path.partition("/")
    return holder in ("accuracy", "bench") and rest.rpartition("/")[2] in COST_COLUMNS


#: Status of a result whose fit is rejected: it has the fit and its tests, and no answers.
REJECTED = "rejected"


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

    @property
    def rejected(self) -> bool:
        """True of a rejected fit."""
        return self.attrs.get("status") == REJECTED

    def wants(self, path: str) -> bool:  # noqa: ARG002 - used by Selection
        """Return True if an array is kept; others need not be computed."""
        return True

    def wants_below(self, group: str) -> bool:  # noqa: ARG002 - used by Selection
        """Return True if any array of a group is kept."""
        return True

    def add(
        self, path: str, data: ArrayLike, dims: tuple[str, ...] = (), units: str = "", **attrs: Scalar
    ) -> None:
        """Store one array under `path`; a path is written once."""
        self.put(path, Variable(dims, as_kept(data), units, attrs))

    def put(self, path: str, variable: Variable) -> None:
        """Store a variable under `path`; a path is written once."""
        if path in self._variables:
            raise ValueError(f"{path} is already in the result")
        self._variables[path] = variable

    def add_axis(self, path: str, data: ArrayLike, units: str = "", **attrs: Scalar) -> None:
        """Store a coordinate: its dimension is the last part of its path."""
        self.add(path, data, (path.rsplit("/", 1)[-1],), units, **attrs)

    def add_all(
        self, group: str, dims: tuple[str, ...] = (), units: str = "", /, **arrays: ArrayLike
    ) -> None:
        """Store arrays of the same axes and units in a group, by name."""
        for name, data in arrays.items():
            self.add(f"{group}/{name}", data, dims, units)

    def add_axes(self, group: str, units: str = "", /, **axes: ArrayLike) -> None:
        """Store coordinates of the same unit in a group, by name."""
        for name, data in axes.items():
            self.add_axis(f"{group}/{name}", data, units)

    def add_numbered(self, path: str, data: ArrayLike, units: str = "", **attrs: Scalar) -> None:
        """Store values along an axis that counts them from 1, by its path: `g/zero` for `g/zeros`."""
        values = np.asarray(data)
        self.add_axis(path, np.arange(1, len(values) + 1))
        self.add(f"{path}s", values, (path.rsplit("/", 1)[-1],), units, **attrs)

    def annotate(self, group: str, **attrs: Scalar) -> None:
        """Set attributes of a group (the root result's own are in `attrs`)."""
        self.group_attrs.setdefault(group, {}).update(attrs)

    def value(self, path: str) -> Any:
        """Return the array at `path`, or the Python scalar where it has no axes."""
        data = self[path].data
        return data.item() if data.ndim == 0 else data

    def to_control(self) -> control.StateSpace:
        """Return the state equations of a bond graph as a system of python-control.

        Signals keep their names, with an underscore for the dot that python-control does not allow:
        `m_s.f` is `m_s_f`. Where loops have delays it is their linear fractional form: the last inputs are
        the last outputs, each by its delay before (``bond_graph/state_space/delay``, s).

        Raises
        ------
        UsageError
            Where the result holds no state equations, or an output differentiates an input.
        """
        import control

        if f"{_STATE_SPACE}/A" not in self:
            raise UsageError(
                "the result holds no state equations", remedy="Add state_space to analysis.results."
            )
        names = {
            axis: [str(name).replace(".", "_") for name in self[f"{_STATE_SPACE}/{axis}"].data]
            for axis in ("state", "input", "output")
        }
        improper = self[f"{_STATE_SPACE}/feedthrough"].data[1:].any(axis=0)
        for output, source in np.argwhere(improper):
            raise UsageError(
                f"output '{self[f'{_STATE_SPACE}/output'].data[output]}' follows a derivative of input "
                f"'{self[f'{_STATE_SPACE}/input'].data[source]}': python-control has no such state space",
                remedy="Request other outputs, or add the elements that limit them to the graph.",
            )
        matrices = (self[f"{_STATE_SPACE}/{name}"].data for name in "ABCD")
        return control.StateSpace(
            *matrices, states=names["state"], inputs=names["input"], outputs=names["output"]
        )

    def to_xarray(self, group: str = "") -> xarray.Dataset:
        """Return the arrays of a group as a dataset of xarray, each dimension with its coordinate.

        Parameters
        ----------
        group
            Its path (`bond_graph/frequency_response`); default: the arrays at the root.

        Raises
        ------
        UsageError
            Where the result has no such group, or xarray is not installed.
        """
        try:
            import xarray
        except ImportError as error:
            raise UsageError(
                "datasets of xarray need xarray, which is not installed",
                remedy="Install it: pip install 'dynid[xarray]'.",
            ) from error

        group = group.strip("/")
        held = {path: variable for path, variable in self.items() if path.rpartition("/")[0] == group}
        if not held:
            raise UsageError(
                f"the result has no arrays in '{group}'{did_you_mean_path(group, self)}",
                remedy="`dynid show --all` lists every array.",
            )
        arrays = {path.rpartition("/")[2]: _xarray_variable(variable) for path, variable in held.items()}
        for path, variable in held.items():
            for dim, length in zip(variable.dims, variable.data.shape, strict=True):
                axis = coordinate_path(self, path, dim) if dim not in arrays else None
                if axis is not None and self[axis].data.size == length:
                    arrays[dim] = _xarray_variable(self[axis])
        attrs: dict[str, Any] = dict(self.group_attrs.get(group, {}))
        return xarray.Dataset(arrays, attrs={"title": self.title, **attrs})

    def to_pandas(self, name: str) -> pandas.DataFrame:
        """Return a table of the result as a data frame of pandas.

        Parameters
        ----------
        name
            The path of a group (`identification/parameters`, `bond_graph/frequency_response`,
            `identification/history`), of an array, or of an axis in a group, whose arrays all become columns;
            its end where only one ends so (`parameters`, `history`); of a study `study`.

        Returns
        -------
        pandas.DataFrame
            A row for each entry of the first axis; the index is named with its unit (`omega [rad/s]`, or
            `frequency [Hz]` where the scene says Hz), the labels of further axes stand in the names of the
            columns: `response[m.f,F]`. `attrs["units"]` has
            the units of the columns. Estimates have their 95 % interval in `low` and `high`, unless the
            estimate is rejected. The single numbers of a group are rows with `value` and `unit`; of a group
            that also has a table they are in `attrs["numbers"]`, by name. `attrs["approximate"]`, where
            delays are approximated, names what is approximate, with the reason. A study has a row for each
            sample, as `dynid export` writes it.

        Raises
        ------
        UsageError
            If there is no such table, or several, or pandas is not installed.
        """
        return import_module(_NOTEBOOK).frame(self, name)

    def plot(self, name: str) -> Any:
        """Draw a figure by matplotlib, in the style of its rcParams.

        Parameters
        ----------
        name
            The name of the figure, as ``dynid plot --list`` prints it: ``bode``, ``time-response``.

        Returns
        -------
        matplotlib.axes.Axes or numpy.ndarray of them
            The axes of a figure with one subplot; of several an array of shape (rows, columns), also where
            one of these is 1: of ``bode``, ``[0, 0]`` is the magnitude and ``[1, 0]`` the phase.

        Raises
        ------
        UsageError
            If there is no such figure, or it is a drawing without axes.
        """
        return import_module(_NOTEBOOK).axes(self, name)

    def _repr_html_(self) -> str:
        """Return what a notebook shows of the result."""
        text: str = import_module(_NOTEBOOK).html(self)
        return text

    def merge(self, other: Result) -> None:
        """Add all arrays and group attributes of another result."""
        for path, variable in other.items():
            self.put(path, variable)
        for group, attrs in other.group_attrs.items():
            self.annotate(group, **attrs)

    def without(self, beginning: str) -> Result:
        """Return the result without the arrays whose paths begin so."""
        kept = Result(self.kind, self.title, self.attrs)
        for path, variable in self.items():
            if not path.startswith(beginning):
                kept.put(path, variable)
        for group, attrs in self.group_attrs.items():
            kept.annotate(group, **attrs)
        return kept

    def equals(self, other: Result) -> bool:
        """Return True if two results hold the same arrays, attributes and names, of any origin."""
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
        try:
            return self._variables[path]
        except KeyError:
            raise UnknownPath(
                f"the result has no '{path}'{did_you_mean_path(str(path), self)}",
                remedy="list(result) has every path.",
            ) from None

    def __contains__(self, path: object) -> bool:
        return path in self._variables

    @overload
    def get(self, path: str, /) -> Variable | None: ...
    @overload
    def get(self, path: str, default: T, /) -> Variable | T: ...
    def get(self, path: str, default: Any = None, /) -> Any:
        """Return the array at a path, or a default where there is none."""
        return self._variables.get(path, default)

    def __iter__(self) -> Iterator[str]:
        return iter(self._variables)

    def __len__(self) -> int:
        return len(self._variables)

    def __repr__(self) -> str:
        return f"<Result of {self.kind} {self.title!r}: {len(self)} arrays>"


#: In `collect`: every number under `properties` and `parameters`, with statuses; also an empty one.
NUMBERS = ""
#: The groups of these.
GATHERED_ANYWAY = frozenset({"properties", "parameters"})


class Selection(Result):
    """A result that keeps all coordinates, and the arrays that `collect` may name.

    These are paths, groups, or patterns with `*`, as for `dynid.scene.outcomes.gather`.
    """

    def __init__(self, kind: str, collect: Iterable[str]) -> None:
        super().__init__(kind)
        self._collect = tuple(path.strip("/") for path in collect)

    def wants(self, path: str) -> bool:
        """Return True if an array is kept."""
        return _is_named(self._collect, path)

    def wants_below(self, group: str) -> bool:
        """Return True if anything in a group may be kept."""
        return _is_reached(self._collect, group)

    def put(self, path: str, variable: Variable) -> None:
        """Store a variable under `path` if it is collected, or is a coordinate."""
        if variable.dims == (path.rpartition("/")[2],) or self.wants(path):
            super().put(path, variable)


@lru_cache(maxsize=4096)  # thousands of samples ask the same
def _is_named(collect: tuple[str, ...], path: str) -> bool:
    if NUMBERS in collect and not GATHERED_ANYWAY.isdisjoint(path.split("/")):
        return True
    return any(covers(wanted, path) for wanted in collect if wanted != NUMBERS)


def covers(collected: str, path: str) -> bool:
    """Return True if an entry of `collect`, a path, a group or a pattern, names a path."""
    return path == collected or path.startswith(f"{collected}/") or fnmatchcase(path, collected)


@lru_cache(maxsize=4096)
def _is_reached(collect: tuple[str, ...], group: str) -> bool:
    """Return True if an entry of `collect` may name something in a group."""
    for wanted in collect:
        if wanted == NUMBERS:
            if not GATHERED_ANYWAY.isdisjoint(group.split("/")):
                return True
            continue
        fixed = min((wanted.partition(sign)[0] for sign in "*?["), key=len)
        if f"{group}/".startswith(fixed) or fixed.startswith(f"{group}/"):
            return True
    return False


def coordinate_path(result: Mapping[str, Variable], path: str, dim: str) -> str | None:
    """Return the path of the coordinate of an array's dimension, in its group or the nearest one above."""
    while path:
        path = path.rpartition("/")[0]
        coordinate = f"{path}/{dim}" if path else dim
        if coordinate in result and result[coordinate].dims == (dim,):
            return coordinate
    return None


def common_unit(units: Iterable[str]) -> str:
    """Return the common unit of all, or ''."""
    different = set(units)
    return different.pop() if len(different) == 1 else ""


def _xarray_variable(variable: Variable) -> tuple[tuple[str, ...], Any, dict[str, Any]]:
    units = {"units": variable.units} if variable.units else {}
    return variable.dims, variable.data, {**variable.attrs, **units}
