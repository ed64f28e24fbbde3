"""Structures of point masses and links."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real
from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.parameters import Parameter
from dynid.structure.assembly import Assembly
from dynid.structure.dependent_matrix import DependentMatrix
from dynid.structure.joints import Joint
from dynid.structure.model import StructuralModel
from dynid.structure.stiffness_contrast import check_springs


@dataclass(frozen=True)
class Link:
    """A known spring and damper in parallel.

    Parameters
    ----------
    dofs
        One DOF (to ground) or two.
    k, c
        Stiffness, N/m, and damping, N·s/m.
    """

    dofs: tuple[int, ...]
    k: Real = 0.0
    c: Real = 0.0


@guarded("the sum of stiffness or damping at a DOF", UsageError)
def lumped(
    masses: Sequence[Real],
    links: Iterable[Link],
    joints: Iterable[Joint] = (),
    *,
    parameters: Iterable[Parameter] = (),
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
    whole = Assembly(range(1, n + 1), sparse=False)
    for dof, mass in enumerate(masses, 1):
        whole.add("M", [dof], DependentMatrix(np.eye(1)).times(mass))
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
        whole.add("C", dofs, pattern.times(link.c))
        whole.add("K", dofs, pattern.times(link.k))
    check_springs([float(mass) for mass in masses], [(link.dofs, float(link.k)) for link in links])
    return whole.model(None, joints, parameters)
