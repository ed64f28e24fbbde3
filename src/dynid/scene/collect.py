"""The arrays that `collect` names: taken from a result, or the only ones that a result keeps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from functools import lru_cache

from numpy.typing import ArrayLike

from dynid.errors import UsageError
from dynid.result import Result, Scalar, Variable
from dynid.suggestions import did_you_mean_path

#: In `collect`: every number under `properties` and `parameters`, with statuses; also an empty one.
NUMBERS = ""
#: The groups of these.
GATHERED_ANYWAY = frozenset({"properties", "parameters"})


def gather(result: Mapping[str, Variable], collect: tuple[str, ...]) -> dict[str, Variable]:
    """Return the arrays that `collect` names in a result, with the coordinates of their axes.

    With a characteristic that may be undefined, such as a settling time, comes the status that says why.

    Parameters
    ----------
    result
        Arrays by path.
    collect
        Paths, groups, or patterns with `*`; empty: every number under `properties` and `parameters`.

    Raises
    ------
    UsageError
        Where there is nothing at a path, or a table, which has no place in a study.
    """
    chosen = dict.fromkeys(selected_paths(result, collect))
    for path in list(chosen):
        for dim in result[path].dims:  # its coordinate is in the same group, or in the nearest one above
            group = path
            while group:
                group = group.rpartition("/")[0]
                coordinate = f"{group}/{dim}" if group else dim
                if coordinate in result:
                    if result[coordinate].dims == (dim,):
                        chosen[coordinate] = None
                    break
    return {path: result[path] for path in chosen}


def selected_paths(result: Mapping[str, Variable], collect: tuple[str, ...]) -> Iterator[str]:
    """Yield the paths of a result that `collect` names, and the status of what may be undefined."""
    for wanted in (path.strip("/") for path in collect or (NUMBERS,)):
        if wanted == NUMBERS:
            found = [
                path
                for path, variable in result.items()
                if not GATHERED_ANYWAY.isdisjoint(path.split("/"))
                and (variable.data.dtype.kind in "bifc" or path.endswith("_status"))
            ]
        elif wanted in result:
            if result[wanted].data.dtype.names:
                raise UsageError(f"{wanted} is a table, which cannot be collected")
            found = [wanted]
        else:
            found = [
                path
                for path, variable in result.items()
                if (path.startswith(f"{wanted}/") or fnmatchcase(path, wanted))
                and not variable.data.dtype.names
            ]
        statuses = {path for one in (wanted, *found) if (path := _status_of(one))}
        found += [path for path in result if any(fnmatchcase(path, status) for status in statuses)]
        if not found and wanted != NUMBERS:
            raise UsageError(
                f"there is nothing to collect at '{wanted}'{did_you_mean_path(wanted, result)}",
                remedy="All paths of a result of the scene: dynid show FILE.h5 --all.",
            )
        yield from found


def _status_of(path: str) -> str:
    """Return the path of the status that says why a characteristic is undefined; empty for other arrays."""
    group, _, name = path.rpartition("/")
    if "properties" not in group.split("/"):
        return ""
    from dynid.bondgraph.results.characteristics import STATUSES

    return f"{group}/{STATUSES[name]}" if name in STATUSES else ""


class CollectedResult(Result):
    """A result that keeps the arrays that `collect` may name, and all coordinates.

    Parameters
    ----------
    kind
        The kind of scene that produced it.
    collect
        Paths, groups, or patterns with `*`, as for `dynid.scene.collect.gather`.
    """

    def __init__(self, kind: str, collect: tuple[str, ...]) -> None:
        super().__init__(kind)
        self._collect = tuple(path.strip("/") for path in collect)

    def wants(self, path: str) -> bool:
        """Return True if an array is kept."""
        return _named(self._collect, path)

    def wants_below(self, group: str) -> bool:
        """Return True if anything in a group may be kept."""
        return _reached(self._collect, group)

    def add(
        self, path: str, data: ArrayLike, dims: tuple[str, ...] = (), units: str = "", **attrs: Scalar
    ) -> None:
        """Store an array under `path` if it is collected, or is a coordinate."""
        if dims == (path.rpartition("/")[2],) or self.wants(path):
            super().add(path, data, dims, units, **attrs)

    def put(self, path: str, variable: Variable) -> None:
        """Store a variable under `path` if it is collected, or is a coordinate."""
        if variable.dims == (path.rpartition("/")[2],) or self.wants(path):
            super().put(path, variable)


@lru_cache(maxsize=4096)  # thousands of samples ask the same
def _named(collect: tuple[str, ...], path: str) -> bool:
    """Return True if an entry of `collect` may name an array."""
    if NUMBERS in collect and not GATHERED_ANYWAY.isdisjoint(path.split("/")):
        return True
    return any(
        path == wanted or path.startswith(f"{wanted}/") or fnmatchcase(path, wanted)
        for wanted in collect
        if wanted != NUMBERS
    )


@lru_cache(maxsize=4096)
def _reached(collect: tuple[str, ...], group: str) -> bool:
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
