"""Structures of point masses and links, and springs too soft to survive the sum with far stiffer ones."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arrays import guarded
from dynid.errors import NumericalError, UsageError
from dynid.parameters import Parameter
from dynid.structure.assembly import Assembly
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.matrices import DependentMatrix
from dynid.structure.model import StructuralModel

# A motion whose strain energy is a smaller part of its terms is taken for rigid (`modes.modes`).
_DROWNED = 16 * float(np.finfo(float).eps)


class _Cluster:
    """Masses connected by springs: their mass, and the sum of the stiffnesses inside."""

    def __init__(self, mass: float) -> None:
        self.mass, self.stiffness = mass, 0.0


def _check_springs(masses: Sequence[float], springs: Sequence[tuple[tuple[int, ...], float]]) -> None:
    """Refuse springs that are rounding in a stiffness matrix: the parts that they join would come out free.

    Springs are taken from the stiffest down. Each holds two clusters of masses together, or one to the
    ground; as the clusters move against each other their stiffer springs stay unstrained, and their entries
    of the matrix must cancel to less than the spring itself.

    `masses`: masses of the DOFs, kg; `springs`: DOFs (from 1; one: to ground) and stiffness, N/m.
    """
    of = [_Cluster(mass) for mass in (np.inf, *masses)]  # 0 is the ground
    for dofs, k in sorted(springs, key=lambda spring: -spring[1]):
        first, second = of[dofs[0]], of[dofs[1]] if len(dofs) == 2 else of[0]
        if k <= 0 or first is second:
            first.stiffness += k
            continue
        # Stiffness inside the two clusters, weighted as they move against each other by 1.
        total_mass = first.mass + second.mass
        if np.inf in (first.mass, second.mass):
            inside = first.stiffness if second.mass == np.inf else second.stiffness
        elif total_mass == 0:  # no inertia says which of them moves
            inside = max(first.stiffness, second.stiffness)
        else:
            inside = (
                first.stiffness * (second.mass / total_mass) ** 2
                + second.stiffness * (first.mass / total_mass) ** 2
            )
        if k <= _DROWNED * 4 * inside:
            between = f"from DOF {dofs[0]} to ground"
            if len(dofs) == 2:
                between = f"between DOFs {dofs[0]} and {dofs[1]}"
            raise NumericalError(
                f"the stiffness {k:g} N/m {between} is lost beside stiffnesses that sum to "
                f"{max(first.stiffness, second.stiffness):g} N/m: double precision holds no more than 16 "
                "digits",
                remedy="Make what is that stiff rigid: one mass instead of several.",
                names=("structure",),
            )
        merged = _Cluster(first.mass + second.mass)
        merged.stiffness = first.stiffness + second.stiffness + k
        of = [merged if cluster is first or cluster is second else cluster for cluster in of]


@dataclass(frozen=True)
class Link:
    """A known spring and damper in parallel; the spring may have a loss factor."""

    dofs: tuple[int, ...]  # one DOF (to ground) or two
    # Stiffness, N/m, and damping, N·s/m.
    k: Real = 0.0
    c: Real = 0.0
    eta: Real = 0.0  # loss factor of k


@guarded("the sum of stiffness or damping at a DOF", UsageError)
def lumped(
    masses: Sequence[Real],
    links: Iterable[Link],
    joints: Iterable[Joint] = (),
    *,
    parameters: Iterable[Parameter] = (),
    damping: ProportionalDamping | ModalDamping | None = None,
) -> StructuralModel:
    """Return the structure of point masses joined by links.

    Parameters
    ----------
    masses
        Masses of the DOFs 1 … n, kg; a DOF of mass 0 follows the others without inertia.
    links
        The known links.
    joints
        The joints, kept apart from the matrices.
    parameters
        Unknown parameters, on which masses and links may depend.
    damping
        Damping of the links' stiffness and of the masses, beside the dampers of links.

    Raises
    ------
    UsageError
        If a mass is negative, or all are 0, or a link names a DOF that does not exist or has negative values.
    NumericalError
        If a spring is so soft beside others that no matrix of doubles holds both.
    """
    if not masses or not all(math.isfinite(float(mass)) and float(mass) >= 0 for mass in masses):
        raise UsageError("the masses of a lumped structure must be finite and not negative")
    if not any(masses):
        raise UsageError("the masses of the lumped structure are all 0", remedy="Give one of them a mass.")
    n = len(masses)
    assembly = Assembly(range(1, n + 1), sparse=False)
    for dof, mass in enumerate(masses, 1):
        assembly.add("M", [dof], DependentMatrix(np.eye(1)).times(mass))
    links = list(links)
    for link in links:
        dofs = tuple(link.dofs)
        if len(dofs) not in (1, 2) or len(set(dofs)) != len(dofs):
            raise UsageError(f"a link must name one DOF (to ground) or two different ones, not {list(dofs)}")
        if not all(1 <= dof <= n for dof in dofs):
            there_is = "is DOF 1" if n == 1 else f"are the DOFs 1 to {n}"
            raise UsageError(f"a link names DOFs {list(dofs)}, but there {there_is} only")
        if not all(
            math.isfinite(float(value)) and (float(value) >= 0 or isinstance(value, Dependent))
            for value in (link.k, link.c)
        ):
            raise UsageError(
                f"stiffness and damping of the link {list(dofs)} must be finite and not negative"
            )
        direction = np.array([1.0, -1.0])[: len(dofs)]
        pattern = DependentMatrix(np.outer(direction, direction))
        assembly.add("C", dofs, pattern.times(link.c))
        assembly.add_stiffness(dofs, pattern.times(link.k), link.eta)
    _check_springs([float(mass) for mass in masses], [(link.dofs, float(link.k)) for link in links])
    return assembly.model(damping, joints, parameters, translations=True)
