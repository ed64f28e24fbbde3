"""Stiffness contrast: springs too soft to survive the sum with far stiffer ones in a stiffness matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.errors import NumericalError

# A motion whose strain energy is a smaller part of its terms is taken for rigid (`modes.modes`).
_DROWNED = 16 * float(np.finfo(float).eps)


class _Cluster:
    """Masses connected by springs: their mass, and the sum of the stiffnesses inside."""

    def __init__(self, mass: float) -> None:
        self.mass, self.stiffness = mass, 0.0


def check_springs(masses: Sequence[float], springs: Sequence[tuple[tuple[int, ...], float]]) -> None:
    """Refuse springs that are rounding in a stiffness matrix: the parts that they join would come out free.

    Springs are taken from the stiffest down. Each holds two clusters of masses together, or one to the
    ground; as the clusters move against each other their stiffer springs stay unstrained, and their entries
    of the matrix must cancel to less than the spring itself.

    Parameters
    ----------
    masses
        Masses of the DOFs, kg.
    springs
        DOFs (from 1; one: to ground) and stiffness, N/m.

    Raises
    ------
    NumericalError
        That names the first such spring.
    """
    of = [_Cluster(mass) for mass in (np.inf, *masses)]  # 0 is the ground
    for dofs, k in sorted(springs, key=lambda spring: -spring[1]):
        one, other = of[dofs[0]], of[dofs[1]] if len(dofs) == 2 else of[0]
        if k <= 0 or one is other:
            one.stiffness += k
            continue
        # Stiffness inside the two clusters, weighted as they move against each other by 1.
        whole = one.mass + other.mass
        if np.inf in (one.mass, other.mass):
            inside = one.stiffness if other.mass == np.inf else other.stiffness
        elif whole == 0:  # no inertia says which of them moves
            inside = max(one.stiffness, other.stiffness)
        else:
            inside = one.stiffness * (other.mass / whole) ** 2 + other.stiffness * (one.mass / whole) ** 2
        if k <= _DROWNED * 4 * inside:
            between = f"from DOF {dofs[0]} to ground"
            if len(dofs) == 2:
                between = f"between DOFs {dofs[0]} and {dofs[1]}"
            raise NumericalError(
                f"the stiffness {k:g} N/m {between} is lost beside stiffnesses that sum to "
                f"{max(one.stiffness, other.stiffness):g} N/m: double precision holds no more than 16 digits",
                remedy="Make what is that stiff rigid: one mass instead of several.",
                names=("structure",),
            )
        merged = _Cluster(one.mass + other.mass)
        merged.stiffness = one.stiffness + other.stiffness + k
        of = [merged if cluster is one or cluster is other else cluster for cluster in of]
