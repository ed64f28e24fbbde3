"""Factors of sparse symmetric matrices by interchangeable backends; all solutions are checked.

`ldl` is the project's own (`native/ldl.c`), taken wherever the library of `dynid.native` is there; `splu`
(SuperLU, of SciPy) is always available and pivots. `pardiso` and `cholespy` are other packages'. A backend
that is named and not installed is refused, with the package to install.
"""

from __future__ import annotations

import os
import sys
from abc import ABC, abstractmethod
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_matrix, issparse, triu
from scipy.sparse.linalg import SuperLU, splu

from dynid.arrays import Array
from dynid.defaults import BACKEND, FULL_ROWS, LARGE_MATRICES
from dynid.errors import NumericalError, Singular, UsageError
from dynid.native import call, compiled
from dynid.suggestions import did_you_mean

Order: TypeAlias = NDArray[np.int32]

# Backward error (normwise) above which a solution is refined, and above which it is refused.
_FINE, _WORST = 1e-14, 1e-11
# A pivot that is a smaller part of its column's largest entry is rounding, and has no sign.
_ROUNDING = 2 * float(np.finfo(float).eps)


class Factorisation(ABC):
    """A symmetric matrix with its factors, whose solutions are checked.

    `matrix`: the matrix (n x n, csc, indices ascending); `definite`: True of a positive definite matrix;
    `order`: a good order of elimination (n), which a backend may ignore.
    """

    name: str
    # The package that is imported, and its name for pip; False of a backend for definite matrices only.
    package: str
    requirement: str
    indefinite = True

    def __init__(self, matrix: csc_array, *, definite: bool, order: Order | None = None) -> None:
        self.matrix = matrix
        self.size = float(np.asarray(abs(matrix).sum(axis=0)).max(initial=0.0))  # 1-norm
        self._factorise(matrix, order, definite=definite)

    @abstractmethod
    def _factorise(self, A: csc_array, order: Order | None, *, definite: bool) -> None: ...

    @abstractmethod
    def _solve(self, b: Array) -> Array: ...

    @classmethod
    def missing(cls) -> bool:
        """Return True where its package is not installed, or was without its library."""
        return not compiled() if cls.package == "dynid" else find_spec(cls.package) is None

    @property
    def order(self) -> Order | None:
        """A good order of elimination (n) for matrices of the same pattern, or None."""
        return None

    @property
    def memory(self) -> int:
        """Size of the factors, bytes; 0 where the backend does not report it."""
        return 0

    @property
    def negatives(self) -> int | None:
        """Number of negative pivots, hence of negative eigenvalues; None where the factors do not give it."""
        return 0

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
        return b, self._finite_solution(b)

    def solve(self, b: Array) -> Array:
        """Solve A x = b; the backward error is checked, and one step of refinement taken where it helps.

        `b`: one right-hand side (n) or several (n x columns). Raises NumericalError if the solution is wrong
        even then.
        """
        return self._improved(self._finite_solution(b), b)

    def _improved(self, x: Array, b: Array) -> Array:
        """Return a solution that is checked, and refined where that helps."""
        residual = b - self.matrix @ x
        error = self._error(x, b, residual)
        if error > _FINE:
            refined = x + self._finite_solution(residual)
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

    def _finite_solution(self, b: Array) -> Array:
        x = np.asarray(self._solve(b))
        if not np.isfinite(x).all():
            raise Singular(
                f"the matrix is singular to rounding (backend {self.name})",
                remedy="Look for DOFs without mass and stiffness, or shift the matrix.",
            )
        return x

    def _error(self, x: Array, b: Array, residual: Array) -> float:
        """Return the normwise backward error, the worst of the columns."""
        left, solution, right = (np.abs(array).max(axis=0, initial=0.0) for array in (residual, x, b))
        scale = self.size * solution + right
        return float(np.max(left / np.where(scale > 0, scale, 1.0)))


