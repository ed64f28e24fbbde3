"""Reductions of many structures that differ in numbers alone, side by side in stacks of matrices.

The usual case alone is here: a structure that is held, all of whose DOFs have mass, with separate
frequencies, and masters that are given. Whatever needs more care (rigid-body modes, soft springs, modes
barely visible at the masters) is not `sure`, and is left to the methods of a single structure.

The equations are those of the modules of the methods. Modes are found by one decomposition of the inverse
problem, ``L^-1 M L^-T`` with ``K = L L^T``, and squared frequencies far above the lowest by Rayleigh
quotients; where the methods sum energies in twice the working precision, they differ by the rounding of the
matrices' entries, which `uncertainty` bounds.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.defaults import MASTER_COORDINATES
from dynid.structure.modes.pencil import StrainEnergy
from dynid.structure.reduction.masters import HOPELESS

Sure = NDArray[np.bool_]

_UNIT = float(np.finfo(float).eps) / 2
# Strain energy relative to its terms: below the first the motion may be rigid, below the other its energy is
# summed in twice the working precision.
_FIRM, _SOFT = 1e-12, 1e-6
# From this ratio to the lowest squared frequency on a Rayleigh quotient has fewer errors than the inverse.
_HIGH = 100.0
# Frequencies nearer to each other may have any shapes between them.
_SEPARATE = 1e-6
_RESIDUAL = 1e-11
# Condition beyond which single structures are solved with refinement in twice the working precision.
_WELL = 1e6
# A part of a residual vector outside the modes that is no doubt one.
_OUTSIDE = 1e-9


#: Names of the arrays of a comparison that every method has, as of `structure.comparison`.
NAMES = frozenset({
    "T", "mass", "damping", "stiffness", "mass_without_joints", "damping_without_joints",
    "stiffness_without_joints", "frequencies", "reference", "reference_uncertainty", "frequency_error",
    "frequency_uncertainty", "mac", "orthogonality",
})  # fmt: skip


@dataclass(eq=False)
class Stack:
    """Mass, damping and stiffness of structures (s x n x n), and their modes as far as these are known."""

    M: Array
    C: Array
    K: Array
    _known: StackedModes | None = field(default=None, init=False)

    def modes(self, count: int) -> StackedModes:
        """Return the lowest modes."""
        if self._known is None or self._known.omega.shape[1] < count:
            self._known = lowest_modes(self.M, self.K, count)
        return self._known.numbered(range(1, count + 1))


class StackedModes(NamedTuple):
    """Modes of structures, and which of these are `sure` (s).

    `omega` (s x r), rad/s; `shapes` (s x n x r), of unit modal mass; `uncertainty` (s x r), rad/s, as of
    `Modes`.
    """

    omega: Array
    shapes: Array
    uncertainty: Array
    sure: Sure

    def numbered(self, numbers: Sequence[int]) -> StackedModes:
        """Return some modes, by their numbers from 1."""
        places = np.array(numbers, dtype=np.intp) - 1
        return StackedModes(
            self.omega[:, places], self.shapes[:, :, places], self.uncertainty[:, places], self.sure
        )


@dataclass(frozen=True, eq=False)
class StackedReduction:
    """Reductions of structures by one method.

    Attributes
    ----------
    T
        The bases (s x n x r).
    bare, whole
        The reduced matrices without and with joints (s x r x r).
    numbers
        Numbers of the full modes that the reduced ones stand for.
    sure
        Which structures have the usual case (s).
    condition
        Of the modes at the masters (s), for methods that have one here.
    """

    T: Array
    bare: Stack
    whole: Stack
    numbers: tuple[int, ...]
    sure: Sure
    condition: Array | None = None


def transposed(X: Array) -> Array:
    """Return the transposes of matrices."""
    return X.swapaxes(-1, -2)


def lowest_modes(M: Array, K: Array, count: int) -> StackedModes:
    """Return the lowest modes of structures (s x n x n) that are held."""
    n = M.shape[-1]
    stiffness, mass = (np.einsum("sii->si", matrix) for matrix in (K, M))
    sure = np.all((stiffness > 0) & (mass > 0), axis=1)
    stiffness, mass = (np.where(sure[:, None], part, 1.0) for part in (stiffness, mass))
    bound = (stiffness / mass).min(axis=1, keepdims=True)
    scale = np.exp2(np.round(-0.5 * np.log2(stiffness + bound * mass)))
    sides = scale[:, :, None] * scale[:, None, :]
    K, M = K * sides, M * sides
    L, held = _cholesky(K)
    inverse = np.asarray(np.linalg.inv(L), dtype=float)
    A = inverse @ M @ transposed(inverse)
    values, vectors = np.linalg.eigh((A + transposed(A)) / 2)
    more = min(count + 1, n)  # one more tells whether the last is separate
    values, vectors = values[:, ::-1][:, :more], vectors[:, :, ::-1][:, :, :more]
    sure &= held & np.all(values > 0, axis=1)
    values = np.where(sure[:, None], values, 1.0)
    shapes = transposed(inverse) @ vectors / np.sqrt(values)[:, None, :]
    size = np.abs(shapes)
    Kx, Mx, parts = K @ shapes, M @ shapes, np.abs(K) @ size
    strain, moving = (shapes * Kx).sum(axis=1), (shapes * Mx).sum(axis=1)
    whole, masses = (size * parts).sum(axis=1), (size * (np.abs(M) @ size)).sum(axis=1)
    square = np.where(values[:, :1] > _HIGH * values, strain / moving, 1 / values)
    sure &= np.all(strain > _FIRM * whole, axis=1)
    for s, mode in zip(*np.nonzero((square < _SOFT * whole) & sure[:, None]), strict=True):
        square[s, mode] = StrainEnergy(K[s]).energy(shapes[s, :, mode]) / moving[s, mode]
    square = np.where(sure[:, None], square, 1.0)
    sizes = np.linalg.norm(parts + square[:, None, :] * (np.abs(M) @ size), axis=1)
    residuals = np.linalg.norm(Kx - square[:, None, :] * Mx, axis=1) / np.where(sizes > 0, sizes, 1.0)
    omega = np.sqrt(np.maximum(square, 0.0))
    sure &= np.all((residuals < _RESIDUAL) & (square > 0), axis=1)
    sure &= np.all(np.diff(omega, axis=1) > _SEPARATE * omega[:, 1:], axis=1)
    shapes = scale[:, :, None] * shapes
    # The largest component is positive: the first of those as large but for rounding.
    size = np.abs(shapes)
    largest = (size >= (1 - 1e-6) * size.max(axis=1, keepdims=True)).argmax(axis=1)[:, None, :]
    shapes = shapes * np.where(np.take_along_axis(shapes, largest, axis=1) < 0, -1.0, 1.0)
    moved = _UNIT * whole / omega + _UNIT * np.maximum(masses, 1.0) * omega
    return StackedModes(omega[:, :count], shapes[:, :, :count], moved[:, :count], sure)


def _cholesky(A: Array) -> tuple[Array, Sure]:
    """Return Cholesky factors, unity where there is none, and where there is one."""
    try:
        L = np.asarray(np.linalg.cholesky(A), dtype=float)
        return L, np.ones(len(A), dtype=bool)
    except np.linalg.LinAlgError:
        there = np.linalg.eigvalsh(A)[:, 0] > 0
        L = np.broadcast_to(np.eye(A.shape[-1]), A.shape).copy()
        for s in np.flatnonzero(there):
            try:
                L[s] = np.linalg.cholesky(A[s])
            except np.linalg.LinAlgError:
                there[s] = False
        return L, there


def _congruent(T: Array, matrix: Array) -> Array:
    product = transposed(T) @ matrix @ T
    return np.asarray((product + transposed(product)) / 2)


def _firm(K: Array) -> Sure:
    """Return where a reduced stiffness has no motions whose energy may be rounding (s)."""
    diagonal = np.einsum("sii->si", K)
    size = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return np.asarray(np.linalg.eigvalsh(K / size[:, None] / size[:, :, None])[:, 0] > _FIRM)


def _projected(T: Array, bare: Stack, whole: Stack, numbers: tuple[int, ...], sure: Sure) -> StackedReduction:
    reduced = Stack(*(_congruent(T, part) for part in (bare.M, bare.C, bare.K)))
    if whole is not bare:
        joined = Stack(*(_congruent(T, part) for part in (whole.M, whole.C, whole.K)))
    else:
        joined = reduced
    return StackedReduction(T, reduced, joined, numbers, sure & _firm(joined.K))


def on_modes(
    bare: Stack,
    whole: Stack,
    masters: NDArray[np.intp],
    modes: Sequence[int],
    *,
    joint_aware: bool,
    retained: bool,
) -> StackedReduction:
    """Return SEREP at given masters, on modes without the joints, or joint-aware on those with them."""
    of = whole if joint_aware else bare
    basis = of.modes(max(modes)).numbered(modes)
    seen = basis.shapes[:, masters]
    scale = np.sqrt(np.einsum("sii->si", of.K) / np.einsum("sii->si", of.K).max(axis=1, keepdims=True))
    weighted = basis.shapes * np.where(np.isfinite(scale), scale, 1.0)[:, :, None]
    share = weighted[:, masters] / np.linalg.norm(weighted, axis=1, keepdims=True)
    values = np.linalg.svd(seen, compute_uv=False)
    least = np.linalg.svd(share, compute_uv=False)[:, -1]
    tiny = np.finfo(float).tiny
    condition = values[:, 0] / np.maximum(values[:, -1], tiny)
    # Well within what is seen: the units in which DOFs compare are chosen a little otherwise there.
    sure = basis.sure & (np.maximum(condition, 1 / np.maximum(least, tiny)) < HOPELESS / 1e3)
    seen = np.where(sure[:, None, None], seen, np.eye(len(masters)))
    inverse = np.asarray(np.linalg.inv(seen), dtype=float)
    sure &= _cancellation(seen, inverse, basis.omega**2) < MASTER_COORDINATES.value / 2
    T = basis.shapes @ inverse
    T[:, masters] = np.eye(len(masters))
    energy = transposed(basis.shapes) @ of.M @ basis.shapes * (basis.omega**2)[:, None, :]
    K = transposed(inverse) @ energy @ inverse
    K = (K + transposed(K)) / 2
    sure &= _firm(K)
    reduced = joined = Stack(_congruent(T, bare.M), _congruent(T, bare.C), K)
    if whole is not bare:
        of_joints = _congruent(T, whole.K - bare.K)
        reduced.K = K - of_joints if joint_aware else K
        joined = Stack(_congruent(T, whole.M), _congruent(T, whole.C), reduced.K + of_joints)
    count = T.shape[2]
    numbers = tuple(sorted(modes)) if retained else tuple(range(1, count + 1))
    return StackedReduction(T, reduced, joined, numbers, sure, condition)


def _cancellation(seen: Array, inverse: Array, square: Array) -> Array:
    """Return by which factor terms of modal energies exceed these in the masters' displacements (s)."""
    size = np.abs(seen)
    M = transposed(inverse) @ inverse
    K = (transposed(inverse) * square[:, None, :]) @ inverse
    of_mass = (size * (np.abs(M) @ size)).sum(axis=1).max(axis=1)
    of_strain = ((size * (np.abs(K) @ size)).sum(axis=1) / np.maximum(square, 1e-300)).max(axis=1)
    return np.asarray(np.maximum(of_mass, of_strain))


