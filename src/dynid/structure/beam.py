"""Euler–Bernoulli beams: element matrices with consistent mass, and beams of elements in a row.

Source: J. S. Archer, "Consistent mass matrix for distributed mass systems", 1963.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cache
from itertools import pairwise

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.parameters import Parameter
from dynid.structure.assembly import (
    Assembly,
    PointMass,
    Spring,
    Support,
    check_nodes,
    free_labels,
    node_label,
    per_element,
)
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.dependent_matrix import DependentMatrix, pattern_sum
from dynid.structure.joints import Joint
from dynid.structure.matrices import Array
from dynid.structure.model import StructuralModel
from dynid.structure.nodes import Nodes


def bending(
    EI: Real, rhoA: Real, length: Real, released: Sequence[int] = ()
) -> tuple[DependentMatrix, DependentMatrix]:
    """Return stiffness and consistent mass (4 x 4) of a beam element, DOFs [w1, theta1, w2, theta2].

    Rotations are the slopes ``dw/dx``. Released DOFs carry no force: they are condensed statically (Guyan),
    which leaves zeros in their place.

    Parameters
    ----------
    EI, rhoA, length
        Bending stiffness, N·m2, mass per length, kg/m, and length, m.
    released
        The places, 0 … 3, of the released DOFs.

    Raises
    ------
    UsageError
        If a released DOF moves without any stiffness.
    """
    k, m = (
        pattern_sum((1.0, P0), (length, P1), (length**2, P2))
        for P0, P1, P2 in _patterns("bending", tuple(sorted(released)))
    )
    return k.times(EI / length**3), m.times(rhoA * length / 420)


def stretching(
    EA: Real, rhoA: Real, length: Real, released: Sequence[int] = ()
) -> tuple[DependentMatrix, DependentMatrix]:
    """Return stiffness and consistent mass (2 x 2) of a bar element, DOFs [u1, u2]; of a shaft alike.

    Parameters
    ----------
    EA, rhoA, length
        Axial stiffness, N, mass per length, kg/m, and length, m; of a shaft GJ and polar inertia per length.
    released
        The released DOFs as in `bending`, 0 or 1.

    Raises
    ------
    UsageError
        If both are released.
    """
    (k, *_), (m, *_) = _patterns("stretching", tuple(sorted(released)))
    return DependentMatrix(k).times(EA / length), DependentMatrix(m).times(rhoA * length / 6)


# The upper triangles, by rows, of L^3/EI times the stiffness and 420/(rhoA L) times the mass, to be
# multiplied by L once for each rotation among an entry's two DOFs; of a bar L/EA and 6/(rhoA L) times.
_TRIANGLES: dict[str, tuple[list[int], list[int]]] = {
    "bending": ([12, 6, -12, 6, 4, -6, 2, 12, -6, 4], [156, 22, 54, -13, 4, 13, -3, 156, -22, 4]),
    "stretching": ([1, -1, 1], [2, 1, 2]),
}


@cache
def _patterns(element: str, released: tuple[int, ...]) -> list[list[Array]]:
    """Return the parts of stiffness and mass of `_TRIANGLES`, each by the power of the length."""
    rotations = {"bending": [0, 1, 0, 1], "stretching": [0, 0]}[element]
    n, exact = len(rotations), []
    for triangle in _TRIANGLES[element]:
        whole = np.full((n, n), Fraction(0))
        whole[np.triu_indices(n)] = [Fraction(entry) for entry in triangle]
        exact.append(np.triu(whole) + np.triu(whole, 1).T)
    for place in released:
        if not exact[0][place, place]:
            raise UsageError("releases leave a member loose", remedy="Release fewer directions at its ends.")
        follows = np.diag([Fraction(at != place) for at in range(n)])
        follows[place] -= exact[0][place] / exact[0][place, place]
        follows[place, place] = Fraction(0)
        exact = [follows.T @ one @ follows for one in exact]
    powers = np.add.outer(rotations, rotations)
    return [[np.where(powers == power, one.astype(float), 0.0) for power in range(3)] for one in exact]


DIRECTIONS = ("w", "theta")
"""The DOFs of a node: deflection, m, and slope, rad."""


@guarded("the matrices of the beam", UsageError)
def beam(
    elements: int,
    length: Real | Sequence[Real],
    EI: Real | Sequence[Real],
    rhoA: Real | Sequence[Real],
    *,
    supports: Iterable[Support] = (),
    masses: Iterable[PointMass] = (),
    springs: Iterable[Spring] = (),
    damping: ProportionalDamping | ModalDamping | None = None,
    joints: Iterable[Joint] = (),
    parameters: Iterable[Parameter] = (),
) -> StructuralModel:
    """Return a beam along x with consistent mass; its free DOFs node by node, w before theta.

    Parameters
    ----------
    elements
        Number of elements; the nodes are 1 … elements + 1.
    length
        Length of the whole beam, m, or of each element (elements).
    EI, rhoA
        Bending stiffness, N·m2, and mass per length, kg/m (which may be 0): one for all, or of each element.
    supports, masses, springs
        Supports, masses and grounded springs at the nodes.
    damping
        Of the beam without springs' own damping, which is added.
    joints
        The joints, between DOFs such as ``w_4`` or ``theta_1``.
    parameters
        Unknown parameters, on which all numbers may depend.

    Raises
    ------
    UsageError
        If a number, a node or a direction makes no sense.
    """
    if elements < 1:
        raise UsageError("a beam has at least one element")
    each = length if isinstance(length, Sequence) else length / elements
    lengths = per_element("length", each, elements)
    stiffness = per_element("EI", EI, elements)
    density = per_element("rhoA", rhoA, elements, zero=True)
    held, points, grounded = list(supports), list(masses), list(springs)
    for what, items in (("support", held), ("mass", points), ("spring", grounded)):
        check_nodes(what, items, elements + 1, DIRECTIONS)
    fixed = [(direction, item.node) for item in held for direction in item.fix]
    whole = Assembly(free_labels(elements + 1, DIRECTIONS, fixed))
    element = cache(bending)  # many are alike
    for first, (L, ei, ra) in enumerate(zip(lengths, stiffness, density, strict=True), 1):
        ends = [node_label(direction, node) for node in (first, first + 1) for direction in DIRECTIONS]
        k, m = element(ei, ra, L)
        whole.add("K", ends, k)
        whole.add("M", ends, m)
    whole.attach(points, grounded, ("w",))
    along = np.concatenate([[0.0], np.cumsum([float(L) for L in lengths])])
    numbers = range(1, elements + 2)
    nodes = Nodes(tuple(numbers), np.outer(along, [1.0, 0, 0]), lines=tuple(pairwise(numbers)))
    return whole.model(damping, joints, parameters, nodes)
