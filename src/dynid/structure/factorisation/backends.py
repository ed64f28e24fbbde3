"""The backends by name: where they live, what they need, what they can."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from dynid.errors import UsageError
from dynid.words import did_you_mean

Array = NDArray[np.float64]


class Solver(Protocol):
    """What a backend returns: the bare factors, nothing checked."""

    def solve(self, b: Array) -> Array:
        """Solve A x = b for one right-hand side (n) or several (n x columns)."""
        ...

    @property
    def negatives(self) -> int | None:
        """Number of negative pivots, hence of negative eigenvalues; None where the factors do not tell."""
        ...

    @property
    def memory(self) -> int:
        """Size of the factors, bytes, as far as the backend tells."""
        ...


class Backend(NamedTuple):
    """A backend: the package it imports, what pip calls it, and whether it takes indefinite matrices."""

    package: str
    requirement: str
    indefinite: bool

    @property
    def missing(self) -> bool:
        """Whether its package is not installed."""
        return find_spec(self.package) is None


BACKENDS = {
    "splu": Backend("scipy", "scipy", indefinite=True),
    "cholespy": Backend("cholespy", "cholespy", indefinite=False),
    "pardiso": Backend("pypardiso", "pypardiso", indefinite=True),
}
"""The backends by name; a module of this package has the name of each."""


def available() -> dict[str, bool]:
    """Return which backends are installed."""
    return {name: not backend.missing for name, backend in BACKENDS.items()}


def bare(A: csc_array, name: str, *, definite: bool) -> Solver:
    """Factorise with a backend.

    Raises
    ------
    UsageError
        If there is no such backend, it is not installed, or it does not take indefinite matrices.
    """
    if name not in BACKENDS:
        raise UsageError(
            f"there is no factorisation backend {name!r}{did_you_mean(name, BACKENDS)}",
            remedy=f"Use one of {', '.join(BACKENDS)}.",
            names=(name,),
        )
    backend = BACKENDS[name]
    if backend.missing:
        raise UsageError(
            f"the factorisation backend {name} is not installed",
            remedy=f"Install the package {backend.requirement}, or use splu, which is always there.",
            names=(name,),
        )
    if np.iscomplexobj(A) and name != "splu":
        raise UsageError(
            f"the factorisation backend {name} takes real matrices only",
            remedy="Of complex ones use splu.",
            names=(name,),
        )
    if not (definite or backend.indefinite):
        takes = ", ".join(other for other, its in BACKENDS.items() if its.indefinite)
        raise UsageError(
            f"the factorisation backend {name} takes positive definite matrices only",
            remedy=f"Of indefinite ones use {takes}.",
            names=(name,),
        )
    solver: Solver = import_module(f"{__package__}.{name}").factorised(A, definite=definite)
    return solver
