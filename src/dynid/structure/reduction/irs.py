"""The improved reduced system, and its iteration.

``t_(i+1) = t_0 + K_ss^-1 (M_sm + M_ss t_i) M_i^-1 K_i`` has terms as large as the fastest motion of the
masters is fast; where masters are joined stiffly, their slow motion is a small difference of these. So the
reduced model is taken in its own modes: with ``K_i Phi = M_i Phi Omega^2``

    t_(i+1) Phi = t_0 Phi + K_ss^-1 (M_sm + M_ss t_i) Phi Omega^2,

where every column is of the size of its own motion.

Sources: J. O'Callahan, IMAC 1989 (IRS); M. I. Friswell, S. D. Garvey & J. E. T. Penny, *J. Sound Vib.* 186
(1995) 311–323 (iterated).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, guarded
from dynid.defaults import MASTER_COORDINATES
from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure.matrices import Matrix
from dynid.structure.model import StructuralModel
from dynid.structure.modes.modes import modes
from dynid.structure.reduction.condensation import (
    FREE,
    REMEDY,
    SLAVES,
    CheckedSolver,
    OnMasters,
    Partition,
    solver,
)
from dynid.structure.reduction.reduced_model import (
    StructuralReduction,
    cancellation,
    modal_rule,
    projected,
    projected_stiffness,
    without_rounding,
)

SETTLED = 1e-14
"""A change of the motion in a mode, relative to it, that is none."""
_EPS = float(np.finfo(float).eps)
# The part of a frequency that rounding may leave open. It is seen by one random change, and may be so much
# larger.
_OPEN, _MARGIN = 1e-6, 10.0
MAX_ROUNDING = _OPEN / _MARGIN
"""Rounding amplified by the steps beyond which its effect on frequencies is measured."""


@dataclass(frozen=True)
class Irs(OnMasters):
    """Static condensation with the slaves' inertia as the reduced model accelerates them.

    Iterated it converges to SEREP on the lowest modes.

    `masters`, `interest`: as of `Guyan`; `iterations`: number of steps, 1 is IRS itself; it ends earlier
    where nothing changes any more.
    """

    iterations: int = 1

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise UsageError("IRS takes at least one iteration", names=("iterations",))

    @guarded("the improved reduced system")
    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure.

        Coordinates are the masters' displacements; where the slow modes of the reduced model would be lost in
        them, they are these modes.

        Raises Singular if the slaves are not held by the masters, or the masters move without inertia.
        """
        cut = self.partition(model)
        M, _, K = model.with_known_joints()
        solve = solver(cut.inner(K), FREE, REMEDY)
        problem = _Iteration(cut, M, K, solve, -solve(cut.coupling(K)))
        T, square, growth = problem.iterated(self.iterations)
        if growth * _EPS > MAX_ROUNDING:
            # Frequencies that move with rounding of the motions are refused.
            previous, omega = problem.iterated(self.iterations, noise=_EPS)[1], np.sqrt(square)
            moved = _MARGIN * np.abs(np.sqrt(previous) - omega) / np.where(omega > 0, omega, 1.0)
            if moved.max() > _OPEN:
                at, largest = int(np.argmax(moved > _OPEN)) + 1, 100 * float(moved.max())
                raise _open_to_rounding(f"it moves the frequency of mode {at} by {largest:.2g} %")
        lost, labels, rule = cancellation(T[cut.masters], square)[1], cut.labels(model), ""
        if lost <= MASTER_COORDINATES.value:
            slaves = np.asarray(np.linalg.solve(T[cut.masters].T, T[cut.slaves].T).T, dtype=np.float64)
            reduced = projected(model, cut.basis(slaves), labels)
        else:
            names = [f"reduced_mode_{number}" for number in range(1, T.shape[1] + 1)]
            reduced = projected(model, T, names, np.flatnonzero(square == 0).tolist())
            rule = modal_rule(float(lost))
        return StructuralReduction(reduced, labels, condition=solve.condition, inverted=SLAVES, rule=rule)


class _Iteration(NamedTuple):
    """A structure cut at its masters, its matrices, and the constraint modes."""

    cut: Partition
    M: Matrix
    K: Matrix
    solve: CheckedSolver
    static: Array

    def iterated(self, iterations: int, noise: float = 0.0) -> tuple[Array, Array, float]:
        """Return the reduced model's modes (n x m) of unit modal mass, and their squared frequencies.

        The last is by how much the steps may have amplified rounding. In every step each mode gets a part
        of the size of `noise` of all others.
        """
        cut, rng = self.cut, np.random.Generator(np.random.PCG64(0))
        # About the inverse of the lowest squared frequency with the masters held, s^2.
        M, probe = (
            cut.inner(self.M),
            np.random.Generator(np.random.PCG64(1)).standard_normal((len(cut.slaves), 1)),
        )
        moved = self.solve(np.asarray(M @ probe))
        size, after = (float(np.sum(x * np.asarray(M @ x))) for x in (probe, moved))
        slowest = float(np.sqrt(after / size)) if size > 0 else 0.0
        T, growth = cut.basis(self.static), 1.0
        for step in range(iterations):
            last, square = _on_modes(T, self.M, self.K, step)
            last = last + noise * last @ rng.standard_normal((len(square), len(square)))
            inertia = np.asarray(self.M @ last)[cut.slaves]
            T = np.empty((cut.size, last.shape[1]))
            T[cut.masters] = last[cut.masters]
            T[cut.slaves] = self.static @ last[cut.masters] + self.solve(inertia) * square
            growth *= max(1.0, float(square.max()) * slowest)
            if np.all(np.abs(T - last).max(axis=0) <= SETTLED * np.abs(last).max(axis=0)):
                break
        return *_on_modes(T, self.M, self.K, iterations), growth


def _open_to_rounding(what: str) -> NumericalError:
    return NumericalError(
        f"the improved reduced system is open to rounding: {what}",
        remedy="Masters that move much faster than the slaves amplify rounding in every step: take fewer "
        "iterations or other masters, or serep.",
        names=("masters",),
    )


def _on_modes(T: Array, M: Matrix, K: Matrix, step: int) -> tuple[Array, Array]:
    """Return the motion (n x m) of unit modal mass in the modes of a basis, and their squared frequencies.

    A basis that has lost a direction has not got there without `step` steps that amplify rounding.
    """
    mass = T.T @ np.asarray(M @ T)
    mass = (mass + mass.T) / 2
    stiffness = without_rounding(projected_stiffness(T, K), T, K)
    try:
        reduced_modes = modes(mass, np.zeros_like(mass), stiffness)
        if reduced_modes.massless:
            raise Singular("there are massless directions")
    except (Singular, UsageError) as error:
        if step:
            raise _open_to_rounding(f"after {step} steps two modes are one") from None
        raise Singular(
            f"the masters can move without inertia, which IRS divides by ({error.problem})",
            remedy="Take other or fewer masters, or static condensation.",
            names=("masters",),
        ) from None
    return T @ reduced_modes.shapes, reduced_modes.omega**2
