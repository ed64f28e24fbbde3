"""Errors of roots: distances from the true ones, paired, relative to their moduli."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Errors of roots below this part of the largest pole are relative to that part.
_SMALL = 1e-3


def distance(got: Any, true: Any, size: float) -> float:
    """Return the largest relative distance of roots paired with the true ones; inf for a wrong count."""
    if len(got) != len(true):
        return float("inf")
    from scipy.optimize import linear_sum_assignment

    apart = np.abs(got[:, None] - true) / relative_to(true, size)
    return float(apart[linear_sum_assignment(apart)].max(initial=0.0))


def relative_to(true: Any, size: float) -> Any:
    """Return the sizes that errors of roots are relative to; `size` is that of the largest pole."""
    scale = np.maximum(np.abs(true), _SMALL * size)
    return np.where(scale > 0, scale, 1.0)
