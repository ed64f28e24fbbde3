"""Direct solvers of sparse symmetric matrices, by interchangeable backends; nothing is checked here.

`ldl` is the project's own (`native/ldl.c`), taken wherever the library of `dynid.native` is there; `splu`
(SuperLU, of SciPy) is always available and pivots. `pardiso` and `cholespy` are other packages'. A backend
that is named and not installed is refused, with the package to install.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_matrix, triu
from scipy.sparse.linalg import SuperLU, splu

from dynid.arrays import Array
from dynid.defaults import BACKEND, FULL_ROWS, LARGE_MATRICES
from dynid.errors import NumericalError, Singular, UsageError
from dynid.native import call, compiled
from dynid.suggestions import did_you_mean

Order: TypeAlias = NDArray[np.int32]

# A pivot that is a smaller part of its column's largest entry is rounding, and has no sign.
_ROUNDING = 2 * float(np.finfo(float).eps)


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
    def order(self) -> Order | None:
        """A good order of elimination (n) for matrices of the same pattern, or None."""
        ...


class _LDLFactors:
    """Factors L D Lᵀ of the library of `dynid.native`: own order of elimination, pivots on the diagonal."""

    _handle = 0
    _UNSYMMETRIC = -1

    def __init__(self, A: csc_array, *, definite: bool, order: Order | None = None) -> None:
        n = A.shape[0]
        self._matrix = A
        if n > np.iinfo(np.int32).max:
            raise UsageError(f"a matrix of {n:,} rows is too large: rows are counted by 32 bits")
        stopped = self._factorise(A, order)
        if stopped == self._UNSYMMETRIC:  # entries of zero, or of rounding, on one side of the diagonal only
            both = csc_array((A + A.T) / 2)
            both.sort_indices()
            order = self.order
            call("dynid_ldl_free", self._handle)
            self._handle = 0
            stopped = self._factorise(both, order)
        if stopped or (definite and self._pivots.min(initial=1.0) <= 0):
            raise Singular(
                "the matrix is singular, or not positive definite" if definite else "a pivot is zero",
                remedy="Look for DOFs without mass and stiffness, or shift the matrix.",
            )

    def _factorise(self, A: csc_array, order: Order | None) -> int:
        """Return 0, or where a pivot is zero, or `_UNSYMMETRIC`."""
        n, starts = A.shape[0], A.indptr.astype(np.int64)
        indices, data = np.ascontiguousarray(A.indices, dtype=np.int32), np.ascontiguousarray(A.data)
        self._handle = call("dynid_ldl_analyse", n, starts, indices, order)
        self._pivots = np.empty(n)
        return call("dynid_ldl_factorise", self._handle, starts, indices, data, self._pivots)

    def solve(self, b: Array) -> Array:
        x = np.array(b, dtype=float, order="C")
        call("dynid_ldl_solve", self._handle, 1 if x.ndim == 1 else x.shape[1], x)
        return x

    @property
    def negatives(self) -> int | None:
        return _negative(self._pivots, self._matrix)

    @property
    def memory(self) -> int:
        return call("dynid_ldl_bytes", self._handle)

    @property
    def order(self) -> Order:
        order = np.empty(self._matrix.shape[0], dtype=np.int32)
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


class _SuperLUFactors:
    """Factors of SuperLU: minimum degree on A + Aᵀ, pivots on the diagonal."""

    # An off-diagonal pivot is taken only where the diagonal one is this much smaller.
    _THRESHOLD = 1e-3
    # SuperLU allocates this multiple of the entries at first, and counts it by 32 bits.
    _FILL = 30

    def __init__(self, A: csc_array, *, definite: bool, order: Order | None = None) -> None:
        if self._FILL * A.nnz > np.iinfo(np.int32).max:
            raise UsageError(
                f"a matrix of {A.nnz:,} entries is too large for SuperLU, which counts by 32 bits",
                remedy="Install dynid where there is a C compiler, or install dynid[solvers].",
            )
        self._known = order
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
        self._matrix = A

    def solve(self, b: Array) -> Array:
        b = np.asarray(b, dtype=self._matrix.dtype)
        if self._known is None:
            return np.asarray(self._lu.solve(b))
        x = np.empty_like(b)
        x[self._known] = self._lu.solve(b[self._known])
        return x

    @property
    def negatives(self) -> int | None:
        """Negative signs on U's diagonal; they are an inertia only if rows and columns were permuted alike.

        Then P A Pᵀ = L U with unit L; A symmetric, so that U = D Lᵀ and D is congruent to A. A pivot that is
        rounding of its column has no sign.
        """
        if self._matrix.dtype.kind == "c" or not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            return None
        return _negative(self._lu.U.diagonal()[self._lu.perm_c], self._matrix)

    @property
    def memory(self) -> int:
        return 12 * int(self._lu.nnz)  # a number and a row index for each entry

    @property
    def order(self) -> Order:
        inner_order = np.argsort(self._lu.perm_c).astype(np.int32)
        return inner_order if self._known is None else self._known[inner_order]


class _CholmodFactors:
    """Factors of CHOLMOD, through cholespy: positive definite matrices."""

    negatives = 0
    memory = 0
    order = None
    _MOST_COLUMNS = 128  # of right-hand sides that cholespy takes at a time

    def __init__(self, A: csc_array, *, definite: bool, order: Order | None = None) -> None:  # noqa: ARG002
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

    def __init__(self, A: csc_array, *, definite: bool, order: Order | None = None) -> None:  # noqa: ARG002
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

    `factors` makes the factors of a matrix (csc, indices ascending), and takes the keywords `definite` and
    `order`, a good order of elimination, which it may ignore.
    """

    package: str
    requirement: str
    indefinite: bool
    factors: Callable[..., BareFactors]

    @property
    def missing(self) -> bool:
        """True where its package is not installed, or was without its library."""
        return not compiled() if self.package == "dynid" else find_spec(self.package) is None


