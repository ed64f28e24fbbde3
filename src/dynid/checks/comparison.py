"""Differences between two results."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import PROVENANCE_ARRAYS, Result, Scalar, Variable, is_cost, without_costs

RTOL = 1e-9


@dataclass(frozen=True)
class Difference:
    """One difference between two results, with its message."""

    path: str
    message: str

    def __str__(self) -> str:
        return f"{self.path}: {self.message}"


def compare(a: Result, b: Result, rtol: float = RTOL, atol: float = 0.0) -> list[Difference]:
    """Return the differences of two results beyond tolerances; titles, provenance and costs are ignored.

    Parameters
    ----------
    a, b
        The results.
    rtol, atol
        Numbers x and y agree when |x - y| <= atol + rtol max(|x|, |y|). NaN agrees with NaN.
    """
    found = [Difference("kind", f"{a.kind} against {b.kind}")] if a.kind != b.kind else []
    for path in sorted((a.keys() | b.keys()) - PROVENANCE_ARRAYS):
        if path not in a or path not in b:
            found.append(Difference(path, f"only in the {'second' if path not in a else 'first'}"))
        elif is_cost(path):
            continue
        elif message := _difference(a[path], b[path], rtol, atol):
            found.append(Difference(path, message))
        else:
            found += _attr_differences(path, a[path].attrs, b[path].attrs, rtol, atol)
    for group in sorted(a.group_attrs.keys() | b.group_attrs.keys()):
        mine, theirs = (without_costs(result.group_attrs.get(group, {})) for result in (a, b))
        found += _attr_differences(group, mine, theirs, rtol, atol)
    return found


def close(a: NDArray[Any], b: NDArray[Any], rtol: float, atol: float) -> NDArray[Any]:
    """Return a mask of close entries; infinities are close to themselves only, NaN to nothing."""
    same = np.asarray(a == b, dtype=bool)
    if a.dtype.kind not in "ifc" or b.dtype.kind not in "ifc":
        return same
    with np.errstate(all="ignore"):
        near = np.isfinite(a) & np.isfinite(b) & (np.abs(a - b) <= atol + rtol * np.abs(b))
    return np.asarray(same | near)


def word(value: Any) -> str:
    """Return one value as a scene would write it."""
    value = value.item() if isinstance(value, np.generic | np.ndarray) else value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, complex):
        return repr(value).strip("()")
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return f"'{value}'" if isinstance(value, str) else repr(value)


def words_of(data: NDArray[Any]) -> str:
    """Return a few values as text, or the shape of more."""
    if data.dtype.names or data.size > 6:
        return f"an array of {' x '.join(map(str, data.shape))}"
    return word(data) if data.ndim == 0 else f"[{', '.join(map(word, data.ravel()))}]"


def _difference(a: Variable, b: Variable, rtol: float, atol: float) -> str:
    for what, mine, theirs in (
        ("dimensions", a.dims, b.dims),
        ("shape", a.shape, b.shape),
        ("units", a.units, b.units),
    ):
        if mine != theirs:
            return f"{what} {mine} against {theirs}"
    if a.dtype.names != b.dtype.names:
        return "the columns differ"
    for name in a.dtype.names or ("",):
        if message := _value_difference(_paired(a, b, name), a.shape, rtol, atol):
            return f"{name}: {message}" if name else message
    return ""


_Pairs = Iterable[tuple[int, NDArray[Any], NDArray[Any]]]


def _paired(a: Variable, b: Variable, name: str) -> _Pairs:
    """Yield the same entries of both in blocks, of one column of tables."""
    for start, mine in a.blocks():
        theirs = b.rows(start, start + len(mine)) if mine.ndim else b.data
        yield (start, mine[name], theirs[name]) if name else (start, mine, theirs)


def _value_difference(pairs: _Pairs, shape: tuple[int, ...], rtol: float, atol: float) -> str:
    """Return the first difference and the number of differences as text."""
    first, count = "", 0
    for start, a, b in pairs:
        if a.size and a.dtype.kind != b.dtype.kind and not (_is_numeric(a) and _is_numeric(b)):
            return f"{words_of(a)} against {words_of(b)}"
        misses = np.argwhere(~_agree(a, b, rtol, atol))
        if len(misses) and not count:
            place = tuple(misses[0])
            entry = ", ".join(str(step + 1 + start * (not axis)) for axis, step in enumerate(place))
            first = f"{word(a[place])} against {word(b[place])}{f' at entry {entry}' if entry else ''}"
        count += len(misses)
    size = math.prod(shape)
    return first + (f" ({count} of {size} entries differ)" if count and size > 1 else "")


def _agree(a: NDArray[Any], b: NDArray[Any], rtol: float, atol: float) -> NDArray[Any]:
    if not (_is_numeric(a) and _is_numeric(b)):
        return np.asarray(a == b, dtype=bool)
    both_nan = np.isnan(a) & np.isnan(b)
    return np.asarray(close(a, b, rtol, atol) | close(b, a, rtol, atol) | both_nan)


def _is_numeric(data: NDArray[Any]) -> bool:
    return data.dtype.kind in "ifc"


def _attr_differences(
    path: str, a: Mapping[str, Scalar], b: Mapping[str, Scalar], rtol: float, atol: float
) -> list[Difference]:
    found = []
    for name in sorted(a.keys() | b.keys()):
        where = f"{path}/{name}" if path else name
        if name not in a or name not in b:
            found.append(Difference(where, f"only in the {'second' if name not in a else 'first'}"))
        elif message := _value_difference([(0, as_array(a[name]), as_array(b[name]))], (), rtol, atol):
            found.append(Difference(where, message))
    return found


def as_array(value: Scalar) -> NDArray[Any]:
    """Return an attribute as an array without axes."""
    return np.array(value, dtype=object if isinstance(value, str) else None)