class _LDL(Factorisation):
    """Factors L D Lᵀ of the library of `dynid.native`: own order of elimination, pivots on the diagonal."""

    name, package, requirement = "ldl", "dynid", "dynid, where there is a C compiler"
    _handle = 0
    _UNSYMMETRIC = -1

    def _factorise(self, A: csc_array, order: Order | None, *, definite: bool) -> None:
        n = A.shape[0]
        if n > np.iinfo(np.int32).max:
            raise UsageError(f"a matrix of {n:,} rows is too large: rows are counted by 32 bits")
        stopped = self._eliminate(A, order)
        if stopped == self._UNSYMMETRIC:  # entries of zero, or of rounding, on one side of the diagonal only
            both = csc_array((A + A.T) / 2)
            both.sort_indices()
            order = self.order
            call("dynid_ldl_free", self._handle)
            self._handle = 0
            stopped = self._eliminate(both, order)
        if stopped or (definite and self._pivots.min(initial=1.0) <= 0):
            raise Singular(
                "the matrix is singular, or not positive definite" if definite else "a pivot is zero",
                remedy="Look for DOFs without mass and stiffness, or shift the matrix.",
            )

    def _eliminate(self, A: csc_array, order: Order | None) -> int:
        """Return 0, or where a pivot is zero, or `_UNSYMMETRIC`."""
        n, starts = A.shape[0], A.indptr.astype(np.int64)
        indices, data = np.ascontiguousarray(A.indices, dtype=np.int32), np.ascontiguousarray(A.data)
        self._handle = call("dynid_ldl_analyse", n, starts, indices, order)
        self._pivots = np.empty(n)
        return call("dynid_ldl_factorise", self._handle, starts, indices, data, self._pivots)

    def _solve(self, b: Array) -> Array:
        x = np.array(b, dtype=float, order="C")
        call("dynid_ldl_solve", self._handle, 1 if x.ndim == 1 else x.shape[1], x)
        return x

    @property
    def negatives(self) -> int | None:
        return _negative(self._pivots, self.matrix)

    @property
    def memory(self) -> int:
        return call("dynid_ldl_bytes", self._handle)

    @property
    def order(self) -> Order:
        order = np.empty(self.matrix.shape[0], dtype=np.int32)
        call("dynid_ldl_order", self._handle, order)
        return order

    def __del__(self) -> None:
        if self._handle and not sys.is_finalizing():
            call("dynid_ldl_free", self._handle)


def _negative(pivots: Array, A: csc_array) -> int | None:
    """Return the number of negative pivots, of a matrix's rows; None where one is rounding of its column."""
    sizes = np.zeros(A.shape[0])
    filled = np.flatnonzero(np.diff(A.indptr))
    sizes[filled] = np.maximum.reduceat(np.abs(A.data), A.indptr[filled])
    return None if np.any(np.abs(pivots) <= _ROUNDING * sizes) else int(np.count_nonzero(pivots < 0))


