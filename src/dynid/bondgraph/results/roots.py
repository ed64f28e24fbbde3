"""Roots in a result, each with its certified error bound."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from dynid.lti.certified import Root, certified_roots, repeated
from dynid.result import Result


def roots_of(polynomial: Any) -> tuple[Root, ...]:
    """Return certified roots; the same polynomial is the answer to several questions of a port."""
    return _roots(tuple(int(c) for c in (polynomial // polynomial.content()).coeffs()))


@lru_cache(maxsize=32)
def _roots(coefficients: tuple[int, ...]) -> tuple[Root, ...]:
    from flint import fmpz_poly

    return certified_roots(fmpz_poly(list(coefficients)))


def add_roots(result: Result, group: str, name: str, roots: Sequence[Root]) -> None:
    """Add roots with their certified error bounds, each as often as its multiplicity says."""
    axis = name[:-1]
    values = repeated(roots)
    radii = [root.radius for root in roots for _ in range(root.multiplicity)]
    result.add_axis(f"{group}/{axis}", np.arange(1, len(values) + 1))
    result.add(f"{group}/{name}", values, (axis,), "rad/s")
    result.add(f"{group}/{axis}_error_bound", np.array(radii, dtype=float), (axis,), "rad/s")
