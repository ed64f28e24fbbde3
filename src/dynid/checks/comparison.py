"""Comparison of results, and of identifications by their likelihoods."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import PROVENANCE_ARRAYS, Result, Scalar, Variable, is_cost, without_costs

RTOL = 1e-9

#: Dimensions along which an array samples one quantity: responses, shapes, matrices, coordinates in space.
_FIELD = frozenset({"omega", "time", "lag", "dof", "node", "xyz"}) | {
    *("coordinate", "column", "rate_of", "state", "full_mode", "other")
}
#: Names of arrays of one quantity by modes alone.
_SHAPES = frozenset({"shape", "mac"})
#: Dimensions whose entries are quantities of their own, but for those below.
_SEPARATE = frozenset({"sample", "parameter", "component"})
#: Dimensions whose entries are one quantity where they have one unit.
_CHANNELS = frozenset({"channel", "output", "input", "source", "excitation"})


@dataclass(frozen=True)
class Difference:
    """One difference between two results, with its message."""

    path: str
    message: str

    def __str__(self) -> str:
        return f"{self.path}: {self.message}"

    @property
    def of_method(self) -> bool:
        """True for error bounds and for what was left out: how a result was computed, not what it is."""
        return "/need/" in self.path or self.path.endswith("_error_bound")


def compare(
    a: Result, b: Result, rtol: float = RTOL, atol: float = 0.0, *, elementwise: bool = False
) -> list[Difference]:
    """Return the differences of two results beyond tolerances; titles, provenance and costs are ignored.

    Parameters
    ----------
    a, b
        The results.
    rtol, atol
        Numbers x and y agree when |x - y| <= atol + rtol max(|x|, |y|). NaN agrees with NaN. Of arrays of one
        quantity (responses, shapes, MAC, matrices) the maximum is that of all entries: round-off is relative
        to the largest of them.
    elementwise
        True: each entry of every array is compared by its own size.
    """
    differences = [Difference("kind", f"{a.kind} against {b.kind}")] if a.kind != b.kind else []
    if a.rejected != b.rejected:
        differences.append(Difference("status", f"the {'first' if a.rejected else 'second'} is rejected"))
    for path in sorted((a.keys() | b.keys()) - PROVENANCE_ARRAYS):
        if path not in a or path not in b:
            differences.append(Difference(path, f"only in the {'second' if path not in a else 'first'}"))
        elif is_cost(path):
            continue
        elif message := _difference(
            a[path], b[path], rtol, atol, None if elementwise else _scale(a, b, path)
        ):
            differences.append(Difference(path, message))
        else:
            differences += _attr_differences(path, a[path].attrs, b[path].attrs, rtol, atol)
    for group in sorted(a.group_attrs.keys() | b.group_attrs.keys()):
        mine, theirs = (without_costs(result.group_attrs.get(group, {})) for result in (a, b))
        differences += _attr_differences(group, mine, theirs, rtol, atol)
    return differences


def close(a: NDArray[Any], b: NDArray[Any], rtol: float, atol: NDArray[np.float64] | float) -> NDArray[Any]:
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


def _words_apart(a: Any, b: Any) -> str:
    """Return two different values, numbers with as many digits as show that they differ, and two more."""
    if all(isinstance(value, float | np.floating) for value in (a, b)):
        digits = next((k for k in range(4, 16) if f"{a:.{k}g}" != f"{b:.{k}g}"), 17)
        return f"{a:.{min(17, digits + 2)}g} against {b:.{min(17, digits + 2)}g}"
    return f"{word(a)} against {word(b)}"


def words_of(data: NDArray[Any]) -> str:
    """Return a few values as text, or the shape of more."""
    if data.dtype.names or data.size > 6:
        return f"an array of {' x '.join(map(str, data.shape))}"
    return word(data) if data.ndim == 0 else f"[{', '.join(map(word, data.ravel()))}]"


def _is_field(path: str, variable: Variable) -> bool:
    """Return True for an array of one quantity, whose round-off is relative to its largest entry."""
    leaf = path.rpartition("/")[2]
    inner = [dim for dim in variable.dims if dim != "sample"]
    if variable.dtype.kind not in "fc" or inner in ([], [leaf]):  # scalars and axes
        return False
    return leaf in _SHAPES or not _FIELD.isdisjoint(inner)


def _scale(a: Result, b: Result, path: str) -> NDArray[np.float64] | None:
    """Return the largest entry of both arrays, by quantity; None where each entry is one.

    An error bound of an array has the scale of this array.
    """
    bounded = path.removesuffix("_error_bound")
    path = bounded if bounded in a and bounded in b else path
    variables = [a[path], b[path]]
    if not all(_is_field(path, variable) for variable in variables):
        return None
    if variables[0].dims != variables[1].dims or variables[0].shape != variables[1].shape:
        return None
    mixed = _CHANNELS if not variables[0].units else frozenset()
    apart = [dim in _SEPARATE or dim in mixed for dim in variables[0].dims]
    return np.maximum(*(_largest(variable, apart) for variable in variables))


def _largest(variable: Variable, apart: list[bool]) -> NDArray[np.float64]:
    """Return the largest finite magnitude along all axes but those apart; the others have length 1."""
    axes = tuple(axis for axis, separate in enumerate(apart) if not separate)
    largest: list[NDArray[np.float64]] = []
    for _, block in variable.blocks():
        with np.errstate(all="ignore"):
            sizes = np.abs(block)
        sizes = np.where(np.isfinite(sizes), sizes, 0.0)
        largest.append(np.max(sizes, axis=axes, keepdims=True, initial=0.0))
    if not largest:
        return np.zeros([1] * len(apart))
    return np.concatenate(largest) if apart[0] else np.max(largest, axis=0)


def _difference(a: Variable, b: Variable, rtol: float, atol: float, scale: NDArray[np.float64] | None) -> str:
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
        if message := _value_difference(_paired(a, b, name), a.shape, rtol, atol, scale):
            return f"{name}: {message}" if name else message
    return ""


_Pairs = Iterable[tuple[int, NDArray[Any], NDArray[Any]]]


def _paired(a: Variable, b: Variable, name: str) -> _Pairs:
    """Yield the same entries of both in blocks, of one column of tables."""
    for start, mine in a.blocks():
        theirs = b.rows(start, start + len(mine)) if mine.ndim else b.data
        yield (start, mine[name], theirs[name]) if name else (start, mine, theirs)


def _value_difference(
    pairs: _Pairs,
    shape: tuple[int, ...],
    rtol: float,
    atol: float,
    scale: NDArray[np.float64] | None = None,
) -> str:
    """Return the first difference and the number of differences as text."""
    first, count = "", 0
    for start, a, b in pairs:
        if a.size and a.dtype.kind != b.dtype.kind and not (_is_numeric(a) and _is_numeric(b)):
            return f"{words_of(a)} against {words_of(b)}"
        tolerance: NDArray[np.float64] | float = atol
        if scale is not None:
            rows = scale[start : start + len(a)] if len(scale) > 1 else scale
            tolerance = atol + rtol * rows
        misses = np.argwhere(~_agree(a, b, rtol if scale is None else 0.0, tolerance))
        if len(misses) and not count:
            index = tuple(misses[0])
            entry = ", ".join(str(step + 1 + start * (not axis)) for axis, step in enumerate(index))
            first = f"{_words_apart(a[index], b[index])}{f' at entry {entry}' if entry else ''}"
        count += len(misses)
    size = math.prod(shape)
    return first + (f" ({count} of {size} entries differ)" if count and size > 1 else "")


def _agree(a: NDArray[Any], b: NDArray[Any], rtol: float, atol: NDArray[np.float64] | float) -> NDArray[Any]:
    if not (_is_numeric(a) and _is_numeric(b)):
        return np.asarray(a == b, dtype=bool)
    both_nan = np.isnan(a) & np.isnan(b)
    return np.asarray(close(a, b, rtol, atol) | close(b, a, rtol, atol) | both_nan)


def _is_numeric(data: NDArray[Any]) -> bool:
    return data.dtype.kind in "ifc"


def _attr_differences(
    path: str, a: Mapping[str, Scalar], b: Mapping[str, Scalar], rtol: float, atol: float
) -> list[Difference]:
    differences = []
    for name in sorted(a.keys() | b.keys()):
        where = f"{path}/{name}" if path else name
        if name not in a or name not in b:
            differences.append(Difference(where, f"only in the {'second' if name not in a else 'first'}"))
        elif message := _value_difference([(0, as_array(a[name]), as_array(b[name]))], (), rtol, atol):
            differences.append(Difference(where, message))
    return differences


def as_array(value: Scalar) -> NDArray[Any]:
    """Return an attribute as an array without axes."""
    return np.array(value, dtype=object if isinstance(value, str) else None)


_DIAGNOSTICS, _MEASURED = "identification/diagnostics", "identification/measurement"
_PARAMETERS, _POSTERIOR = "identification/parameters", "identification/posterior"
#: Values of two records agree to this part of the largest.
_RECORD_TOL = 1e-9
# Words for differences of BIC, and for twice those of the logarithm of the evidence (R. E. Kass, A. E.
# Raftery, J. Am. Stat. Assoc. 90 (1995) 773–795, section 3.2).
_STRENGTHS = ((2.0, "hardly"), (6.0, "positively"), (10.0, "strongly"), (math.inf, "very strongly"))


def compare_identifications(a: Result, b: Result) -> list[str]:
    """Return the comparison of two identifications of one record (first, second) in words, else none."""
    needed = (f"{_DIAGNOSTICS}/log_likelihood", f"{_DIAGNOSTICS}/bic", f"{_DIAGNOSTICS}/free_parameters")
    if a.rejected or b.rejected:
        return []
    if any(path not in result for path in needed for result in (a, b)) or not _same_record(a, b):
        return []
    return list(_lines(a, b))


def _same_record(a: Result, b: Result) -> bool:
    """Return True if two results were identified from the same measured values at the same times or lines."""
    paths = [
        sorted(
            path
            for path in result
            if path.startswith(f"{_MEASURED}/") and path.rpartition("/")[2] in ("measured", "time", "omega")
        )
        for result in (a, b)
    ]
    if paths[0] != paths[1] or not any(path.endswith("/measured") for path in paths[0]):
        return False
    for path in paths[0]:
        a_values, b_values = a[path].data, b[path].data
        if a_values.shape != b_values.shape:
            return False
        scale = float(np.nanmax(np.abs(a_values), initial=0.0))
        if not np.allclose(a_values, b_values, rtol=_RECORD_TOL, atol=_RECORD_TOL * scale, equal_nan=True):
            return False
    return True


def _lines(a: Result, b: Result) -> Iterator[str]:
    likelihood, bic, free = (
        [result.value(f"{_DIAGNOSTICS}/{name}") for result in (a, b)]
        for name in ("log_likelihood", "bic", "free_parameters")
    )
    yield "two identifications of one record:"
    for which, k in (("first", 0), ("second", 1)):
        yield f"  {which}: log-likelihood {likelihood[k]:.6g}, {free[k]} free parameters, BIC {bic[k]:.6g}"
    yield f"  {_ratio(a, b, likelihood, free)}"
    apart = abs(bic[1] - bic[0])
    if apart:
        word = next(word for limit, word in _STRENGTHS if apart < limit)
        better = "first" if bic[0] < bic[1] else "second"
        yield f"  BIC prefers the {better} {word}: it is less by {apart:.4g}"
    else:
        yield "  BIC prefers neither"
    yield f"  {_evidence(a, b)}"


def _ratio(a: Result, b: Result, likelihood: list[float], free: list[int]) -> str:
    """Return the likelihood ratio in words, with its p-value where one model may be nested in the other."""
    names = [{str(name) for name in result[f"{_PARAMETERS}/name"].data} for result in (a, b)]
    small = 0 if names[0] < names[1] else 1 if names[1] < names[0] else None
    gain, more = 2 * (likelihood[1] - likelihood[0]), len(names[0] ^ names[1])
    if small is None or abs(free[1] - free[0]) != more:
        return (
            f"likelihood ratio: 2 ln(L second / L first) = {gain:.4g}; neither model is the other one with "
            "parameters fixed (not nested): it has no chi-squared distribution"
        )
    from scipy.special import gammaincc

    gain = gain if small == 0 else -gain
    p = float(gammaincc(more / 2, max(gain, 0.0) / 2))
    less, full = ("first", "second")[:: 1 - 2 * small]
    return (
        f"likelihood ratio: 2 ln(L {full} / L {less}) = {gain:.4g}; if the {less} model is the {full} one "
        f"with {', '.join(sorted(names[0] ^ names[1]))} fixed (nested), its p-value is {p:.2g} (chi-squared, "
        f"{more} degrees of freedom)"
    )


def _evidence(a: Result, b: Result) -> str:
    """Return the ratio of the evidence in words, or why there is none."""
    path = f"{_POSTERIOR}/log_evidence"
    if path in a and path in b:
        apart = b.value(path) - a.value(path)
        better, word = (
            "second" if apart > 0 else "first",
            next(word for limit, word in _STRENGTHS if 2 * abs(apart) < limit),
        )
        return f"evidence prefers the {better} {word}: the ratio is exp({abs(apart):.4g})"
    reasons = []
    for which, result in (("first", a), ("second", b)):
        if path not in result:
            reason = result.group_attrs.get(_POSTERIOR, {}).get("no_evidence")
            reasons.append(f"{which}: {reason or 'computed with posterior_check: true'}")
    return f"no ratio of evidence ({'; '.join(reasons)})"
