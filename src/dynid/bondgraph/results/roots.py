"""Roots in a result, each with its error."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.lti import certified_roots
from dynid.lti.stability import SidedRoot
from dynid.result import Result


def roots_of(polynomial: Any) -> tuple[certified_roots.CertifiedRoot, ...]:
    """Return certified roots; the same polynomial is the answer to several questions of a port."""
    return _roots(tuple(int(c) for c in (polynomial // polynomial.content()).coeffs()))


@lru_cache(maxsize=32)
def _roots(coefficients: tuple[int, ...]) -> tuple[certified_roots.CertifiedRoot, ...]:
    from flint import fmpz_poly

    return certified_roots.certified_roots(fmpz_poly(list(coefficients)))


def add_roots(
    result: Result, group: str, name: str, roots: Sequence[SidedRoot], *, estimated: bool = False
) -> None:
    """Add roots, each as often as its multiplicity says, with certified_roots error bounds or with estimates.

    Parameters
    ----------
    result, group, name
        Where to add them: the plural, `zeros` has the axis `zero`.
    roots
        The roots.
    estimated
        Whether their errors are estimates, of roots that have residuals, too.
    """
    axis = name[:-1]
    values = each(roots, "value", np.complex128)
    result.add_axis(f"{group}/{axis}", np.arange(1, len(values) + 1))
    result.add(f"{group}/{name}", values, (axis,), "rad/s")
    error = f"{group}/{axis}_error_{'estimate' if estimated else 'bound'}"
    if result.wants(error):
        result.add(error, each(roots, "radius", np.float64), (axis,), "rad/s")
    if estimated:
        result.add(f"{group}/{axis}_residual", each(roots, "residual", np.float64), (axis,))


def each(roots: Sequence[SidedRoot], what: str, dtype: type) -> NDArray[Any]:
    """Return an attribute of roots, each as often as its multiplicity says."""
    return np.array([getattr(root, what) for root in roots for _ in range(root.multiplicity)], dtype=dtype)
