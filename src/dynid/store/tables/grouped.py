"""Any result as tables: one for the arrays of a group that share their axes, a row for each entry."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import Result, Variable
from dynid.store.tables.table import Field, Table, kind_of, parts_of, split

_VALUES = 2**19  # rows that are in memory at a time

Member = tuple[str, Variable]


def tables_of(result: Result) -> list[Table]:
    """Return all arrays of a result as tables, by group and axes.

    Parameters
    ----------
    result
        The result, in memory or stored.

    Returns
    -------
    list of Table
        Arrays without axes make one row. Others have a row for each entry, with the labels of its axes in the
        first columns (their coordinates, or numbers from 1). The name is the group's, with dots for slashes;
        of a group with several tables followed by the axes. Complex numbers are two columns, `.re` and `.im`.
    """
    groups: dict[str, dict[tuple[str, ...], list[Member]]] = {}
    for path in sorted(result):
        group, _, name = path.rpartition("/")
        variable = result[path]
        groups.setdefault(group, {}).setdefault(variable.dims, []).append((name, variable))
    return [
        _table(result, group, dims, members, len(found) > 1)
        for group, found in groups.items()
        for dims, members in _worth_it(found)
    ]


def _worth_it(
    found: dict[tuple[str, ...], list[Member]],
) -> Iterator[tuple[tuple[str, ...], list[Member]]]:
    """Leave out coordinates that stand in the tables of others; arrays of several lengths are apart."""
    for dims, members in found.items():
        used = any(dims != other and set(dims) <= set(other) for other in found)
        if not (used and all((name,) == dims for name, _ in members)):
            yield dims, members


def _table(
    result: Result, group: str, dims: tuple[str, ...], members: Sequence[Member], several: bool
) -> Table:
    shape = members[0][1].shape
    own = [(name, variable) for name, variable in members if variable.shape == shape and (name,) != dims]
    axes = [_axis(result, group, dim, length) for dim, length in zip(dims, shape, strict=True)]
    fields = [Field(dim, kind_of(axis.dtype), axis.units) for dim, axis in zip(dims, axes, strict=True)]
    for name, variable in own:
        fields += parts_of(name, variable.dtype, variable.units)
    names = unique([field.name for field in fields])
    fields = [replace(field, name=name) for field, name in zip(fields, names, strict=True)]
    name = (group.replace("/", ".") or "root") + (
        f"-{'-'.join(names[: len(dims)])}" if several and dims else ""
    )
    labels = [axis.data for axis in axes]

    def batches() -> Iterator[list[NDArray[Any]]]:
        if not shape:
            yield [part for _, variable in own for part in split(variable.data)]
            return
        below = math.prod(shape[1:])
        step = max(1, _VALUES // max(1, below))
        for start in range(0, shape[0], step):
            stop = min(start + step, shape[0])
            yield [
                *_labels([labels[0][start:stop], *labels[1:]]),
                *(part for _, variable in own for part in split(variable.rows(start, stop))),
            ]

    return Table(name, tuple(fields), batches, {"group": group, "kind": result.kind, "title": result.title})


def _axis(result: Result, group: str, dim: str, length: int) -> Variable:
    """Return the coordinate of a dimension in its group or the nearest one above, else numbers from 1."""
    holder = group
    while True:
        found = result.get(f"{holder}/{dim}" if holder else dim)
        if found is not None and found.dims == (dim,):
            if found.shape == (length,) and not found.dtype.names and found.dtype.kind != "c":
                return found
            break
        if not holder:
            break
        holder = holder.rpartition("/")[0]
    return Variable((dim,), np.arange(1, length + 1))


def _labels(axes: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """Return the labels of every entry, the last axis fastest."""
    shape = [len(axis) for axis in axes]
    places = np.indices(shape).reshape(len(shape), -1)
    return [axis[place] for axis, place in zip(axes, places, strict=True)]


def unique(names: Sequence[str]) -> list[str]:
    """Give names that come again a number (both axes of a matrix may be the same)."""
    seen: dict[str, int] = {}
    found = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        found.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    return found