def on_modal_coordinates(
    bare: Stack, whole: Stack, modes: Sequence[int], loads: NDArray[np.intp]
) -> StackedReduction:
    """Return the reductions on modes with the joints and residual vectors of unit loads at DOFs."""
    basis = whole.modes(max(modes)).numbered(modes)
    sure, T = basis.sure, basis.shapes
    if len(loads):
        X, solved = _solutions(whole.K, np.eye(whole.K.shape[-1])[:, loads])
        X = X / np.sqrt(np.maximum((X * (whole.K @ X)).sum(axis=1, keepdims=True), np.finfo(float).tiny))
        for _ in range(2):
            X = X - basis.shapes @ (transposed(basis.shapes) @ (whole.M @ X))
        energy = transposed(X) @ (whole.K @ X)
        values, vectors = np.linalg.eigh((energy + transposed(energy)) / 2)
        sure = sure & solved & np.all(values > _OUTSIDE, axis=1)
        T = np.concatenate([T, X @ (vectors / np.sqrt(np.maximum(values, _OUTSIDE))[:, None, :])], axis=2)
    made = _projected(T, bare, whole, (), sure)
    count = T.shape[2]
    kept = count == len(modes)
    return replace(made, numbers=tuple(sorted(modes)) if kept else tuple(range(1, count + 1)))


