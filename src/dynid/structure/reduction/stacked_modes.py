"""Modes of many structures that differ in numbers alone, side by side, and the choices made from them.

Modes are found by one decomposition of the inverse problem, ``L^-1 M L^-T`` with ``K = L L^T``, and squared
frequencies far above the lowest by Rayleigh quotients. A mode is `certain` in the usual case: its structure
has mass at all DOFs, it is elastic and separate from others. Where `dynid.structure.modes` sums energies in
twice the working precision, numbers differ by the rounding of the matrices' entries, which `uncertainty`
bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure.model import StructuralModel
from dynid.structure.modes.pencil import StrainEnergy
from dynid.structure.reduction.condensation import OnMasters
from dynid.structure.reduction.masters import (
    Indices,
    Masters,
    completed,
    indices_of,
    interesting,
    masters_alone,
    masters_for_modes,
    mode_count,
    modes_to_see,
)
from dynid.structure.reduction.modal import CraigBampton, ModalTruncation
from dynid.structure.reduction.mode_selection import ModeRange, wanted_modes
from dynid.structure.reduction.serep import JointAware, Serep

Sure = NDArray[np.bool_]

UNIT_ROUNDING = float(np.finfo(float).eps) / 2
RIGID_STRAIN = 1e-12
"""Strain energy relative to its terms below which a motion may be rigid."""

# Strain energy relative to its terms below which it is summed in twice the working precision.
_SOFT_STRAIN = 1e-6
# From this ratio to the lowest squared frequency on a Rayleigh quotient has fewer errors than the inverse.
_RAYLEIGH_RATIO = 100.0
# Frequencies nearer to each other, relative to the higher one, may have any shapes between them.
_MIN_SEPARATION = 1e-6
_MAX_RESIDUAL = 1e-11
# A pivot of the scaled stiffness below which a structure may be free; it is then shifted by this part of the
# bound on its squared frequencies.
_MIN_PIVOT, _SHIFT = 1e-8, 1e-2


class StackedModes(NamedTuple):
    """Modes of structures.

    `omega` (s x r), rad/s; `shapes` (s x n x r), of unit modal mass; `uncertainty` (s x r), rad/s, as of
    `Modes`; `certain` (s x r), which are elastic and separate from others.
    """

    omega: Array
    shapes: Array
    uncertainty: Array
    certain: Sure

    @property
    def sure(self) -> Sure:
        """The structures all of whose modes here are certain (s)."""
        return np.asarray(self.certain.all(axis=1))

    def numbered(self, numbers: Sequence[int]) -> StackedModes:
        """Return some modes, by their numbers from 1."""
        arrays: tuple[Any, ...] = self
        columns = np.array(numbers, dtype=np.intp) - 1
        return StackedModes(*(array[..., columns] for array in arrays))


class Stack:
    """Mass, damping and stiffness of structures (s x n x n), whose modes are found once."""

    def __init__(self, M: Array, C: Array, K: Array) -> None:
        self.M, self.C, self.K = M, C, K
        self._lowest: StackedModes | None = None
        self._blocks: dict[tuple[int, ...], Stack] = {}

    def __getitem__(self, samples: NDArray[np.intp]) -> Stack:
        """Return some of the structures."""
        return Stack(self.M[samples], self.C[samples], self.K[samples])

    def block(self, dofs: NDArray[np.intp]) -> Stack:
        """Return the structures whose DOFs other than these are held."""
        key = tuple(dofs.tolist())
        if key not in self._blocks:
            rows = (slice(None), dofs[:, None], dofs)
            self._blocks[key] = Stack(self.M[rows], self.C[rows], self.K[rows])
        return self._blocks[key]

    def projected(self, T: Array) -> Stack:
        """Return the structures in coordinates q with ``x = T q``."""
        return Stack(*(congruent(T, matrix) for matrix in (self.M, self.C, self.K)))

    def modes(self, count: int) -> StackedModes:
        """Return the lowest modes."""
        if self._lowest is None or self._lowest.omega.shape[1] < count:
            self._lowest = self._refined(count)
        return self._lowest.numbered(range(1, count + 1))

    @property
    def frequencies(self) -> Array:
        """All natural frequencies to a few digits, rad/s, ascending (s x n); infinite where none is found."""
        inverse = self._inverse_modes
        positive = inverse.values > 0
        square = 1 / np.where(positive, inverse.values, 1.0) - inverse.shift[:, None]
        return np.asarray(np.sqrt(np.where(positive, np.maximum(square, 0.0), np.inf)))

    @cached_property
    def _inverse_modes(self) -> _InverseModes:
        stiffness, mass = diagonal(self.K), diagonal(self.M)
        sure = np.all((stiffness > 0) & (mass > 0), axis=1)
        stiffness, mass = (np.where(sure[:, None], entries, 1.0) for entries in (stiffness, mass))
        bound = (stiffness / mass).min(axis=1, keepdims=True)
        scale = np.exp2(np.round(-0.5 * np.log2(stiffness + bound * mass)))
        sides = scale[:, :, None] * scale[:, None, :]
        K, M = self.K * sides, self.M * sides
        shift = np.zeros(len(K))
        L, held = _cholesky(K)
        free = ~held | ((diagonal(L) ** 2).min(axis=1, initial=1.0) < _MIN_PIVOT)
        if free.any():  # rigid-body modes, or nearly: their inertia holds them
            shift[free] = _SHIFT * bound[free, 0]
            L[free], held[free] = _cholesky(K[free] + shift[free, None, None] * M[free])
        inverse = np.asarray(np.linalg.inv(L), dtype=float)
        A = inverse @ M @ transposed(inverse)
        values, vectors = np.linalg.eigh((A + transposed(A)) / 2)
        return _InverseModes(K, M, scale, shift, inverse, values[:, ::-1], vectors[:, :, ::-1], sure & held)

    def _refined(self, count: int) -> StackedModes:
        """Return modes with their squared frequencies to all digits, and normed shapes."""
        K, M, scale, shift, inverse, values, vectors, sure = self._inverse_modes
        kept = min(count + 1, K.shape[-1])  # one more tells whether the last is separate
        values, vectors = values[:, :kept], vectors[:, :, :kept]
        certain = sure[:, None] & (values > 0)
        values = np.where(certain, values, 1.0)
        shapes = transposed(inverse) @ vectors / np.sqrt(values)[:, None, :]
        size = np.abs(shapes)
        Kx, Mx, strain_terms = K @ shapes, M @ shapes, np.abs(K) @ size
        strain, inertia = (shapes * Kx).sum(axis=1), (shapes * Mx).sum(axis=1)
        sum_of_terms, mass_terms = ((size * terms).sum(axis=1) for terms in (strain_terms, np.abs(M) @ size))
        by_energy = (values[:, :1] > _RAYLEIGH_RATIO * values) | (shift > 0)[:, None]
        square = np.where(by_energy, strain / inertia, 1 / values)
        certain &= strain > RIGID_STRAIN * sum_of_terms
        for s, mode in zip(*np.nonzero((square < _SOFT_STRAIN * sum_of_terms) & certain), strict=True):
            square[s, mode] = StrainEnergy(K[s]).energy(shapes[s, :, mode]) / inertia[s, mode]
        sizes = np.linalg.norm(strain_terms + np.abs(square)[:, None, :] * (np.abs(M) @ size), axis=1)
        residuals = np.linalg.norm(Kx - square[:, None, :] * Mx, axis=1) / np.where(sizes > 0, sizes, 1.0)
        certain &= (residuals < _MAX_RESIDUAL) & (square > 0)
        omega = np.sqrt(np.maximum(square, 0.0))
        separate = np.diff(omega, axis=1) > _MIN_SEPARATION * omega[:, 1:]
        certain[:, 1:] &= separate
        certain[:, :-1] &= separate
        omega = np.where(certain, omega, 1.0)
        shapes = scale[:, :, None] * shapes
        # The largest component is positive: the first of those as large but for rounding.
        size = np.abs(shapes)
        largest = (size >= (1 - 1e-6) * size.max(axis=1, keepdims=True)).argmax(axis=1)[:, None, :]
        shapes = shapes * np.where(np.take_along_axis(shapes, largest, axis=1) < 0, -1.0, 1.0)
        uncertainty = UNIT_ROUNDING * (sum_of_terms / omega + np.maximum(mass_terms, 1.0) * omega)
        return StackedModes(
            omega[:, :count], shapes[:, :, :count], uncertainty[:, :count], certain[:, :count]
        )


class _InverseModes(NamedTuple):
    """Scaled K and M, the scales, shifts of K by M, inverse Cholesky factors, eigenpairs of ``L^-1 M L^-T``.

    The largest eigenvalues are first.
    """

    K: Array
    M: Array
    scale: Array
    shift: Array
    inverse: Array
    values: Array
    vectors: Array
    sure: Sure


def diagonal(A: Array) -> Array:
    """Return the sizes of diagonal entries."""
    return np.asarray(np.abs(np.einsum("sii->si", A)))


def transposed(X: Array) -> Array:
    """Return the transposes of matrices."""
    return X.swapaxes(-1, -2)


def _cholesky(A: Array) -> tuple[Array, Sure]:
    """Return Cholesky factors, unity where there is none, and where there is one."""
    try:
        L = np.asarray(np.linalg.cholesky(A), dtype=float)
        return L, np.ones(len(A), dtype=bool)
    except np.linalg.LinAlgError:
        definite = np.linalg.eigvalsh(A)[:, 0] > 0
        L = np.broadcast_to(np.eye(A.shape[-1]), A.shape).copy()
        for s in np.flatnonzero(definite):
            try:
                L[s] = np.linalg.cholesky(A[s])
            except np.linalg.LinAlgError:
                definite[s] = False
        return L, definite


def congruent(T: Array, matrix: Array) -> Array:
    """Return ``T^T matrix T``, symmetric."""
    product = transposed(T) @ matrix @ T
    return np.asarray((product + transposed(product)) / 2)


# Relative change of shapes and frequencies that must not change a choice: far above the rounding of either.
_CHOICE_MARGIN = 1e-8


class Choice(NamedTuple):
    """The masters, by index, and the numbers of the modes that a reduction of one structure is made of."""

    masters: tuple[int, ...]
    modes: tuple[int, ...]


def _numbers_of(requested: Sequence[int] | ModeRange, stack: Stack) -> tuple[list[tuple[int, ...]], Sure]:
    """Return for each structure the numbers of the modes to keep, and which are sure."""
    count = len(stack.M)
    sure = np.ones(count, dtype=bool)
    if not isinstance(requested, ModeRange):
        return [tuple(requested)] * count, sure
    if requested.count is not None:
        return [tuple(range(1, requested.count + 1))] * count, sure
    assert requested.below is not None
    omega = stack.frequencies
    sure = np.all(np.abs(omega - requested.below) > _CHOICE_MARGIN * requested.below, axis=1)
    return [tuple(range(1, number + 1)) for number in np.sum(omega < requested.below, axis=1).tolist()], sure


def _pick(
    pick: Callable[[Array, Array], Indices],
    stack: Stack,
    mass: Array,
    numbers: Sequence[tuple[int, ...]],
    sure: Sure,
) -> tuple[list[Choice], Sure]:
    """Return the masters that a rule picks for these modes, and where a small change picks the same."""
    modes = stack.modes(max(map(max, filter(None, numbers)), default=1))
    sure = sure & modes.sure
    random = np.random.Generator(np.random.PCG64(0))
    noise = 1 + _CHOICE_MARGIN * random.standard_normal(modes.shapes.shape[1:])
    choices = []
    for s, kept in enumerate(numbers):
        columns = np.array(kept, dtype=np.intp) - 1
        masters: Sequence[int] = ()
        sure[s] &= len(kept) > 0
        if sure[s]:
            try:
                masters = pick(modes.shapes[s][:, columns], mass[s]).tolist()
                changed = pick((noise * modes.shapes[s])[:, columns], noise[:, 0] * mass[s])
                sure[s] = masters == changed.tolist()
            except UsageError:
                sure[s] = False
        choices.append(Choice(tuple(masters), kept))
    return choices, sure


def choose_for_modes(
    method: Serep | JointAware, model: StructuralModel, joint_aware: bool, bare: Stack, jointed: Stack
) -> tuple[list[Choice], Sure]:
    """Return the choices of SEREP and of the joint-aware method."""
    masters, interest = method.masters, method.interest
    count, ends = mode_count(model, masters, interest), interesting(model, interest)
    of = jointed if joint_aware else bare
    numbers, sure = _numbers_of(wanted_modes(method.modes, interest, count), of)
    if masters is not None and not isinstance(masters, Masters):
        fixed = tuple(indices_of(model, masters).tolist())
        return [Choice(fixed, kept) for kept in numbers], sure & np.array([len(kept) > 0 for kept in numbers])

    def pick(shapes: Array, mass: Array) -> Indices:
        if masters is None:
            return completed(ends, shapes)
        return masters_for_modes(model, masters, interest, shapes, mass)

    return _pick(pick, of, diagonal(bare.M), numbers, sure)


def choose_masters(
    method: OnMasters, model: StructuralModel, bare: Stack, jointed: Stack
) -> tuple[list[Choice], Sure]:
    """Return the masters of a method that is not made of modes, as `masters_alone` does."""
    given, interest, count = method.masters, method.interest, len(bare.M)
    if not isinstance(given, Masters):
        masters = masters_alone(model, given, interest)
        return [Choice(tuple(masters.tolist()), ())] * count, np.ones(count, dtype=bool)
    choices, sure = _pick(
        partial(masters_for_modes, model, given, interest),
        jointed,
        diagonal(bare.M),
        *_numbers_of(modes_to_see(given, interest, model.size), jointed),
    )
    return [Choice(choice.masters, ()) for choice in choices], sure


def choose_for_fixed_interface(
    method: CraigBampton, model: StructuralModel, bare: Stack, jointed: Stack
) -> tuple[list[Choice], Sure]:
    """Return the boundary and the fixed-interface modes of a component mode synthesis."""
    choices, sure = choose_masters(method, model, bare, jointed)
    requested = wanted_modes(method.modes, method.interest, None)
    complete = list(choices)
    for masters in {choice.masters for choice in choices}:
        slaves = np.setdiff1d(np.arange(model.size), masters)
        numbers, certain = _numbers_of(requested, jointed.block(slaves))
        # Modes that are asked for below a frequency must exist; those of the band may be none.
        exist = np.array([len(kept) > 0 or requested == ModeRange(count=0) for kept in numbers])
        certain &= exist | (method.modes is None)
        for s, choice in enumerate(choices):
            if choice.masters == masters:
                complete[s], sure[s] = Choice(masters, numbers[s]), sure[s] and certain[s]
    return complete, sure


def choose_modes(method: ModalTruncation | JointAware, _: Stack, jointed: Stack) -> tuple[list[Choice], Sure]:
    """Return the modes of a method without masters."""
    numbers, sure = _numbers_of(wanted_modes(method.modes, method.interest, None), jointed)
    return [Choice((), kept) for kept in numbers], sure & np.array([len(kept) > 0 for kept in numbers])
