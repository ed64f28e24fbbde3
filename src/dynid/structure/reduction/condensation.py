"""Static and dynamic condensation: the slaves follow the masters without inertia, or as at one frequency.

Sources: R. J. Guyan, AIAA J. 3 (1965) 380; B. Irons, AIAA J. 3 (1965) 961–962 (static); A. Y. T. Leung,
*Int. J. Numer. Methods Eng.* 12 (1978) 1705–1715 (dynamic).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array, guarded, norm_of_inverse
from dynid.errors import Singular, UsageError
from dynid.number_format import frequency_text
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix, combined, is_sparse
from dynid.structure.model import StructuralModel
from dynid.structure.modes.modes import ScaledFactors
from dynid.structure.modes.pencil import StrainEnergy
from dynid.structure.reduction.masters import Indices, Masters, masters_alone
from dynid.structure.reduction.mode_selection import Interest
from dynid.structure.reduction.reduced_model import StructuralReduction, projected

SLAVES = "the slaves' stiffness"
"""Name of the matrix that static methods invert."""
FREE = "the slaves move freely while the masters are held: they do not follow statically"
REMEDY = "Make a DOF of the part that moves a master; unknown joints do not hold it here."


# Condition of the scaled matrix beyond which fewer than two digits of a solution are left.
_WORST = 1e14
# Condition beyond which solutions are refined with residuals in twice the working precision.
_DOUBLED = 1e6
_REFINEMENTS = 5


class Partition(NamedTuple):
    """A cut of `size` DOFs (n) into masters (m) and slaves (s), by index; also of stacks of matrices."""

    size: int
    masters: Indices
    slaves: Indices

    @classmethod
    def at(cls, masters: Sequence[int] | Indices, size: int) -> Partition:
        """Cut structures of `size` DOFs at their masters."""
        return cls(size, np.array(masters), np.setdiff1d(np.arange(size), masters))

    def labels(self, model: StructuralModel) -> tuple[Label, ...]:
        """Return the labels of the masters."""
        return tuple(model.dofs[k] for k in self.masters)

    def coupling(self, matrix: Matrix) -> Array:
        """Return the slaves' rows at the masters' columns (s x m), dense."""
        if is_sparse(matrix):
            return matrix[:, self.masters][self.slaves].toarray()
        return np.asarray(matrix[..., self.slaves[:, None], self.masters])

    def inner(self, matrix: Matrix) -> Matrix:
        """Return the slaves' rows at the slaves' columns (s x s)."""
        rows: Any = matrix[:, self.slaves]
        block: Matrix = rows[self.slaves]
        return block

    def basis(self, slaves: Array) -> Array:
        """Return T (n x (m + k)), unit at the masters, from rows of the slaves (s x (m + k))."""
        T = np.zeros((*slaves.shape[:-2], self.size, slaves.shape[-1]))
        T[..., self.masters, np.arange(len(self.masters))] = 1.0
        T[..., self.slaves, :] = slaves
        return T


class CheckedSolver(NamedTuple):
    """A solver with a matrix, and the condition of that matrix scaled to a unit diagonal.

    `factors`: those of a sparse one.
    """

    solve: Callable[[Array], Array]
    condition: float
    factors: ScaledFactors | None = None

    def __call__(self, right: Array) -> Array:
        """Solve for right-hand sides (s x columns)."""
        return self.solve(right)


def solver(matrix: Matrix, what: str, remedy: str, size: Array | None = None) -> CheckedSolver:
    """Factorise a symmetric matrix; return a solver that checks every solution.

    `matrix`: the matrix (s x s), dense or sparse; it is scaled to a diagonal of about 1, or by `size`, with
    powers of two, which round nothing; `what`: the clause that names the fault if it is singular; `size`: the
    sizes of its diagonal entries (s), where these are differences. Raises Singular if it is singular to
    working precision.
    """
    if not matrix.shape[0]:
        return CheckedSolver(lambda right: right, 1.0)
    size = np.abs(np.asarray(matrix.diagonal())) if size is None else size
    scale = np.exp2(np.round(-0.5 * np.log2(np.where(size > 0, size, 1.0))))
    factors = None
    try:
        if is_sparse(matrix):
            factors = _sparse(matrix, scale)
            condition = factors.condition
            solve: Callable[[Array], Array] = factors.factor.solve
        else:
            solve, condition = _dense_factors(matrix, scale)
    except Singular:
        condition = np.inf
    if not condition < _WORST:
        raise Singular(f"{what} (condition {condition:.2g})", remedy=remedy, names=("masters",))
    column = scale[:, None]
    return CheckedSolver(lambda right: np.asarray(column * solve(column * right)), condition, factors)


def _dense_factors(matrix: Any, scale: Array) -> tuple[Callable[[Array], Array], float]:
    """Return a solver with the scaled matrix, and its condition (1-norm, estimated).

    A norm below 1 is what differences have left of entries of size 1: it counts as 1.
    """
    from scipy.linalg import lapack, lu_solve

    scaled = matrix * scale * scale[:, None]
    factor, pivots, info = lapack.dgetrf(scaled)
    size = np.abs(scaled).sum(axis=0).max()
    reciprocal = lapack.dgecon(factor, size)[0] * min(size, 1.0) if info == 0 else 0.0
    condition = 1 / reciprocal if reciprocal else np.inf

    def solve(b: Array) -> Array:
        x = lu_solve((factor, pivots), b)
        if condition < _DOUBLED:
            return np.asarray(x + lu_solve((factor, pivots), b - scaled @ x))
        exact = StrainEnergy(scaled)
        for _ in range(_REFINEMENTS):
            step = lu_solve((factor, pivots), exact.residual(x, b))
            x = x + step
            if np.all(np.abs(step) <= np.finfo(float).eps * np.abs(x).max(axis=0, initial=0.0)):
                break
        return np.asarray(x)

    return solve, condition


def _sparse(matrix: Any, scale: Array) -> ScaledFactors:
    from scipy.sparse import csc_array, diags_array

    from dynid.structure.backends import factorise

    D = diags_array(scale)
    factor = factorise(csc_array(D @ matrix @ D))
    condition = norm_of_inverse(len(scale), factor.solve) * max(factor.size, 1.0)
    return ScaledFactors(matrix, factor, scale, condition)


@dataclass(frozen=True)
class OnMasters:
    """A reduction on masters, DOFs that stay coordinates.

    `masters`: labels, or a rule to choose by. Default: the DOFs of joints, sensors and loads. `interest`:
    purpose of the model.
    """

    masters: Sequence[Label] | Masters | None = None
    interest: Interest = field(default_factory=Interest, kw_only=True)

    def partition(self, model: StructuralModel) -> Partition:
        """Cut a structure at the masters.

        Raises UsageError if masters do not exist or stand twice.
        """
        return Partition.at(masters_alone(model, self.masters, self.interest), model.size)


@dataclass(frozen=True)
class Guyan(OnMasters):
    """Static condensation: slaves follow the masters without inertia, ``x_s = -K_ss^-1 K_sm x_m``.

    Exact at rest, for loads on the masters. Joints that are known are part of the stiffness, others are not;
    for joints between masters this makes no difference.
    """

    @guarded("the static condensation")
    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure; Singular is raised if the slaves are not held by the masters."""
        return _condensed(model, self.partition(model))


