"""The improved reduced system, and its iteration.

Sources: J. O'Callahan, IMAC 1989 (IRS); M. I. Friswell, S. D. Garvey & J. E. T. Penny, *J. Sound Vib.* 186
(1995) 311–323 (iterated).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynid.errors import Singular, UsageError
from dynid.lti.floating import guarded
from dynid.structure.matrices import Array, Label
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.guyan import FREE, REMEDY
from dynid.structure.reduction.masters import Masters
from dynid.structure.reduction.reduction import Reduction, masters_alone, projected, with_known_joints
from dynid.structure.reduction.selection import Interest
from dynid.structure.reduction.static import partition, solver

# A change of the basis, relative to it, that is none.
_SETTLED = 1e-14


@dataclass(frozen=True)
class Irs:
    """Static condensation with the slaves' inertia as the reduced model accelerates them.

    ``t_(i+1) = t_0 + K_ss^-1 (M_sm + M_ss t_i) M_i^-1 K_i`` from the static t_0, M_i and K_i those of
    step i. Iterated it converges to SEREP on the lowest modes.

    Parameters
    ----------
    masters, interest
        As of `Guyan`.
    iterations
        Number of steps, 1 is IRS itself; it ends earlier where nothing changes any more.
    """

    masters: Sequence[Label] | Masters | None = None
    iterations: int = 1
    interest: Interest = field(default_factory=Interest)

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise UsageError("IRS takes at least one iteration", names=("iterations",))

    @guarded("the improved reduced system")
    def reduce(self, model: StructuralModel) -> Reduction:
        """Reduce a structure.

        Raises
        ------
        UsageError
            If masters do not exist or stand twice.
        Singular
            If the slaves are not held by the masters, or the masters move without inertia.
        """
        cut = partition(model, masters_alone(model, self.masters, self.interest))
        M, _, K = with_known_joints(model)
        solve = solver(cut.inner(K), FREE, REMEDY)
        static = -solve(cut.coupling(K))
        slaves = static
        for _ in range(self.iterations):
            T = cut.basis(slaves)
            inertia = np.asarray(M @ T)
            back = _accelerations(T.T @ inertia, T.T @ np.asarray(K @ T))
            last, slaves = slaves, static + solve(inertia[cut.slaves]) @ back
            if np.abs(slaves - last).max(initial=0.0) <= _SETTLED * np.abs(slaves).max(initial=0.0):
                break
        return Reduction(projected(model, cut.basis(slaves), cut.labels), cut.labels)


def _accelerations(M: Array, K: Array) -> Array:
    """Return ``M^-1 K`` of the reduced model."""
    size = np.diag(M)
    if np.all(size > 0):
        scale = 1 / np.sqrt(size)
        values, vectors = np.linalg.eigh(M * scale * scale[:, None])
        if values[0] > len(M) * np.finfo(float).eps:
            root = scale[:, None] * vectors / np.sqrt(values)
            return np.asarray(root @ (root.T @ K))
    raise Singular(
        "the masters can move without inertia, which IRS divides by",
        remedy="Take other or fewer masters, or static condensation.",
        names=("masters",),
    )
