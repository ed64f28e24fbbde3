"""Reductions of many structures that differ in numbers alone, side by side in stacks of matrices.

Every method of `dynid.structure.reduction.methods` has its form for stacks here, with the equations of its
module. A structure is `sure` in the usual case: it is held, all its DOFs have mass, its frequencies are
separate, and rounding cannot change the masters and modes that a method chooses. Whatever needs more care
(rigid-body modes, soft springs, modes barely visible at the masters) is left to the methods of a single
structure.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.defaults import MASTER_COORDINATES
from dynid.structure.correlation import mac, orthogonality
from dynid.structure.model import StructuralModel
from dynid.structure.reduction import stacked_modes
from dynid.structure.reduction.condensation import Dynamic, OnMasters, Partition
from dynid.structure.reduction.irs import MAX_ROUNDING, SETTLED, Irs
from dynid.structure.reduction.masters import HOPELESS, Indices, indices_of, interesting
from dynid.structure.reduction.methods import Reductor
from dynid.structure.reduction.modal import CraigBampton, ModalTruncation
from dynid.structure.reduction.reduced_model import cancellation
from dynid.structure.reduction.serep import JointAware, Serep
from dynid.structure.reduction.stacked_modes import (
    RIGID_STRAIN,
    UNIT_ROUNDING,
    Choice,
    Stack,
    StackedModes,
    Sure,
    congruent,
    diagonal,
    transposed,
)

# Condition beyond which single structures are solved with refinement in twice the working precision.
_MAX_STACK_CONDITION = 1e6
# A residual vector whose part outside the modes is smaller may be spanned by these.
_MIN_OUTSIDE = 1e-9


@dataclass(frozen=True, eq=False)
class StackedReduction:
    """Reductions of structures (s) by one method."""

    T: Array  # bases (s x n x r)
    bare: Stack  # reduced matrices without joints (s x r x r)
    jointed: Stack
    numbers: tuple[int, ...]  # of the full modes that the reduced ones stand for
    sure: Sure  # which structures have the usual case (s)
    condition: Callable[[], Array] | None = None  # of the inverted matrix (s), if there is one


class _StackedMethod(NamedTuple):
    """A reduction method for stacks of structures, each given without and with its joints.

    `choose` returns the choice for each structure, and which choices are sure; `reduce` reduces structures
    that have one choice in common.
    """

    choose: Callable[[Stack, Stack], tuple[list[Choice], Sure]]
    reduce: Callable[[Stack, Stack, Choice], StackedReduction]


def stacked(method: Reductor, model: StructuralModel) -> _StackedMethod:
    """Return the form for stacks of a method; `model` is one of the structures."""
    if isinstance(method, ModalTruncation) or (isinstance(method, JointAware) and method.residuals):
        loads = np.zeros(0, dtype=np.intp)
        if method.residuals == "auto":
            loads = interesting(model, method.interest)
        elif method.residuals:
            loads = indices_of(model, method.residuals, "residuals")
        return _StackedMethod(
            partial(stacked_modes.choose_modes, method), partial(_on_modal_coordinates, loads=loads)
        )
    if isinstance(method, Serep | JointAware):
        joint_aware = isinstance(method, JointAware)
        return _StackedMethod(
            partial(stacked_modes.choose_for_modes, method, model, joint_aware),
            partial(_on_modes, joint_aware=joint_aware, retained=joint_aware or not model.joints),
        )
    if isinstance(method, CraigBampton):
        choose = partial(stacked_modes.choose_for_fixed_interface, method, model)
        return _StackedMethod(choose, _condensed)
    assert isinstance(method, OnMasters)
    reduce: Callable[[Stack, Stack, Choice], StackedReduction] = _condensed
    if isinstance(method, Dynamic):
        reduce = partial(_condensed, omega=method.omega)
    elif isinstance(method, Irs):
        reduce = partial(_improved, iterations=method.iterations)
    return _StackedMethod(partial(stacked_modes.choose_masters, method, model), reduce)


def _projected(
    T: Array,
    bare: Stack,
    jointed: Stack,
    numbers: Sequence[int],
    sure: Sure,
    condition: Callable[[], Array] | None = None,
) -> StackedReduction:
    reduced = bare.projected(T)
    joined = reduced if jointed is bare else jointed.projected(T)
    return StackedReduction(T, reduced, joined, tuple(numbers), sure & _firm(joined.K), condition)


def _on_modes(
    bare: Stack, jointed: Stack, choice: Choice, *, joint_aware: bool, retained: bool
) -> StackedReduction:
    """Return SEREP on modes without the joints, or joint-aware on those with them."""
    masters, modes = np.array(choice.masters), choice.modes
    of = jointed if joint_aware else bare
    basis = of.modes(max(modes)).numbered(modes)
    seen = basis.shapes[:, masters]
    scale = np.sqrt(np.einsum("sii->si", of.K) / np.einsum("sii->si", of.K).max(axis=1, keepdims=True))
    weighted = basis.shapes * np.where(np.isfinite(scale), scale, 1.0)[:, :, None]
    share = weighted[:, masters] / np.linalg.norm(weighted, axis=1, keepdims=True)
    values = np.linalg.svd(seen, compute_uv=False)
    smallest_share = np.linalg.svd(share, compute_uv=False)[:, -1]
    tiny = np.finfo(float).tiny
    condition = values[:, 0] / np.maximum(values[:, -1], tiny)
    # Well within what is seen: the units in which DOFs compare are chosen a little otherwise there.
    sure = basis.sure & (np.maximum(condition, 1 / np.maximum(smallest_share, tiny)) < HOPELESS / 1e3)
    T = basis.shapes
    K = transposed(T) @ of.M @ T * (basis.omega**2)[:, None, :]
    if len(masters) == len(modes):  # coordinates are the masters' displacements, else the modes
        seen = np.where(sure[:, None, None], seen, np.eye(len(masters)))
        inverse, lost = cancellation(seen, basis.omega**2)
        sure &= lost < MASTER_COORDINATES.value / 2
        T = T @ inverse
        T[:, masters] = np.eye(len(masters))
        K = transposed(inverse) @ K @ inverse
    K = (K + transposed(K)) / 2
    sure &= _firm(K)
    M, C = congruent(T, bare.M), congruent(T, bare.C)
    joints_K = 0.0 if jointed is bare else congruent(T, jointed.K - bare.K)
    reduced = Stack(M, C, K - joints_K if joint_aware else K)
    joined = reduced
    if jointed is not bare:
        joined = Stack(congruent(T, jointed.M), congruent(T, jointed.C), reduced.K + joints_K)
    numbers = tuple(sorted(modes)) if retained else tuple(range(1, len(modes) + 1))
    return StackedReduction(T, reduced, joined, numbers, sure, lambda: condition)


def _on_modal_coordinates(bare: Stack, jointed: Stack, choice: Choice, *, loads: Indices) -> StackedReduction:
    """Return the reduction on modes with the joints and residual vectors of unit loads at DOFs."""
    modes = choice.modes
    basis = jointed.modes(max(modes)).numbered(modes)
    if not len(loads):
        return _projected(basis.shapes, bare, jointed, sorted(modes), basis.sure)
    vectors, sure = _residual_vectors(jointed, basis, loads)
    T = np.concatenate([basis.shapes, vectors], axis=2)
    return _projected(T, bare, jointed, range(1, T.shape[2] + 1), sure)


def _residual_vectors(jointed: Stack, basis: StackedModes, loads: Indices) -> tuple[Array, Sure]:
    """Return responses to unit loads beyond the modes, of unit stiffness (s x n x k), and where sure."""
    factor = _Factor(jointed.K)
    X = factor.solve(np.eye(jointed.K.shape[-1])[:, loads])
    X = X / np.sqrt(np.maximum((X * (jointed.K @ X)).sum(axis=1, keepdims=True), np.finfo(float).tiny))
    for _ in range(2):  # twice is enough
        X = X - basis.shapes @ (transposed(basis.shapes) @ (jointed.M @ X))
    energy = transposed(X) @ (jointed.K @ X)
    values, vectors = np.linalg.eigh((energy + transposed(energy)) / 2)
    sure = basis.sure & factor.sure & np.all(values > _MIN_OUTSIDE, axis=1)
    return X @ (vectors / np.sqrt(np.maximum(values, _MIN_OUTSIDE))[:, None, :]), sure


def _condensed(bare: Stack, jointed: Stack, choice: Choice, *, omega: float = 0.0) -> StackedReduction:
    """Return static condensation, at `omega` (rad/s) dynamic, or with modes of held masters."""
    cut = Partition.at(choice.masters, jointed.M.shape[1])
    inner = jointed.block(cut.slaves)
    size = diagonal(inner.K) + omega**2 * diagonal(inner.M)
    factor = _Factor(inner.K - omega**2 * inner.M, size)
    slaves = -factor.solve(cut.coupling(jointed.K) - omega**2 * cut.coupling(jointed.M))
    sure = factor.sure
    if choice.modes:
        fixed = inner.modes(max(choice.modes)).numbered(choice.modes)
        shapes = fixed.shapes / np.abs(fixed.shapes).max(axis=1, keepdims=True)
        slaves, sure = np.concatenate([slaves, shapes], axis=2), sure & fixed.sure
    T = cut.basis(slaves)
    return _projected(T, bare, jointed, range(1, T.shape[2] + 1), sure, factor.condition)


def _improved(bare: Stack, jointed: Stack, choice: Choice, *, iterations: int) -> StackedReduction:
    """Return the improved reduced system, iterated as that of a single structure is."""
    cut = Partition.at(choice.masters, jointed.M.shape[1])
    masters, slaves, inner = cut.masters, cut.slaves, jointed.block(cut.slaves)
    factor = _Factor(inner.K)
    static = -factor.solve(cut.coupling(jointed.K))
    probe = np.random.Generator(np.random.PCG64(1)).standard_normal((len(slaves), 1))
    after = factor.solve(inner.M @ probe)
    energy_before, energy_after = ((x * (inner.M @ x)).sum(axis=(1, 2)) for x in (probe, after))
    slowest = np.sqrt(energy_after / np.where(energy_before > 0, energy_before, 1.0))
    T, growth, sure = cut.basis(static), np.ones(len(static)), factor.sure
    settled = np.zeros(len(static), dtype=bool)
    for _ in range(iterations):
        modes = jointed.projected(T).modes(len(masters))
        last, square, sure = T @ modes.shapes, modes.omega**2, sure & modes.sure
        step = np.empty_like(last)
        step[:, masters] = last[:, masters]
        inertia = factor.solve((jointed.M @ last)[:, slaves]) * square[:, None, :]
        step[:, slaves] = static @ last[:, masters] + inertia
        T = np.where(settled[:, None, None], T, step)
        growth = np.where(settled, growth, growth * np.maximum(1.0, square.max(axis=1) * slowest))
        settled |= np.all(np.abs(T - last).max(axis=1) <= SETTLED * np.abs(last).max(axis=1), axis=1)
        if settled.all():
            break
    modes = jointed.projected(T).modes(len(masters))
    T, sure = T @ modes.shapes, sure & modes.sure & (growth * 2 * UNIT_ROUNDING <= MAX_ROUNDING)
    seen = np.where(sure[:, None, None], T[:, masters], np.eye(len(masters)))
    inverse, lost = cancellation(seen, modes.omega**2)
    sure &= lost < MASTER_COORDINATES.value / 2
    T = cut.basis(T[:, slaves] @ inverse)
    return _projected(T, bare, jointed, range(1, len(masters) + 1), sure, factor.condition)


class _Factor:
    """Solver with symmetric matrices scaled to unit diagonals or by `size`, and which are `sure` (s)."""

    def __init__(self, A: Array, size: Array | None = None) -> None:
        size = diagonal(A) if size is None else size
        self._scale = np.exp2(np.round(-0.5 * np.log2(np.where(size > 0, size, 1.0))))
        self._scaled = A * self._scale[:, :, None] * self._scale[:, None, :]
        values = np.abs(np.linalg.eigvalsh(self._scaled))
        self.sure = np.asarray(
            values.min(axis=1, initial=1.0) * _MAX_STACK_CONDITION > values.max(axis=1, initial=1.0)
        )
        self._matrix = np.where(self.sure[:, None, None], self._scaled, np.eye(A.shape[-1]))

    def solve(self, right: Array) -> Array:
        """Solve for right-hand sides (n x c, or s x n x c)."""
        scale = self._scale[:, :, None]
        return np.asarray(scale * np.linalg.solve(self._matrix, scale * right))

    def condition(self) -> Array:
        """Return the conditions in the 1-norm, estimated as those of single structures (s)."""
        from scipy.linalg import lapack

        conditions = np.ones(len(self._scaled))
        for s in np.flatnonzero(self.sure) if self._scaled.shape[-1] else ():
            size = np.abs(self._scaled[s]).sum(axis=0).max()
            factor, _, _ = lapack.dgetrf(self._scaled[s])
            conditions[s] = 1 / (lapack.dgecon(factor, size)[0] * min(size, 1.0))
        return conditions


def _firm(K: Array) -> Sure:
    """Return where a reduced stiffness has no motions whose energy may be rounding (s)."""
    entries = np.einsum("sii->si", K)
    size = np.sqrt(np.where(entries > 0, entries, 1.0))
    return np.asarray(np.linalg.eigvalsh(K / size[:, None] / size[:, :, None])[:, 0] > RIGID_STRAIN)


class StackedEnergies(NamedTuple):
    """Stiffness whose strain energies are compared: of the bare structures, and of each joint (s x n x n).

    `parts` are the DOFs of each substructure.
    """

    bare: Array
    parts: Sequence[Indices]
    joints: Sequence[Array]

    def shares(self, shapes: Array, omega: Array) -> Array:
        """Return the shares of substructures and joints in the energy of each mode (s x r x parts)."""
        by_dof = shapes * (self.bare @ shapes)
        energies = [by_dof[:, dofs].sum(axis=1) for dofs in self.parts]
        energies += [(shapes * (K @ shapes)).sum(axis=1) for K in self.joints]
        return np.asarray(np.stack(energies, axis=2) / (omega**2)[:, :, None])


def compared(
    jointed: Stack,
    reduction: StackedReduction,
    names: Collection[str],
    energies: Callable[[], StackedEnergies],
) -> tuple[dict[str, Array], Sure]:
    """Return the arrays of a comparison by their names in `structure.reduction_comparison`, and where sure.

    `jointed`: the full structures with joints; `names`: the requested arrays; `energies`: returns what their
    `energy_error` needs.
    """
    modes = reduction.jointed.modes(reduction.T.shape[2])
    reference = jointed.modes(max(reduction.numbers)).numbered(reduction.numbers)
    arrays = {
        "T": reduction.T,
        "mass": reduction.jointed.M,
        "damping": reduction.jointed.C,
        "stiffness": reduction.jointed.K,
        "mass_without_joints": reduction.bare.M,
        "damping_without_joints": reduction.bare.C,
        "stiffness_without_joints": reduction.bare.K,
        "frequencies": modes.omega,
        "reference": reference.omega,
        "reference_uncertainty": reference.uncertainty,
        "frequency_error": modes.omega / reference.omega - 1,
    }
    if "condition" in names and reduction.condition is not None:
        arrays["condition"] = reduction.condition()
    if not {"mac", "orthogonality", "frequency_uncertainty", "energy_error"}.isdisjoint(names):
        a, b = reduction.T @ modes.shapes, reference.shapes
        size = np.abs(a)
        terms = (size * (np.abs(jointed.K) @ size)).sum(axis=1)
        arrays["frequency_uncertainty"] = modes.uncertainty + UNIT_ROUNDING * (
            terms / modes.omega + modes.omega
        )
        arrays |= {"mac": mac(a, b), "orthogonality": orthogonality(a, jointed.M, b)}
        if "energy_error" in names:
            shares = energies()
            arrays["energy_error"] = shares.shares(a, modes.omega) - shares.shares(b, reference.omega)
    requested = {name: array for name, array in arrays.items() if name in names}
    return requested, reduction.sure & modes.sure & reference.sure
