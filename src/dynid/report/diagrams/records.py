"""What an identification holds of each record: in one group, or a group each of several records."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from dynid.report.numbers import labelled

if TYPE_CHECKING:
    from dynid.result import Result


class Record(NamedTuple):
    """A group of a record: where it is, how figures' names end, and how titles do."""

    group: str
    suffix: str
    title: str


def records(result: Result, group: str, member: str) -> list[Record]:
    """Return the groups that hold a member: the group itself, or `record_1`, `record_2`, … in it."""
    if f"{group}/{member}" in result:
        return [Record(group, "", "")]
    depth = group.count("/") + 1
    found = [
        path.rpartition("/")[0]
        for path in result
        if path.startswith(f"{group}/record_")
        and path.endswith(f"/{member}")
        and path.count("/") == depth + 1
    ]
    return [
        Record(own, f"-{own.rpartition('/')[2]}", f", {own.rpartition('/')[2].replace('_', ' ')}")
        for own in found
    ]


def texts(result: Result, path: str) -> list[str]:
    """Return an array of texts; empty where there is none."""
    return list(map(str, result[path].data)) if path in result else []


def with_units(result: Result, group: str, axis: str, count: int, units: str = "") -> list[str]:
    """Return the names along an axis, each with its units: those of `unit` beside it, or the given ones."""
    names = texts(result, f"{group}/{axis}") or [str(place + 1) for place in range(count)]
    own = texts(result, f"{group}/unit") or [units] * count
    return [labelled(name, unit) for name, unit in zip(names, own, strict=True)]


def parameters(result: Result) -> list[str]:
    """Return the names of the parameters with their units."""
    group = "identification/parameters"
    return with_units(result, group, "name", len(result[f"{group}/name"].data))