BACKENDS = {
    "ldl": Backend("dynid", "dynid, where there is a C compiler", indefinite=True, factors=_LDLFactors),
    "splu": Backend("scipy", "scipy", indefinite=True, factors=_SuperLUFactors),
    "cholespy": Backend("cholespy", "cholespy", indefinite=False, factors=_CholmodFactors),
    "pardiso": Backend("pypardiso", "pypardiso", indefinite=True, factors=_PardisoFactors),
}
"""The backends by name."""


def available() -> dict[str, bool]:
    """Return for each backend if it is installed."""
    return {name: not backend.missing for name, backend in BACKENDS.items()}


def backend_for(size: int, entries: int = 0) -> str:
    """Return the backend that a matrix is factorised by unless one is named.

    Parameters
    ----------
    size
        The number of its rows.
    entries
        The number of its entries; 0: unknown.
    """
    has_library = not BACKENDS[BACKEND.value].missing
    large = size > LARGE_MATRICES.value and (not has_library or entries > FULL_ROWS.value * size)
    if large and not BACKENDS["pardiso"].missing:
        return "pardiso"
    return BACKEND.value if has_library else "splu"


def bare(A: csc_array, name: str, *, definite: bool, order: Order | None = None) -> BareFactors:
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
            remedy=f"Install {backend.requirement}, or use splu, which is always there.",
            names=(name,),
        )
    if np.iscomplexobj(A) and name != "splu":
        raise UsageError(
            f"the factorisation backend {name} takes real matrices only",
            remedy="Of complex ones use splu.",
            names=(name,),
        )
    if not (definite or backend.indefinite):
        takes = ", ".join(alternative for alternative, its in BACKENDS.items() if its.indefinite)
        raise UsageError(
            f"the factorisation backend {name} takes positive definite matrices only",
            remedy=f"Of indefinite ones use {takes}.",
            names=(name,),
        )
    return backend.factors(A, definite=definite, order=order)
