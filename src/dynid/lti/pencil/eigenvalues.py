"""Finite eigenvalues of a regular pencil sF - G in floating point, each with an error bound.

The pencil is split into its irreducible diagonal blocks, each block scaled so that units do not matter, its
infinite eigenvalues deflated by orthogonal transformations, and the others found by QR or QZ. Each is refined
on the given block by two-sided inverse iteration, which also yields its condition. An error is raised where
an error bound is not small.

References
----------
A. Emami-Naeini, P. Van Dooren, "Computation of zeros of linear multivariable systems", Automatica 18 (1982)
415-430. D. J. Higham, N. J. Higham, "Structured backward error and condition of generalized eigenvalue
problems", SIAM Journal on Matrix Analysis and Applications 20 (1998) 493-512.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import ComplexArray
from dynid.defaults import SPARSE_REFINEMENT
from dynid.errors import Singular, Undecided

Real = NDArray[np.float64]
Indices = NDArray[np.intp]
EPSILON = float(np.finfo(float).eps)
#: Sweeps that scale rows and columns; steps of inverse iteration.
_SCALING_SWEEPS, _MAX_RAYLEIGH_STEPS = 12, 3
#: Singular values below the first are rounding, above the second they are not.
_ZERO_SINGULAR_RTOL, _NONZERO_SINGULAR_RTOL = 1e-12, 1e-7
#: Largest relative error bound of an eigenvalue; eigenvalues below this share of the others may be 0.
TOLERANCE, _NEAR_ZERO_RTOL = 1e-8, 1e-8
#: Roundings allowed for a residual.
_RESIDUAL_ROUNDINGS = 8
EXACT = 'The exact engine (engine="exact") decides.'


@dataclass(frozen=True)
class FiniteEigenvalues:
    """Finite eigenvalues of a pencil by modulus, with first-order error bounds; how many are infinite."""

    values: ComplexArray
    bounds: Real
    infinite: int


def finite_eigenvalues(
    F: Any, G: Any, count: int | None = None, *, origin: int | None = None, sparse: bool | None = None
) -> FiniteEigenvalues:
    """Return the finite eigenvalues of the real square pencil sF - G, with error bounds.

    `count` and `origin` are their number and that of those at 0, where known exactly. `sparse`: refine by
    sparse factors; default: in blocks that are large and sparse. `Singular` where det(sF - G) vanishes by the
    positions of its entries; `Undecided` where rounding hides a rank, the count differs, or an error bound
    exceeds `TOLERANCE`.
    """
    from scipy.sparse import csr_array

    F, G = csr_array(F, dtype=float), csr_array(G, dtype=float)
    blocks = diagonal_blocks(abs(F) + abs(G))
    if blocks is None:
        raise Singular("the pencil's determinant is identically zero", remedy="Check the equations.")
    parts: list[tuple[ComplexArray, Real]] = [(np.zeros(0, complex), np.zeros(0))]
    if single := [block for block in blocks if len(block[0]) == 1]:
        at = tuple(np.concatenate(component) for component in zip(*single, strict=True))
        f, g = np.ravel(F[at]), np.ravel(G[at])
        with np.errstate(over="ignore", under="ignore"):
            quotients = g[f != 0] / f[f != 0]
        parts = [(quotients.astype(complex), EPSILON * np.abs(quotients))]
    dynamic = np.diff(F.indptr) > 0
    for rows, columns in (block for block in blocks if len(block[0]) > 1 and dynamic[block[0]].any()):
        block = F[rows][:, columns], G[rows][:, columns]
        parts.append(_block_eigenvalues(*block, regular=count is not None, sparse=sparse))
    value, bound = (np.concatenate(component) for component in zip(*parts, strict=True))
    if count is not None and len(value) != count:
        raise Undecided(
            f"rounding leaves {len(value)} finite eigenvalues where there are {count}", remedy=EXACT
        )
    order = np.lexsort((value.imag, value.real, np.abs(value)))
    value, bound = value[order], bound[order]
    settle_origin(value, bound, origin)
    floor = _NEAR_ZERO_RTOL * float(np.median(np.abs(value))) if len(value) else 0.0
    if len(poor := np.flatnonzero(~(bound <= TOLERANCE * np.maximum(np.abs(value), floor)))):
        z, error = value[poor[0]], bound[poor[0]]
        raise Undecided(f"the error of the eigenvalue near {z:.4g} may be {error:.1g}", remedy=EXACT)
    return FiniteEigenvalues(value, bound, F.shape[0] - len(value))


def diagonal_blocks(pattern: Any) -> list[tuple[Indices, Indices]] | None:
    """Return rows and columns of the irreducible diagonal blocks; None for a structurally singular pattern.

    The determinant of a pencil is the product of those of the blocks.

    References
    ----------
    A. Pothen, C.-J. Fan, "Computing the block triangular form of a sparse matrix", ACM Transactions on
    Mathematical Software 16 (1990) 303-324.
    """
    from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

    rows = pattern.tocsr()
    partner = maximum_bipartite_matching(rows, perm_type="column")
    if (partner < 0).any():
        return None
    count, label = connected_components(rows[:, partner], connection="strong")
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(count + 1))
    return [(order[a:b], np.sort(partner[order[a:b]])) for a, b in pairwise(starts)]


def settle_origin(value: ComplexArray, bound: Real, origin: int | None) -> None:
    """Set the smallest eigenvalues to 0, as many as are known to be."""
    if origin is None:
        return
    if not (np.abs(value[origin:]) > bound[origin:]).all() or np.max(
        np.abs(value[:origin]), initial=0.0
    ) > _NEAR_ZERO_RTOL * np.min(np.abs(value[origin:]), initial=np.inf):
        raise Undecided(f"rounding hides which {origin} eigenvalues are 0", remedy=EXACT)
    value[:origin] = 0
    bound[:origin] = 0


def _block_eigenvalues(F: Any, G: Any, *, regular: bool, sparse: bool | None) -> tuple[ComplexArray, Real]:
    """Return eigenvalues and error bounds of one irreducible block; `regular`: their total is known."""
    from scipy.linalg import eigvals

    if F.count_nonzero() == 0:
        return np.zeros(0, complex), np.zeros(0)
    F, G, unit = scaled(F, G)
    small_F, small_G = _deflated(*_without_algebraic(F, G), regular=regular)
    if not small_F.size:
        starts = np.zeros(0, complex)
    elif np.linalg.cond(small_F) < 1e3:
        starts = np.asarray(np.linalg.eigvals(np.linalg.solve(small_F, small_G)), dtype=complex)
    else:
        with np.errstate(all="ignore"):
            starts = np.asarray(eigvals(small_G, small_F), dtype=complex)
    if sparse is None:
        sparse = F.shape[0] >= SPARSE_REFINEMENT.value and F.nnz + G.nnz <= F.shape[0] ** 2 / 10
    if not sparse:
        F, G = F.toarray(), G.toarray()
    values, bounds = _refined(F, G, starts)
    return values * unit, bounds * unit


def scaled(F: Any, G: Any) -> tuple[Any, Any, float]:
    """Scale rows, columns and s by powers of two until all are near 1; return the unit of s too."""
    F, G, unit = F.tocsr(copy=True), G.tocsr(copy=True), 1.0
    places = [(M, (M.indices, np.repeat(np.arange(M.shape[0]), np.diff(M.indptr)))) for M in (F, G)]
    for _ in range(_SCALING_SWEEPS):
        size = [float(np.exp2(np.mean(np.log2(abs(M.data[M.data != 0]))))) if M.nnz else 1.0 for M in (F, G)]
        step = float(np.exp2(np.round(np.log2(size[1] / size[0]))))
        F.data *= step
        unit *= step
        rest = step == 1
        for side, power in ((0, 0.5), (1, 1.0)):  # columns, rows
            squares = sum(np.bincount(at[side], M.data**2, F.shape[1 - side]) for M, at in places)
            norm = np.sqrt(np.where(squares == 0, 1.0, squares))
            factor = np.exp2(-np.round(np.log2(norm) * power))
            for M, at in places:
                M.data *= factor[at[side]]
            rest &= bool((factor == 1).all())
        if rest:
            break
    return F, G, unit


def _without_algebraic(F: Any, G: Any) -> tuple[Real, Real]:
    """Eliminate the unknowns free of s by the equations free of s, where that is well conditioned."""
    rows, columns = np.diff(F.indptr) == 0, np.diff(F.tocsc().indptr) == 0
    if rows.sum() == columns.sum() > 0:
        algebraic = G[rows][:, columns].toarray()
        with np.errstate(all="ignore"):
            condition = np.linalg.cond(algebraic)
        if condition < 1 / _NONZERO_SINGULAR_RTOL:
            solved = np.linalg.solve(algebraic, G[rows][:, ~columns].toarray())
            reduced = G[~rows][:, ~columns].toarray() - G[~rows][:, columns] @ solved
            return F[~rows][:, ~columns].toarray(), reduced
    return F.toarray(), G.toarray()


def _deflated(F: Real, G: Real, *, regular: bool) -> tuple[Real, Real]:
    """Deflate the infinite eigenvalues, step by step: rows free of s fix as many unknowns."""
    from scipy.linalg import qr

    scale = float(np.linalg.norm(F, 2)) if F.size else 1.0
    while F.size:
        U, sizes, _ = np.linalg.svd(F)
        sizes = sizes / scale
        unclear = (sizes > _ZERO_SINGULAR_RTOL) & (sizes < _NONZERO_SINGULAR_RTOL)
        if not unclear.any():
            rank = int((sizes >= _NONZERO_SINGULAR_RTOL).sum())
        elif regular:  # the widest gap, a guess that the known total checks
            ladder = np.concatenate([[1.0], np.maximum(sizes, EPSILON**2), [EPSILON]])
            rank = int(np.argmax(np.where(ladder[1:] < _NONZERO_SINGULAR_RTOL, ladder[:-1] / ladder[1:], 0)))
        else:
            raise Undecided("a rank is undecided within rounding", remedy=EXACT)
        if rank == len(F):
            break
        Q, _ = qr((U.T @ G)[rank:].T)
        free = Q[:, len(F) - rank :]
        F, G = (U.T @ F)[:rank] @ free, (U.T @ G)[:rank] @ free
    return F, G


def _refined(F: Any, G: Any, starts: ComplexArray) -> tuple[ComplexArray, Real]:
    """Refine eigenvalues on the pencil itself and bound their errors; conjugates share the work."""
    if not np.isfinite(starts).all():
        raise Undecided("rounding hides whether an eigenvalue is infinite", remedy=EXACT)
    upper = starts[starts.imag >= 0]
    values, bounds = np.empty_like(upper), np.empty(len(upper))
    for k, start in enumerate(upper):
        others = np.abs(starts - start)
        room = float(np.min(others[others > 0], initial=np.inf))
        values[k], bounds[k] = _rayleigh_quotient_iteration(F, G, complex(start), room)
    # Two starts that converged to one eigenvalue: another may be missing.
    both = bounds[:, None] + bounds[None, :]
    merged = (np.abs(values[:, None] - values) <= both) & (np.abs(upper[:, None] - upper) > 4 * both)
    if merged.any():
        z = values[np.argwhere(merged)[0][0]]
        raise Undecided(f"rounding hides whether two eigenvalues near {z:.4g} are one", remedy=EXACT)
    mirrored = upper.imag > 0
    return np.concatenate([values, values[mirrored].conj()]), np.concatenate([bounds, bounds[mirrored]])


def _rayleigh_quotient_iteration(F: Any, G: Any, z: complex, room: float) -> tuple[complex, float]:
    """Return an eigenvalue after Rayleigh quotient steps, and its error bound."""
    generator = np.random.default_rng(0)
    u, v = generator.standard_normal((2, F.shape[0])) + 0j
    step = np.inf
    for _ in range(_MAX_RAYLEIGH_STEPS):
        # One inverse iteration for both vectors; beside z where the pencil is exactly singular there.
        shifts = [4**k * EPSILON * abs(z) for k in range(1, 8)]
        for nudge in (0.0, *shifts, EPSILON):
            left, right = _solved((z + nudge) * F - G, u, v)
            if np.isfinite(left).all() and np.isfinite(right).all():
                break
        else:
            raise Undecided(f"the residual at {z:.4g} cannot be computed", remedy=EXACT)
        u, v = left / np.linalg.norm(left), right / np.linalg.norm(right)
        slope = u.conj() @ (F @ v)
        if slope == 0:
            return z, np.inf
        step = (u.conj() @ (z * (F @ v) - G @ v)) / slope
        if abs(step) > room / 4:
            break
        z = complex(z.real - step.real) if z.imag == 0 else complex(z - step)
        if abs(step) <= 4 * EPSILON * abs(z):
            break
    rounding = np.abs(u) @ (abs(z) * (abs(F) @ np.abs(v)) + abs(G) @ np.abs(v))
    return z, float(_RESIDUAL_ROUNDINGS * EPSILON * rounding / abs(slope) + abs(step))


def _solved(P: Any, u: ComplexArray, v: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return P^-H u and P^-1 v; not finite where P is singular to the last bit."""
    if isinstance(P, np.ndarray):
        from scipy.linalg.lapack import zgetrf, zgetrs

        lu, pivots, info = zgetrf(P)
        if info:
            return np.full_like(u, np.nan), np.full_like(v, np.nan)
        return zgetrs(lu, pivots, u, trans=2)[0], zgetrs(lu, pivots, v)[0]
    from scipy.sparse.linalg import splu

    try:
        factor: Any = splu(P.tocsc().astype(complex))
    except RuntimeError:
        return np.full_like(u, np.nan), np.full_like(v, np.nan)
    return factor.solve(u, trans="H"), factor.solve(v)
