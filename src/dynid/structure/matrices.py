"""Structural matrices, dense or sparse: finite, symmetric, semidefinite; an error names the entry.

Sparse matrices stay sparse; SciPy is loaded by whoever makes one, never here for dense models.

Matrices that depend on unknown parameters are a constant matrix and multiples of constant patterns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Dependent, Real, like_terms
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure.labels import Label as Label

if TYPE_CHECKING:
    from scipy.sparse import csc_array
    from typing_extensions import TypeIs

    Sparse: TypeAlias = csc_array[np.float64]


Matrix: TypeAlias = "Array | Sparse"

NAMES = {"M": "mass", "C": "damping", "K": "stiffness", "H": "structural damping"}
"""Names of the matrices in sentences."""

# Two triangles that differ by less, relative to the largest entries of row and column, are one matrix.
_SYMMETRY = 1e-10
# An eigenvalue this far below zero, after scaling to a unit diagonal, is rounding of a file's digits.
_DIGITS_INDEFINITENESS = 1e-7
_LANCZOS_STEPS = 40


def is_sparse(matrix: Any) -> TypeIs[Sparse]:
    """Return True of a matrix of `scipy.sparse`."""
    return not isinstance(matrix, np.ndarray) and hasattr(matrix, "tocsc")


def as_array(matrix: Matrix) -> Array:
    """Return a matrix with all its zeros."""
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def nothing(n: int, *, sparse: bool) -> Matrix:
    """Return an n x n matrix of zeros."""
    if not sparse:
        return np.zeros((n, n))
    from scipy.sparse import csc_array  # loaded already by whoever has sparse matrices

    return csc_array((n, n), dtype=np.float64)


def congruent(T: Any, matrix: Matrix) -> Any:
    """Return a symmetric matrix in the coordinates q of ``x = T q``, T^T A T; sparse where it and T are."""
    product = T.T @ (matrix @ T)
    return product.tocsc() if is_sparse(product) else (product + product.T) / 2


def combined(alpha: float, A: Matrix, beta: float, B: Matrix) -> Matrix:
    """Return ``alpha A + beta B``, sparse where both are."""
    if isinstance(A, np.ndarray) or isinstance(B, np.ndarray):
        return alpha * as_array(A) + beta * as_array(B)
    total: Sparse = (alpha * A + beta * B).tocsc()
    return total


def as_matrix(name: str, values: Any, n: int, *, sparse: bool = False) -> Matrix:
    """Return an n x n matrix in double precision, finite and exactly symmetric, read-only where dense.

    `name`: ``M``, ``C`` or ``K``; `values`: array-like, or a sparse matrix; `n`: the size it must have;
    `sparse`: True to make a dense matrix sparse. Raises UsageError if it has another size, an entry that is
    not finite, or is not symmetric to rounding.
    """
    if is_sparse(values) or sparse:
        from scipy.sparse import csc_array  # loaded already where `values` are sparse

        matrix: Matrix = csc_array(values, dtype=np.float64, copy=True)
    else:
        matrix = np.array(values, dtype=np.float64)
    if matrix.shape != (n, n) or n == 0:
        size = " x ".join(map(str, matrix.shape)) or "a number"
        raise UsageError(
            f"the {NAMES[name]} matrix is {size}, but must be {n or 1} x {n or 1}", names=(NAMES[name],)
        )
    rows, columns, entries = triplets(matrix)
    if not np.isfinite(entries).all():
        at = int(np.argmin(np.isfinite(entries)))
        raise UsageError(
            f"{NAMES[name]} has no number at entry {_entry(rows, columns, at)}: {entries[at]}",
            names=(NAMES[name],),
        )
    return _symmetric(name, matrix)


def triplets(matrix: Matrix) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return rows, columns (from 0) and values of the entries that may differ from zero."""
    if isinstance(matrix, np.ndarray):
        rows, columns = np.nonzero(matrix)
        return rows, columns, matrix[rows, columns]
    coo = matrix.tocoo()
    return coo.row.astype(np.intp), coo.col.astype(np.intp), coo.data