class _SuperLU(Factorisation):
    """Factors of SuperLU: minimum degree on A + Aᵀ, pivots on the diagonal."""

    name, package, requirement = "splu", "scipy", "scipy"

    # An off-diagonal pivot is taken only where the diagonal one is this much smaller.
    _THRESHOLD = 1e-3
    # SuperLU allocates this multiple of the entries at first, and counts it by 32 bits.
    _FILL = 30

    def _factorise(self, A: csc_array, order: Order | None, *, definite: bool) -> None:
        if self._FILL * A.nnz > np.iinfo(np.int32).max:
            raise UsageError(
                f"a matrix of {A.nnz:,} entries is too large for SuperLU, which counts by 32 bits",
                remedy="Install dynid where there is a C compiler, or install dynid[solvers].",
            )
        self._given_order = order
        if order is not None:
            A = A[order][:, order]
        try:
            self._lu: SuperLU = splu(
                A,
                permc_spec="MMD_AT_PLUS_A" if order is None else "NATURAL",
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
        self._ordered = A

    def _solve(self, b: Array) -> Array:
        b = np.asarray(b, dtype=self._ordered.dtype)
        if self._given_order is None:
            return np.asarray(self._lu.solve(b))
        x = np.empty_like(b)
        x[self._given_order] = self._lu.solve(b[self._given_order])
        return x

    @property
    def negatives(self) -> int | None:
        """Negative signs on U's diagonal; they are an inertia only if rows and columns were permuted alike.

        Then P A Pᵀ = L U with unit L; A symmetric, so that U = D Lᵀ and D is congruent to A. A pivot that is
        rounding of its column has no sign.
        """
        if self._ordered.dtype.kind == "c" or not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            return None
        return _negative(self._lu.U.diagonal()[self._lu.perm_c], self._ordered)

    @property
    def memory(self) -> int:
        return 12 * int(self._lu.nnz)  # a number and a row index for each entry

    @property
    def order(self) -> Order:
        inner_order = np.argsort(self._lu.perm_c).astype(np.int32)
        return inner_order if self._given_order is None else self._given_order[inner_order]


class _Cholmod(Factorisation):
    """Factors of CHOLMOD, through cholespy: positive definite matrices."""

    name = package = requirement = "cholespy"
    indefinite = False
    _MOST_COLUMNS = 128  # of right-hand sides that cholespy takes at a time

    def _factorise(self, A: csc_array, order: Order | None, *, definite: bool) -> None:  # noqa: ARG002
        from cholespy import CholeskySolverD, MatrixType

        try:
            self._solver = CholeskySolverD(A.shape[0], A.indptr, A.indices, A.data, MatrixType.CSC)
        except (RuntimeError, ValueError) as error:
            raise Singular(f"the matrix is not positive definite (cholespy: {error})") from None

    def _solve(self, b: Array) -> Array:
        right = np.array(b, dtype=float, order="C")
        if right.ndim == 2 and right.shape[1] > self._MOST_COLUMNS:
            halves = np.array_split(right, -(-right.shape[1] // self._MOST_COLUMNS), axis=1)
            return np.concatenate([self._solve(half) for half in halves], axis=1)
        x = np.zeros_like(right)
        self._solver.solve(right, x)
        return x


class _Pardiso(Factorisation):
    """Factors of PARDISO (Intel MKL), through pypardiso: LLᵀ, or LDLᵀ with Bunch–Kaufman pivots."""

    name, package, requirement = "pardiso", "pypardiso", "pypardiso"

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

    def _factorise(self, A: csc_array, order: Order | None, *, definite: bool) -> None:  # noqa: ARG002
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

    def _solve(self, b: Array) -> Array:
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


BACKENDS: dict[str, type[Factorisation]] = {
    backend.name: backend for backend in (_LDL, _SuperLU, _Cholmod, _Pardiso)
}
"""The backends by name."""


# Backward error, without refinement, of factors without pivoting above which the matrix is pivoted.
_UNPIVOTED = 1e-12


def backend_for(size: int, entries: int = 0) -> str:
    """Return the backend that a matrix is factorised by unless one is named.

    `size`: the number of its rows; `entries`: the number of its entries; 0: unknown.
    """
    has_library = not BACKENDS[BACKEND.value].missing()
    large = size > LARGE_MATRICES.value and (not has_library or entries > FULL_ROWS.value * size)
    if large and not BACKENDS["pardiso"].missing():
        return "pardiso"
    return BACKEND.value if has_library else "splu"


def factorise(
    A: csc_array, backend: str = "auto", *, definite: bool = False, order: Order | None = None
) -> Factorisation:
    """Factorise a symmetric sparse matrix.

    A random right-hand side is solved at once, so that a backend that returns wrong solutions is refused
    before anything is built on it.

    `A`: the matrix (n x n), symmetric, scaled so that its entries are of like size; a complex one, symmetric
    too and not Hermitian, is taken by `splu` alone; `backend`: one of `BACKENDS`, or ``auto``: that of
    `backend_for`; ``ldl`` leaves a matrix that is not definite, and not to be factorised without pivoting, to
    ``splu``; `definite`: True of a positive definite matrix: some backends take no others, and others are
    faster then; `order`: a good order of elimination (n), of a matrix of the same pattern.

    Raises UsageError if the matrix is not sparse and square, or a backend does not exist, is not installed,
    or does not take such matrices, Singular if the matrix is singular, or not definite where it should be,
    and NumericalError if the backend's solutions are wrong.
    """
    if not issparse(A) or A.shape[0] != A.shape[1]:
        raise UsageError("a matrix to be factorised must be sparse and square")
    A = csc_array(A, dtype=complex if np.iscomplexobj(A) else float)
    if backend == "auto":
        backend = "splu" if np.iscomplexobj(A) else backend_for(A.shape[0], A.nnz)
    A.sort_indices()
    if not np.isfinite(A.data).all():
        raise UsageError("a matrix to be factorised has entries that are not finite numbers")
    _check_backend(backend, definite=definite, real=not np.iscomplexobj(A))
    if backend == "ldl" and not definite:
        try:
            factor = BACKENDS[backend](A, definite=False, order=order)
            if factor.error <= _UNPIVOTED:
                _ = factor.condition
                return factor
        except Singular:
            pass
        backend = "splu"
    factor = BACKENDS[backend](A, definite=definite, order=order)
    _ = factor.condition  # which is a checked solve
    return factor


def _check_backend(name: str, *, definite: bool, real: bool) -> None:
    """Refuse a backend that does not exist, is not installed, or does not take such matrices."""
    backend = BACKENDS.get(name)
    if backend is None:
        problem = f"there is no factorisation backend {name!r}{did_you_mean(name, BACKENDS)}"
        remedy = f"Use one of {', '.join(BACKENDS)}."
    elif backend.missing():
        problem = f"the factorisation backend {name} is not installed"
        remedy = f"Install {backend.requirement}, or use splu, which is always there."
    elif not real and name != "splu":
        problem = f"the factorisation backend {name} takes real matrices only"
        remedy = "Of complex ones use splu."
    elif not (definite or backend.indefinite):
        takes = ", ".join(alternative for alternative, its in BACKENDS.items() if its.indefinite)
        problem = f"the factorisation backend {name} takes positive definite matrices only"
        remedy = f"Of indefinite ones use {takes}."
    else:
        return
    raise UsageError(problem, remedy=remedy, names=(name,))
