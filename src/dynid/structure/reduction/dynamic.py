"""Dynamic condensation at one frequency.

Source: A. Y. T. Leung, *Int. J. Numer. Methods Eng.* 12 (1978) 1705–1715.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.masters import Masters
from dynid.structure.reduction.reduction import Reduction, masters_alone, projected, with_known_joints
from dynid.structure.reduction.selection import Interest
from dynid.structure.reduction.static import partition, solver


@dataclass(frozen=True)
class Dynamic:
    """Slaves follow the masters as they do at one frequency, ``-(K - w^2 M)_ss^-1 (K - w^2 M)_sm``.

    Exact at that frequency for loads on the masters, without damping; at 0 it is static condensation.

    Parameters
    ----------
    frequency
        The frequency, rad/s. Absent: the middle of the band of interest.
    masters, interest
        As of `Guyan`.
    """

    frequency: float | None = None
    masters: Sequence[Label] | Masters | None = None
    interest: Interest = field(default_factory=Interest)

    @guarded("the dynamic condensation")
    def reduce(self, model: StructuralModel) -> Reduction:
        """Reduce a structure.

        Raises
        ------
        UsageError
            If masters do not exist or stand twice, or no frequency is known.
        Singular
            If the frequency is a natural one of the structure with its masters held.
        """
        omega = self._omega()
        cut = partition(model, masters_alone(model, self.masters, self.interest))
        M, _, K = with_known_joints(model)
        Z: Any = K - omega**2 * M
        solve = solver(
            cut.inner(Z),
            f"the slaves resonate at {omega:g} rad/s while the masters are held: they do not follow",
            "Condense at another frequency, or take more masters.",
            (np.abs(K.diagonal()) + omega**2 * np.abs(M.diagonal()))[cut.slaves],
        )
        return Reduction(projected(model, cut.basis(-solve(cut.coupling(Z))), cut.labels), cut.labels)

    def _omega(self) -> float:
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