def condensed(
    bare: Stack, whole: Stack, masters: NDArray[np.intp], omega: float = 0.0, fixed: Sequence[int] = ()
) -> StackedReduction:
    """Return static condensation, at `omega` (rad/s) dynamic, or with `fixed` modes of held masters.

    These are the methods of Guyan, Leung, and Craig and Bampton.
    """
    n = whole.K.shape[-1]
    slaves = np.setdiff1d(np.arange(n), masters)
    Z = whole.K - omega**2 * whole.M
    inner = (slice(None), slaves[:, None], slaves)
    motion, sure = _solutions(Z[inner], Z[:, slaves[:, None], masters])
    T = np.zeros((len(Z), n, len(masters) + len(fixed)))
    T[:, masters, np.arange(len(masters))] = 1.0
    T[:, slaves, : len(masters)] = -motion
    if len(fixed):
        found = lowest_modes(whole.M[inner], whole.K[inner], max(fixed)).numbered(fixed)
        shapes = found.shapes / np.abs(found.shapes).max(axis=1, keepdims=True)
        T[:, slaves, len(masters) :], sure = shapes, sure & found.sure
    return _projected(T, bare, whole, tuple(range(1, T.shape[2] + 1)), sure)


def _solutions(A: Array, right: Array) -> tuple[Array, Sure]:
    """Return the solutions with well conditioned symmetric matrices, scaled to unit diagonals, and where."""
    diagonal = np.abs(np.einsum("sii->si", A))
    scale = np.exp2(np.round(-0.5 * np.log2(np.where(diagonal > 0, diagonal, 1.0))))
    scaled = A * scale[:, :, None] * scale[:, None, :]
    lowest = np.abs(np.linalg.eigvalsh(scaled))
    sure = lowest.min(axis=1, initial=1.0) * _WELL > lowest.max(axis=1, initial=1.0)
    scaled = np.where(sure[:, None, None], scaled, np.eye(A.shape[-1]))
    return scale[:, :, None] * np.linalg.solve(scaled, scale[:, :, None] * right), sure


