"""Structures of point masses and links."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.errors import UsageError
from dynid.lti.floating import guarded
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
    k: float = 0.0
    c: float = 0.0


@guarded("the sum of stiffness or damping at a DOF", UsageError)
def lumped(masses: Sequence[float], links: Iterable[Link], joints: Iterable[Joint] = ()) -> StructuralModel:
    """Return the structure of point masses joined by links.

    Parameters
    ----------
    masses
        Masses of the DOFs 1 … n, kg; a DOF of mass 0 follows the others without inertia.
    links
        The known links.
    joints
        The joints, kept apart from the matrices.

    Raises
    ------
    UsageError
        If a mass is negative, or all are 0, or a link names a DOF that does not exist or has negative values.
    NumericalError
        If a spring is so soft beside others that no matrix of doubles holds both.
    """
    if not masses or not all(math.isfinite(mass) and mass >= 0 for mass in masses):
        raise UsageError("the masses of a lumped structure must be finite and not negative")
    if not any(masses):
        raise UsageError("the masses of the lumped structure are all 0", remedy="Give one of them a mass.")
    n = len(masses)
    C, K = np.zeros((n, n)), np.zeros((n, n))
    links = list(links)
    for link in links:
        dofs = tuple(link.dofs)
        if len(dofs) not in (1, 2) or len(set(dofs)) != len(dofs):
            raise UsageError(f"a link must name one DOF (to ground) or two different ones, not {list(dofs)}")
        if not all(1 <= dof <= n for dof in dofs):
            there_is = "is DOF 1" if n == 1 else f"are the DOFs 1 to {n}"
            raise UsageError(f"a link names DOFs {list(dofs)}, but there {there_is} only")
        if not all(math.isfinite(value) and value >= 0 for value in (link.k, link.c)):
            raise UsageError(
                f"stiffness and damping of the link {list(dofs)} must be finite and not negative"
            )
        direction = np.zeros(n)
        direction[dofs[0] - 1] = 1.0
        if len(dofs) == 2:
            direction[dofs[1] - 1] = -1.0
        pattern = np.outer(direction, direction)
        C += link.c * pattern
        K += link.k * pattern
    check_springs(masses, [(link.dofs, link.k) for link in links])
    return StructuralModel(np.diag(np.asarray(masses, dtype=float)), C, K, tuple(joints))
