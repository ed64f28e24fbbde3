"""Direct factorisation of sparse symmetric matrices by interchangeable backends; every solution is checked.

`splu` (SuperLU, of SciPy) is always available. `pardiso` is taken for large matrices where it is installed
(`backend_for`), `cholespy` only when named; a backend that is named and not installed is refused, with the
package to install.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_matrix, issparse, triu
from scipy.sparse.linalg import SuperLU, splu

from dynid.defaults import BACKEND, LARGE_MATRICES
from dynid.errors import NumericalError, Singular, UsageError
from dynid.suggestions import did_you_mean

Array = NDArray[np.float64]

# Backward error (normwise) above which a solution is refined, and above which it is refused.
_FINE, _WORST = 1e-14, 1e-11


class BareFactors(Protocol):
    """Factors as a backend returns them, unchecked."""

    def solve(self, b: Array) -> Array:
        """Solve A x = b for one right-hand side (n) or several (n x columns)."""
        ...

    @property
    def negatives(self) -> int | None:
        """Number of negative pivots, hence of negative eigenvalues; None where the factors do not give it."""
        ...

    @property
    def memory(self) -> int:
        """Size of the factors, bytes; 0 where the backend does not report it."""
        ...

    @property
    def order(self) -> NDArray[np.intp] | None:
        """A good order of elimination (n) for matrices of the same pattern, or None."""
        ...


class _SuperLUFactors:
    """Factors of SuperLU: minimum degree on A + Aᵀ, pivots on the diagonal."""

    # An off-diagonal pivot is taken only where the diagonal one is this much smaller.
    _THRESHOLD = 1e-3
    _ROUNDING = 2 * float(np.finfo(float).eps)
    # SuperLU allocates this multiple of the entries at first, and counts it by 32 bits.
    _FILL = 30

    def __init__(self, A: csc_array, *, definite: bool, ordered: bool = False) -> None:
        if self._FILL * A.nnz > np.iinfo(np.int32).max:
            raise UsageError(
                f"a matrix of {A.nnz:,} entries is too large for SuperLU, which counts by 32 bits",
                remedy="Install dynid[solvers]: PARDISO is then used.",
            )
        try:
            self._lu: SuperLU = splu(
                A,
                permc_spec="NATURAL" if ordered else "MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0 if definite else self._THRESHOLD,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            if "singular" not in str(error):
                raise
            raise Singular(
                "the matrix is exactly singular",
                remedy="Look for DOFs without mass and stiffness, or shift the matrix.",
            ) from None
        self._matrix = A

    def solve(self, b: Array) -> Array:
        return np.asarray(self._lu.solve(np.asarray(b, dtype=self._matrix.dtype)))

    @property
    def negatives(self) -> int | None:
        """Negative signs on U's diagonal; they are an inertia only if rows and columns were permuted alike.

        Then P A Pᵀ = L U with unit L; A symmetric, so that U = D Lᵀ and D is congruent to A. A pivot that is
        rounding of its column has no sign.
        """
        if self._matrix.dtype.kind == "c" or not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            return None
        pivots = self._lu.U.diagonal()[self._lu.perm_c]
        sizes = np.asarray(abs(self._matrix).max(axis=0).todense()).ravel()
        if np.any(np.abs(pivots) <= self._ROUNDING * sizes):
            return None
        return int(np.count_nonzero(pivots < 0))

    @property
    def memory(self) -> int:
        return 12 * int(self._lu.nnz)  # a number and a row index for each entry

    @property
    def order(self) -> NDArray[np.intp]:
        return np.argsort(self._lu.perm_c)


class _CholmodFactors:
    """Factors of CHOLMOD, through cholespy: positive definite matrices."""

    negatives = 0
    memory = 0
    order = None
    _MOST_COLUMNS = 128  # of right-hand sides that cholespy takes at a time

    def __init__(self, A: csc_array, *, definite: bool) -> None:  # noqa: ARG002 - of definite matrices only
        from cholespy import CholeskySolverD, MatrixType

        try:
            self._solver = CholeskySolverD(A.shape[0], A.indptr, A.indices, A.data, MatrixType.CSC)
        except (RuntimeError, ValueError) as error:
            raise Singular(f"the matrix is not positive definite (cholespy: {error})") from None

    def solve(self, b: Array) -> Array:
        right = np.array(b, dtype=float, order="C")
        if right.ndim == 2 and right.shape[1] > self._MOST_COLUMNS:
            halves = np.array_split(right, -(-right.shape[1] // self._MOST_COLUMNS), axis=1)
            return np.concatenate([self.solve(half) for half in halves], axis=1)
        x = np.zeros_like(right)
        self._solver.solve(right, x)
        return x


class _PardisoFactors:
    """Factors of PARDISO (Intel MKL), through pypardiso: LLᵀ, or LDLᵀ with Bunch–Kaufman pivots."""

    _DEFINITE, _INDEFINITE = 2, -2
    _ANALYSE_AND_FACTORISE, _SOLVE, _RELEASE = 12, 33, -1
    # Entries of iparm (from 0) that differ from PARDISO's defaults, or must be set with them.
    _SETTINGS = (
        (0, 1),  # the rest is given here
        (1, 2),  # nested dissection by METIS
        (7, 0),  # no refinement of its own but where pivots were perturbed: ours is checked
        (9, 8),  # perturb pivots below 1e-8 (PARDISO's default for symmetric indefinite matrices)
        (17, -1),  # report the entries of the factors
        (20, 1),  # 1x1 and 2x2 Bunch–Kaufman pivots
        (34, 0),  # indices from 1
    )
    _NEGATIVES, _NOT_DEFINITE, _PERTURBED, _FACTOR_ENTRIES = 22, -4, 13, 17
    order = None

    def __init__(self, A: csc_array, *, definite: bool) -> None:
        _prepare_library()
        from pypardiso.pardiso_wrapper import PyPardisoError, PyPardisoSolver

        self._upper = csr_matrix(triu(A, format="csr"))
        self._upper.sort_indices()
        self._solver: Any = PyPardisoSolver(mtype=self._DEFINITE if definite else self._INDEFINITE)
        self._solver.perm = np.zeros(A.shape[0], dtype=np.int32)
        for entry, value in self._SETTINGS:
            self._solver.iparm[entry] = value
        self._definite = definite
        try:
            self._call(self._ANALYSE_AND_FACTORISE, np.zeros(A.shape[0]))
        except PyPardisoError as error:
            if error.value == self._NOT_DEFINITE:
                raise Singular("the matrix is singular, or not positive definite (PARDISO)") from None
            raise NumericalError(f"PARDISO failed with its error {error.value}") from None

    def _call(self, phase: int, b: Array) -> Array:
        self._solver.set_phase(phase)
        return np.asarray(self._solver._call_pardiso(self._upper, b))

    def solve(self, b: Array) -> Array:
        return self._call(self._SOLVE, np.asfortranarray(b, dtype=float))

    @property
    def negatives(self) -> int | None:
        if self._definite:
            return 0
        return None if self._solver.iparm[self._PERTURBED] else int(self._solver.iparm[self._NEGATIVES])

    @property
    def memory(self) -> int:
        return 8 * int(self._solver.iparm[self._FACTOR_ENTRIES])

    def __del__(self) -> None:
        # At the exit of the interpreter the library, or what calls it, may be gone; the memory goes with it.
        if hasattr(self, "_solver") and not sys.is_finalizing():
            self._call(self._RELEASE, np.zeros(self._upper.shape[0]))


def _prepare_library() -> None:
    """Name the library of PARDISO, for which pypardiso else looks through all installed files.

    Threads that wait for others do not use processors.
    """
    library = next(Path(sys.prefix).glob("lib/libmkl_rt.*"), None)
    if library is not None:
        os.environ.setdefault("PYPARDISO_MKL_RT", str(library))
    os.environ.setdefault("KMP_BLOCKTIME", "0")


class Backend(NamedTuple):
    """A backend: the package it imports, its name for pip, and if it takes indefinite matrices.

    `factors` makes the factors of a matrix (csc), and takes the keyword `definite`.
    """

    package: str
    requirement: str
    indefinite: bool
    factors: Callable[..., BareFactors]

    @property
    def missing(self) -> bool:
        """True where its package is not installed."""
        return find_spec(self.package) is None


BACKENDS = {
    "splu": Backend("scipy", "scipy", indefinite=True, factors=_SuperLUFactors),
    "cholespy": Backend("cholespy", "cholespy", indefinite=False, factors=_CholmodFactors),
    "pardiso": Backend("pypardiso", "pypardiso", indefinite=True, factors=_PardisoFactors),
}
"""The backends by name."""


def available() -> dict[str, bool]:
    """Return for each backend if it is installed."""
    return {name: not backend.missing for name, backend in BACKENDS.items()}


def backend_for(size: int) -> str:
    """Return the backend that a matrix of so many rows is factorised by unless one is named."""
    large = size > LARGE_MATRICES.value and not BACKENDS["pardiso"].missing
    return "pardiso" if large else BACKEND.value


def bare(A: csc_array, name: str, *, definite: bool, ordered: bool = False) -> BareFactors:
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
    if ordered and name == "splu":
        return _SuperLUFactors(A, definite=definite, ordered=True)
    return backend.factors(A, definite=definite)


@dataclass(frozen=True, eq=False)
class Factorisation:
    """A symmetric matrix with its factors, whose solutions are checked.

    `name` is the backend's, `factors` are its bare factors, `size` is the 1-norm of the matrix.
    """

    name: str
    matrix: csc_array
    factors: BareFactors
    size: float

    @cached_property
    def condition(self) -> float:
        """A lower bound of the condition, sharp to a small factor: the growth of a random right-hand side."""
        b, x = self._trial
        return self.size * float(np.abs(self._improved(x, b)).max(initial=0.0) / np.abs(b).max(initial=1.0))

    @property
    def error(self) -> float:
        """Backward error of the factors themselves: of a random right-hand side, without refinement."""
        b, x = self._trial
        return self._error(x, b, b - self.matrix @ x)

    @cached_property
    def _trial(self) -> tuple[Array, Array]:
        """A random right-hand side and its solution, without refinement."""
        b = np.random.Generator(np.random.PCG64(0)).standard_normal(self.matrix.shape[0])
        return b, self._bare(b)

    @property
    def order(self) -> NDArray[np.intp] | None:
        """The order of elimination (n), or None."""
        return self.factors.order

    @property
    def memory(self) -> int:
        """Size of the factors, bytes."""
        return self.factors.memory

    @property
    def negatives(self) -> int | None:
        """Number of negative eigenvalues (Sylvester's law of inertia), or None."""
        return self.factors.negatives

    def solve(self, b: Array) -> Array:
        """Solve A x = b; the backward error is checked, and one step of refinement taken where it helps.

        Parameters
        ----------
        b
            One right-hand side (n) or several (n x columns).

        Raises
        ------
        NumericalError
            If the solution is wrong even then.
        """
        return self._improved(self._bare(b), b)

    def _improved(self, x: Array, b: Array) -> Array:
        """Return a solution that is checked, and refined where that helps."""
        residual = b - self.matrix @ x
        error = self._error(x, b, residual)
        if error > _FINE:
            refined = x + self._bare(residual)
            closer = self._error(refined, b, b - self.matrix @ refined)
            if closer < error:
                x, error = refined, closer
        if error > _WORST:
            raise NumericalError(
                f"the solutions of the factorisation backend {self.name} are wrong "
                f"(relative residual {error:.1g} after a step of refinement)",
                remedy="Use another backend; if all fail, the matrix is singular to rounding.",
                names=(self.name,),
            )
        return x

    def _bare(self, b: Array) -> Array:
        x = np.asarray(self.factors.solve(b))
        if not np.isfinite(x).all():
            raise Singular(
                f"the matrix is singular to rounding (backend {self.name})",
                remedy="Look for DOFs without mass and stiffness, or shift the matrix.",
            )
        return x

    def _error(self, x: Array, b: Array, residual: Array) -> float:
        """Return the normwise backward error, the worst of the columns."""
        columns = (np.abs(part).max(axis=0, initial=0.0) for part in (residual, x, b))
        left, solution, right = columns
        scale = self.size * solution + right
        return float(np.max(left / np.where(scale > 0, scale, 1.0)))


def factorise(
    A: csc_array, backend: str = "auto", *, definite: bool = False, ordered: bool = False
) -> Factorisation:
    """Factorise a symmetric sparse matrix.

    A random right-hand side is solved at once, so that a backend that returns wrong solutions is refused
    before anything is built on it.

    Parameters
    ----------
    A
        The matrix (n x n), symmetric, scaled so that its entries are of like size. A complex one, symmetric
        too and not Hermitian, is taken by `splu` alone.
    backend
        One of `BACKENDS`, or ``auto``: `backend_for` its size.
    definite
        True of a positive definite matrix: some backends take no others, and others are faster then.
    ordered
        True if rows and columns are in a good order of elimination already (`Factorisation.order`).

    Raises
    ------
    UsageError
        If the matrix is not sparse and square, or there is no such backend, or it is not installed.
    Singular
        If the matrix is singular, or not definite where it should be.
    NumericalError
        If the backend's solutions are wrong.
    """
    if not issparse(A) or A.shape[0] != A.shape[1]:
        raise UsageError("a matrix to be factorised must be sparse and square")
    A = csc_array(A, dtype=complex if np.iscomplexobj(A) else float)
    if backend == "auto":
        backend = "splu" if np.iscomplexobj(A) else backend_for(A.shape[0])
    A.sort_indices()
    if not np.isfinite(A.data).all():
        raise UsageError("a matrix to be factorised has entries that are not finite numbers")
    size = float(np.asarray(abs(A).sum(axis=0)).max(initial=0.0))
    factor = Factorisation(backend, A, bare(A, backend, definite=definite, ordered=ordered), size)
    _ = factor.condition  # which is a checked solve
    return factor