def check_semidefinite(name: str, matrix: Matrix, labels: Sequence[Label]) -> None:
    """Refuse an indefinite matrix.

    The matrix is scaled to a unit diagonal. Dense, it is decided by a Cholesky factorisation; of a sparse
    one the entries and the lower end of a Lanczos spectrum are looked at, which can overlook a negative
    eigenvalue close to zero: the inertia count of the modes does not.

    `name`: ``M`` or ``K``; `matrix`: the matrix, symmetric; `labels`: labels of its DOFs. Raises UsageError
    naming an entry, or the DOF that the negative direction moves most.
    """
    diagonal = np.asarray(matrix.diagonal())
    if diagonal.min() < 0:
        at = int(np.argmin(diagonal))
        raise _wrong(name, f"is negative: entry ({at + 1}, {at + 1}) is {diagonal[at]:.6g}", labels[at])
    root = np.sqrt(diagonal)
    _check_minors(name, matrix, diagonal, root, labels)
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)
    lowest = None
    if is_sparse(matrix):
        lowest = _lowest_sparse(matrix, inverse)
    else:
        scaled = np.asarray(matrix) * inverse * inverse[:, None]
        try:
            np.linalg.cholesky(scaled + _DIGITS_INDEFINITENESS * np.eye(len(scaled)))
        except np.linalg.LinAlgError:
            values, vectors = np.linalg.eigh(scaled)
            lowest = float(values[0]), vectors[:, 0] * inverse
    if lowest is not None:
        value, vector = lowest
        worst = labels[int(np.argmax(np.abs(vector)))]
        raise _wrong(
            name,
            f"is indefinite: scaled to a unit diagonal its lowest eigenvalue is {value:.3g}, "
            f"and that direction moves DOF {worst} most",
            worst,
        )


def _check_minors(name: str, matrix: Matrix, diagonal: Array, root: Array, labels: Sequence[Label]) -> None:
    """Refuse an entry that is larger than those on the diagonal, in its row and its column, allow."""
    rows, columns, entries = triplets(matrix)
    excess = np.abs(entries) - (1 + _DIGITS_INDEFINITENESS) * root[rows] * root[columns]
    # Beside a zero on the diagonal anything is too much, but for rounding.
    tiny = np.finfo(float).eps * float(diagonal.max(initial=0.0))
    if excess.max(initial=0.0) > tiny:
        at = int(np.argmax(excess))
        i, j = rows[at], columns[at]
        raise _wrong(
            name,
            f"is indefinite: entry {_entry(rows, columns, at)} is {entries[at]:.6g} between diagonal "
            f"entries {diagonal[i]:.6g} and {diagonal[j]:.6g}",
            labels[i],
        )


def _wrong(name: str, problem: str, label: Label) -> UsageError:
    """Return the error about a matrix at a DOF."""
    what = NAMES[name]
    remedy = f"Check signs and units of the {what} there."
    return UsageError(f"{what} {problem}", remedy=remedy, names=(what, str(label)))


def _symmetric(name: str, matrix: Matrix) -> Matrix:
    transposed: Matrix = matrix.T if isinstance(matrix, np.ndarray) else matrix.T.tocsc()
    difference: Any = matrix - transposed
    rows, columns, gaps = triplets(difference)
    if not gaps.any():
        return _frozen(matrix)
    size = np.maximum(_row_size(matrix), _row_size(transposed))
    excess = np.abs(gaps) - _SYMMETRY * np.sqrt(size[rows]) * np.sqrt(size[columns])
    if excess.max() > 0:
        at = int(np.argmax(excess))
        i, j = sorted((int(rows[at]), int(columns[at])))
        all_rows, all_columns, entries = triplets(matrix)
        sides, missing = np.sign(all_columns - all_rows)[entries != 0], ""
        for side, triangle in ((1, "upper"), (-1, "lower")):
            if not np.any(sides == side):
                missing = f"; its {triangle} triangle is missing, and both must be stored"
        raise UsageError(
            f"{NAMES[name]} is not symmetric: entry ({i + 1}, {j + 1}) is {matrix[i, j]:.6g}, "
            f"({j + 1}, {i + 1}) is {matrix[j, i]:.6g}{missing}",
            remedy="Structural matrices are symmetric; check how it was written.",
            names=(NAMES[name],),
        )
    return _frozen(matrix - difference / 2)


def _frozen(matrix: Matrix) -> Matrix:
    if isinstance(matrix, np.ndarray):
        matrix.setflags(write=False)
    return matrix


def _row_size(matrix: Matrix) -> Array:
    if isinstance(matrix, np.ndarray):
        return np.asarray(np.abs(matrix).max(axis=1))
    return np.asarray(abs(matrix).max(axis=1).toarray()).ravel()


def _entry(rows: NDArray[np.intp], columns: NDArray[np.intp], at: int) -> str:
    return f"({rows[at] + 1}, {columns[at] + 1})"


