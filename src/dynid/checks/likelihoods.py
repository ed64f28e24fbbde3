"""Comparison of two identifications of one record: likelihood ratio, BIC and evidence."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dynid.result import Result

_DIAGNOSTICS, _MEASURED = "identification/diagnostics", "identification/measurement"
_PARAMETERS, _POSTERIOR = "identification/parameters", "identification/posterior"
#: Values of two records agree to this part of the largest.
_SAME = 1e-9
# Words for differences of BIC, and for twice those of the logarithm of the evidence (R. E. Kass, A. E.
# Raftery, J. Am. Stat. Assoc. 90 (1995) 773–795, section 3.2).
_STRENGTHS = ((2.0, "hardly"), (6.0, "positively"), (10.0, "strongly"), (math.inf, "very strongly"))


def compare_identifications(a: Result, b: Result) -> list[str]:
    """Return the comparison of two identifications of one record in words; empty where they are not two such.

    Parameters
    ----------
    a, b
        The results, called first and second.
    """
    needed = (f"{_DIAGNOSTICS}/log_likelihood", f"{_DIAGNOSTICS}/bic", f"{_DIAGNOSTICS}/free_parameters")
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
        one, other = a[path].data, b[path].data
        if one.shape != other.shape:
            return False
        scale = float(np.nanmax(np.abs(one), initial=0.0))
        if not np.allclose(one, other, rtol=_SAME, atol=_SAME * scale, equal_nan=True):
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
            given = result.group_attrs.get(_POSTERIOR, {}).get("no_evidence")
            reasons.append(f"{which}: {given or 'computed with posterior_check: true'}")
    return f"no ratio of evidence ({'; '.join(reasons)})"