@dataclass(frozen=True)
class Dynamic(OnMasters):
    """Slaves follow the masters as they do at one frequency, ``-(K - w^2 M)_ss^-1 (K - w^2 M)_sm``.

    Exact at that frequency for loads on the masters, without damping; at 0 it is static condensation.

    `masters`, `interest`: as of `Guyan`; `frequency`: the frequency, rad/s. Default: the middle of the band
    of interest.
    """

    frequency: float | None = None

    @property
    def omega(self) -> float:
        """The frequency at which it is exact, rad/s."""
        omega = self.frequency
        if omega is None and self.interest.band is not None:
            omega = self.interest.band / 2
        if omega is None or not (math.isfinite(omega) and omega >= 0):
            raise UsageError(
                "dynamic condensation needs the frequency that it is exact at",
                remedy="Give `frequency: OMEGA` in rad/s, not negative.",
                names=("frequency",),
            )
        return omega

    @guarded("the dynamic condensation")
    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure; Singular is raised at a natural frequency of it with its masters held."""
        omega = self.omega
        return _condensed(model, self.partition(model), omega)


def _condensed(model: StructuralModel, cut: Partition, omega: float | None = None) -> StructuralReduction:
    static, inverse = constraint_modes(model, cut, omega)
    labels = cut.labels(model)
    reduced = projected(model, cut.basis(static), labels)
    return StructuralReduction(reduced, labels, condition=inverse.condition, inverted=SLAVES)


def constraint_modes(
    model: StructuralModel, cut: Partition, omega: float | None = None
) -> tuple[Array, CheckedSolver]:
    """Return the slaves' motion with unit motions of the masters (s x m), and the inverse that gives it.

    They follow statically, or as at a frequency `omega`, rad/s.
    """
    M, _, K = model.with_known_joints()
    if omega is None:
        Z, solve = K, solver(cut.inner(K), FREE, REMEDY)
    else:
        Z = combined(1.0, K, -(omega**2), M)
        solve = solver(
            cut.inner(Z),
            f"the slaves resonate at {frequency_text(omega, 6)} while the masters are held: they do not "
            "follow",
            "Condense at another frequency, or take more masters.",
            (np.abs(K.diagonal()) + omega**2 * np.abs(M.diagonal()))[cut.slaves],
        )
    return -solve(cut.coupling(Z)), solve