def _lowest_sparse(matrix: Sparse, inverse: Array) -> tuple[float, Array] | None:
    """Return a negative Ritz pair of a short Lanczos run, if any: Ritz values lie within the spectrum."""
    start = np.random.Generator(np.random.PCG64(0)).standard_normal(len(inverse))
    basis = [start / np.linalg.norm(start)]
    alpha: list[float] = []
    beta: list[float] = []
    for _ in range(min(_LANCZOS_STEPS, len(inverse))):
        q = basis[-1]
        r = inverse * (matrix @ (inverse * q))
        alpha.append(float(q @ r))
        r -= alpha[-1] * q + (beta[-1] * basis[-2] if beta else 0.0)
        norm = float(np.linalg.norm(r))
        if norm < 1e-12:
            break
        beta.append(norm)
        basis.append(r / norm)
    k = len(alpha)
    tridiagonal = np.diag(alpha) + np.diag(beta[: k - 1], 1) + np.diag(beta[: k - 1], -1)
    values, vectors = np.linalg.eigh(tridiagonal)
    if values[0] >= -_DIGITS_INDEFINITENESS:
        return None
    return float(values[0]), np.asarray(np.column_stack(basis[:k]) @ vectors[:, 0] * inverse)


@dataclass(frozen=True, eq=False)
class DependentMatrix:
    """A matrix ``A + sum c_i P_i``: a constant one, and numbers that depend on parameters times patterns.

    Where nothing depends on parameters it is the constant matrix alone, with the arithmetic of arrays.
    """

    constant: Matrix  # the part A that depends on no parameter
    terms: tuple[tuple[Dependent, Matrix], ...] = ()  # the pairs (c, P)

    @property
    def reference(self) -> Matrix:
        """The matrix at the reference values of the parameters."""
        total = self.constant
        for coefficient, pattern in self.terms:
            total = combined(1.0, total, float(coefficient), pattern)
        return total

    def at(self, values: Any) -> Matrix:
        """Return the matrix at values of the parameters, by name; absent ones have their reference values."""
        total = self.constant
        for coefficient, pattern in self.terms:
            total = combined(1.0, total, coefficient.at(values).value, pattern)
        return total

    def __add__(self, other: DependentMatrix) -> DependentMatrix:
        return DependentMatrix(combined(1.0, self.constant, 1.0, other.constant), (*self.terms, *other.terms))

    def times(self, factor: Real) -> DependentMatrix:
        """Return the matrix times a number."""
        if not isinstance(factor, Dependent):
            scaled: Any = float(factor) * self.constant
            return DependentMatrix(scaled, tuple((c, float(factor) * pattern) for c, pattern in self.terms))
        products = tuple((factor * c, pattern) for c, pattern in self.terms)
        return DependentMatrix(0 * self.constant, ((factor, self.constant), *products))

    def congruent(self, T: DependentMatrix) -> DependentMatrix:
        """Return ``T^T A T``, of dense matrices."""
        constant: Any = T.constant.T @ self.constant @ T.constant
        if not (self.terms or T.terms):
            return DependentMatrix(constant)
        bases: list[tuple[Real, Any]] = [(1.0, T.constant), *T.terms]
        patterns: list[tuple[Real, Any]] = [(1.0, self.constant), *self.terms]
        terms = []
        for index, (a, left) in enumerate(bases):
            for b, right in bases[: index + 1]:
                for c, pattern in patterns:
                    coefficient = a * b * c
                    if isinstance(coefficient, Dependent):
                        block = left.T @ pattern @ right
                        terms.append((coefficient, block if left is right else block + block.T))
        return DependentMatrix(constant, tuple(terms))

    def merged(self) -> DependentMatrix:
        """Return the same matrix with one term for all multiples of the same expression."""
        sums: dict[int, tuple[Dependent, Any]] = {}
        terms = like_terms([coefficient for coefficient, _ in self.terms])
        for (factor, core), (_, pattern) in zip(terms, self.terms, strict=True):
            product = factor * pattern
            sums[id(core)] = (core, sums[id(core)][1] + product if id(core) in sums else product)
        nonzero = (term for term in sums.values() if (term[1].nnz if is_sparse(term[1]) else np.any(term[1])))
        return DependentMatrix(self.constant, tuple(nonzero))


def pattern_sum(*parts: tuple[Real, Array]) -> DependentMatrix:
    """Return the sum of numbers times constant matrices (n x n)."""
    total = DependentMatrix(parts[0][1]).times(parts[0][0])
    for factor, pattern in parts[1:]:
        total = total + DependentMatrix(pattern).times(factor)
    return total


def entries(rows: Sequence[Sequence[Real]] | Array, *, symmetric: bool = True) -> DependentMatrix:
    """Return the matrix of given entries (n x n); of a symmetric one the upper triangle is read."""
    constant, terms = np.zeros((len(rows), len(rows))), []
    for (i, j), value in np.ndenumerate(np.array(rows, dtype=object)):
        if not isinstance(value, Dependent):
            constant[i, j] = value
        elif j >= i or not symmetric:
            unit = np.zeros_like(constant)
            unit[i, j] = 1.0
            if symmetric:
                unit[j, i] = 1.0
            terms.append((value, unit))
    return DependentMatrix(constant, tuple(terms))
