"""A result of which only what is collected is computed and kept."""

from __future__ import annotations

from fnmatch import fnmatchcase
from functools import lru_cache

from numpy.typing import ArrayLike

from dynid.result import Result, Scalar, Variable
from dynid.scene.batch import GATHERED_ANYWAY, NUMBERS


class Collected(Result):
    """A result that keeps what `collect` may name, and the coordinates there are.

    Parameters
    ----------
    kind
        The kind of scene that produced it.
    collect
        Paths, groups, or patterns with `*`, as for `dynid.scene.batch.gather`.
    """

    def __init__(self, kind: str, collect: tuple[str, ...]) -> None:
        super().__init__(kind)
        self._collect = tuple(path.strip("/") for path in collect)

    def wants(self, path: str) -> bool:
        """Tell whether an array is kept."""
        return _named(self._collect, path)

    def wants_below(self, group: str) -> bool:
        """Tell whether anything in a group may be kept."""
        return _reached(self._collect, group)

    def add(
        self, path: str, data: ArrayLike, dims: tuple[str, ...] = (), units: str = "", **attrs: Scalar
    ) -> None:
        """Store one array under `path` if it is wanted, or is a coordinate."""
        if dims == (path.rpartition("/")[2],) or self.wants(path):
            super().add(path, data, dims, units, **attrs)

    def put(self, path: str, variable: Variable) -> None:
        """Store a variable as it is under `path` if it is wanted, or is a coordinate."""
        if variable.dims == (path.rpartition("/")[2],) or self.wants(path):
            super().put(path, variable)


@lru_cache(maxsize=4096)  # thousands of samples ask the same
def _named(collect: tuple[str, ...], path: str) -> bool:
    """Tell whether any entry of `collect` may name an array."""
    return any(_names(wanted, path) for wanted in collect)


@lru_cache(maxsize=4096)
def _reached(collect: tuple[str, ...], group: str) -> bool:
    """Tell whether any entry of `collect` may name something in a group."""
    return any(_reaches(wanted, group) for wanted in collect)


def _names(wanted: str, path: str) -> bool:
    """Tell whether an entry of `collect` may name an array."""
    if wanted == NUMBERS:
        return not GATHERED_ANYWAY.isdisjoint(path.split("/"))
    return path == wanted or path.startswith(f"{wanted}/") or fnmatchcase(path, wanted)


def _reaches(wanted: str, group: str) -> bool:
    """Tell whether an entry of `collect` may name something in a group."""
    if wanted == NUMBERS:
        return not GATHERED_ANYWAY.isdisjoint(group.split("/"))
    fixed = min((wanted.partition(sign)[0] for sign in "*?["), key=len)
    return f"{group}/".startswith(fixed) or fixed.startswith(f"{group}/")
