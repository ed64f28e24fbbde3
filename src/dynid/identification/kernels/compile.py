"""How kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}


def kernel(function: F) -> F:
    """Compile on first call; kept on disk for the next process where a folder for it can be written."""
    try:
        compiled: F = numba.njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # numba finds no folder to write to
        compiled = numba.njit(**_OPTIONS)(function)
    return compiled


def inlined(function: F) -> F:
    """Compile into its callers: handing over a table of arrays takes longer than some of the work on them."""
    compiled: F = numba.njit(inline="always", **_OPTIONS)(function)
    return compiled