def compared(
    full: StackedModes, whole: Stack, made: StackedReduction, wanted: Collection[str]
) -> tuple[dict[str, Array], Sure]:
    """Return the arrays of a comparison by the names that `structure.comparison` gives them, and where sure.

    Parameters
    ----------
    full
        Modes of the full structures, as many as the numbers of the reduction go.
    whole
        The full structures with joints.
    made
        The reductions.
    wanted
        The names of the arrays that are wanted.
    """
    found = made.whole.modes(made.T.shape[2])
    reference = full.numbered(made.numbers)
    error = found.omega / reference.omega - 1
    out = {
        "T": made.T,
        "mass": made.whole.M,
        "damping": made.whole.C,
        "stiffness": made.whole.K,
        "mass_without_joints": made.bare.M,
        "damping_without_joints": made.bare.C,
        "stiffness_without_joints": made.bare.K,
        "frequencies": found.omega,
        "reference": reference.omega,
        "reference_uncertainty": reference.uncertainty,
        "frequency_error": error,
    }
    if made.condition is not None:
        out["condition"] = made.condition
    if not {"mac", "orthogonality", "frequency_uncertainty"}.isdisjoint(wanted):
        a, b = made.T @ found.shapes, reference.shapes
        size = np.abs(a)
        parts = (size * (np.abs(whole.K) @ size)).sum(axis=1)
        more = _UNIT * parts / found.omega + _UNIT * found.omega
        out["frequency_uncertainty"] = found.uncertainty + more
        lengths = np.linalg.norm(a, axis=1)[:, :, None] * np.linalg.norm(b, axis=1)[:, None, :]
        out["mac"] = np.minimum(np.abs(transposed(a) @ b) / lengths, 1.0) ** 2
        Ma, Mb = whole.M @ a, whole.M @ b
        norms = np.sqrt((a * Ma).sum(axis=1)[:, :, None] * (b * Mb).sum(axis=1)[:, None, :])
        out["orthogonality"] = np.abs(transposed(a) @ Mb) / norms
    return out, made.sure & found.sure & full.sure
